"""The planned path in columns for a page: samples and the stretches between them, thinned to what a picture can show.

A stretch of the plan comes in as its timed path (a whole plan, or the windows of a long one), so memory stays bounded
however long the program is. What is thinned away lies within a tolerance that only grows where the limit of samples
demands it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from gcode.canon import ToolChange
from planner.jerk import FilteredTrajectory
from planner.planfile import sample_times
from planner.trajectory import PathTrajectory
from planner.types import F8, I4, Event, Limits

FEED, RAPID, REST = 0, 1, 2
FINEST_STEP_S, SAMPLES_WANTED = 2e-3, 200_000
CHUNK = 200_000
TOLERANCE_MM, TOLERANCE_OF_SPEED = 1e-3, 0.01
NEAR_LIMIT = 0.995
U1 = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Stretches:
    """N samples and the N - 1 stretches between them.

    t_s f8[N], q f8[N, A] mm or degrees, v f8[N, A]. Of each stretch: feed_mm_s f4 (0: rapid or rest), accel_mm_s2 f4
    and jerk_mm_s3 f4 (0 without jerk filter) the largest in it, line i4 and tool i4 at its beginning, kind u1 (feed,
    rapid, rest), cause u1, index into ``causes_of``.
    """

    t_s: F8
    q: F8
    v: F8
    feed_mm_s: npt.NDArray[np.float32]
    accel_mm_s2: npt.NDArray[np.float32]
    jerk_mm_s3: npt.NDArray[np.float32]
    line: I4
    tool: I4
    kind: U1
    cause: U1

    def __len__(self) -> int:
        return len(self.t_s)


_SAMPLES = ("t_s", "q", "v")
_BETWEEN = tuple(f.name for f in fields(Stretches) if f.name not in _SAMPLES)


@dataclass(frozen=True, slots=True, eq=False)
class PathColumns:
    """What a page draws of a plan. ``causes``: names for ``Stretches.cause``; passes: when which line begins.

    pass_s f8[P], pass_line i4[P]: at pass_s the program comes to pass_line. peak_mm_s: largest speed. low, high f8[A]:
    reach of feeds and rapids. cut_low, cut_high f8[A]: of feeds alone.
    """

    axes: tuple[str, ...]
    stretches: Stretches
    causes: tuple[str, ...]
    pass_s: F8
    pass_line: I4
    events: tuple[Event, ...]
    duration_s: float
    tolerance_mm: float
    low: F8
    high: F8


def causes_of(axes: Sequence[str]) -> tuple[str, ...]:
    """What can limit the speed, in the order of ``Stretches.cause``."""
    velocity, acceleration = (f"{axis} velocity" for axis in axes), (f"{axis} acceleration" for axis in axes)
    return ("at rest", "programmed feed", *velocity, *acceleration, "jerk share of the tolerance", "path ahead")


def path_columns(
    parts: Iterable[tuple[float, PathTrajectory | FilteredTrajectory]], limits: Limits, most: int, expected_s: float
) -> PathColumns:
    """Columns of a plan that comes in parts (time of its beginning, trajectory), at most ``most`` samples.

    expected_s: about how long it all takes, for the finest sampling of curves.
    """
    builder = _Builder(limits, most, max(FINEST_STEP_S, expected_s / SAMPLES_WANTED))
    end_s, axes = 0.0, limits.axes
    for begin_s, trajectory in parts:
        builder.add(begin_s, trajectory)
        end_s = begin_s + trajectory.duration_s
    stretches = builder.finish()
    pass_s, pass_line = builder.passes()
    return PathColumns(
        axes, stretches, causes_of(axes), pass_s, pass_line, tuple(builder.events), end_s, builder.tolerance_mm,
        stretches.q.min(axis=0), stretches.q.max(axis=0),
    )  # fmt: skip


class _Builder:
    """Collects parts; thins everything again with twice the tolerance whenever there are too many samples."""

    def __init__(self, limits: Limits, most: int, step_s: float) -> None:
        self.events: list[Event] = []
        self.tolerance_mm = TOLERANCE_MM
        self._limits, self._most, self._step_s = limits, most, step_s
        self._tolerance_mm_s = TOLERANCE_OF_SPEED * float(np.linalg.norm(limits.velocity))
        self._parts: list[Stretches] = []
        self._count = 0
        self._tool = 0
        self._pass_s: list[F8] = []
        self._pass_line: list[I4] = []

    def add(self, begin_s: float, trajectory: PathTrajectory | FilteredTrajectory) -> None:
        """The next part of the plan."""
        base = trajectory.base if isinstance(trajectory, FilteredTrajectory) else trajectory
        changes = [e for e in trajectory.events if isinstance(e.command, ToolChange)]
        self.events += [Event(e.time_s + begin_s, e.command) for e in trajectory.events]
        self._note_passes(begin_s, base)
        for part in _samples(trajectory, base, self._limits, self._step_s, self._tool, changes):
            shifted = _replace(part, t_s=part.t_s + begin_s)
            self._parts.append(self._thinned(shifted))
            self._count += len(self._parts[-1])
            while self._count > 3 * self._most:
                self._coarser()
        if changes:
            last = changes[-1].command
            self._tool = last.tool if isinstance(last, ToolChange) else self._tool

    def finish(self) -> Stretches:
        """Everything as one, within the limit."""
        whole = self._thinned(joined(self._parts))
        self._parts, self._count = [whole], len(whole)
        while self._count > self._most:
            self._coarser()
        return self._parts[0]

    def passes(self) -> tuple[F8, I4]:
        """When which line begins."""
        pass_s, line = np.concatenate(self._pass_s), np.concatenate(self._pass_line)
        new = np.concatenate([[True], np.diff(line) != 0])
        return pass_s[new], line[new]

    def _note_passes(self, begin_s: float, base: PathTrajectory) -> None:
        line = base.intervals.line[base.pieces.interval]
        new = np.concatenate([[True], np.diff(line) != 0])
        self._pass_s.append(base.begin_s[new] + begin_s)
        self._pass_line.append(line[new].astype(np.int32))

    def _coarser(self) -> None:
        self.tolerance_mm *= 2
        self._tolerance_mm_s *= 1.5
        whole = self._thinned(joined(self._parts))
        self._parts, self._count = [whole], len(whole)

    def _thinned(self, s: Stretches) -> Stretches:
        return thinned(s, self.tolerance_mm, self._tolerance_mm_s)


def thinned(s: Stretches, tolerance_mm: float, tolerance_mm_s: float) -> Stretches:
    """Fewer samples within the tolerances; of joined stretches the largest acceleration and longest cause stay."""
    from groupstart.report.thin_kernel import thin

    if len(s) < 3:
        return s
    feed = s.feed_mm_s.view(np.int32).astype(np.int64)
    key = (feed << 16) ^ (s.tool.astype(np.int64) << 4) ^ s.kind
    speed = np.linalg.norm(s.v, axis=1)
    kept = thin(s.t_s, np.ascontiguousarray(s.q), speed, key, tolerance_mm, tolerance_mm_s)
    if len(kept) == len(s):
        return s
    first = kept[:-1]
    return Stretches(
        s.t_s[kept], s.q[kept], s.v[kept], s.feed_mm_s[first],
        np.maximum.reduceat(s.accel_mm_s2, first), np.maximum.reduceat(s.jerk_mm_s3, first),
        s.line[first], s.tool[first], s.kind[first], _longest_cause(s, first),
    )  # fmt: skip


def joined(parts: Sequence[Stretches]) -> Stretches:
    """One of parts that follow each other: the first sample of each is the last of the one before."""
    if len(parts) == 1:
        return parts[0]
    columns = {name: np.concatenate([*(getattr(p, name)[:-1] for p in parts[:-1]), getattr(parts[-1], name)])
               for name in _SAMPLES}  # fmt: skip
    columns |= {name: np.concatenate([getattr(p, name) for p in parts]) for name in _BETWEEN}
    return Stretches(**columns)


def _replace(s: Stretches, **new: F8) -> Stretches:
    return Stretches(**{f.name: new.get(f.name, getattr(s, f.name)) for f in fields(Stretches)})


def _longest_cause(s: Stretches, first: npt.NDArray[np.int64]) -> U1:
    span = np.diff(s.t_s)
    best, cause = np.full(len(first), -1.0), np.zeros(len(first), np.uint8)
    for value in np.unique(s.cause):
        total = np.add.reduceat(np.where(s.cause == value, span, 0.0), first)
        more = total > best
        best[more], cause[more] = total[more], value
    return cause


def _samples(
    trajectory: PathTrajectory | FilteredTrajectory,
    base: PathTrajectory,
    limits: Limits,
    step_s: float,
    tool: int,
    changes: Sequence[Event],
) -> Iterator[Stretches]:
    """The samples of a part, chunk by chunk, each chunk beginning with the last sample of the one before."""
    t_all = sample_times(trajectory, step_s)
    change_s = np.array([e.time_s for e in changes])
    tools = np.array([tool, *(e.command.tool for e in changes if isinstance(e.command, ToolChange))], np.int32)
    for first in range(0, max(len(t_all) - 1, 1), CHUNK):
        t = t_all[first : first + CHUNK + 1]
        if len(t) < 2:
            t = np.array([t[0], t[0]])
        middle = 0.5 * (t[:-1] + t[1:])
        accel = np.linalg.norm(trajectory.a(middle), axis=1)
        jerk = np.zeros(len(middle))
        if isinstance(trajectory, FilteredTrajectory):
            jerk = np.linalg.norm(trajectory.j(middle), axis=1)
        kind, feed, line, cause = _causes(base, limits, middle, trajectory)
        yield Stretches(
            t, trajectory.q(t), trajectory.v(t), feed, accel.astype(np.float32), jerk.astype(np.float32), line,
            tools[np.searchsorted(change_s, middle, side="right")], kind, cause,
        )  # fmt: skip


def _causes(
    base: PathTrajectory, limits: Limits, t: F8, trajectory: PathTrajectory | FilteredTrajectory
) -> tuple[U1, npt.NDArray[np.float32], I4, U1]:
    """Kind, programmed feed, line and limiting cause at each time."""
    late = t - trajectory.tau_s / 2 if isinstance(trajectory, FilteredTrajectory) else t
    i, _, speed, accel = base.locate(np.maximum(late, 0.0))
    p, axes = base.intervals, len(limits.axes)
    v, a = np.abs(base.v(late)), np.abs(base.a(late))
    rest, rapid = (speed == 0) & (accel == 0), np.isinf(p.feed_mm_s[i])
    cause = np.full(len(t), 2 + 2 * axes + 1, np.uint8)
    if p.bound_mm_s is not None:
        cause[speed >= NEAR_LIMIT * p.bound_mm_s[i]] = 2 + 2 * axes
    for k in range(axes):
        cause[a[:, k] >= NEAR_LIMIT * limits.acceleration[k]] = 2 + axes + k
    for k in range(axes):
        cause[v[:, k] >= NEAR_LIMIT * limits.velocity[k]] = 2 + k
    cause[speed >= NEAR_LIMIT * p.feed_mm_s[i]] = 1
    cause[rest] = 0
    kind = np.where(rest, REST, np.where(rapid, RAPID, FEED)).astype(np.uint8)
    feed = np.where(rapid | rest, 0.0, p.feed_mm_s[i]).astype(np.float32)
    return kind, feed, p.line[i].astype(np.int32), cause
