"""Two programs, or one program on two machines, compared as motion: which moves differ, how far, how much time.

Moves are matched first, whatever their text looks like; then both planned paths are measured against each other,
stretch by stretch between matched places, so that a change in one place is not smeared over the rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from difflib import SequenceMatcher
from typing import Any

import numpy as np

from groupstart.report.measured import Measured
from groupstart.report.movelist import Move, moves_of_program
from machines.job import Job
from planner.jerk import FilteredTrajectory
from planner.plan import Plan
from planner.planfile import sample_times
from planner.types import F8, Trajectory

MOST_MATCHED = 4000
"""moves that are matched one by one; a longer stretch that differs is one change"""
STEP_S, REACH_S = 4e-3, 0.2
AHEAD_MM, LOST_MM = 0.5, 1.0
SHOWN_MOVES = 3


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A planned program. moves: in order; begin_s f8[len(moves) + 1]: when each begins, and the end."""

    job: Job
    trajectory: Trajectory
    moves: list[Move]
    begin_s: F8


@dataclass(frozen=True, slots=True)
class Change:
    """One difference. lines: first and last on each side, None where nothing stands; distance_mm: of the two paths.

    time_s: how much longer the second takes.
    """

    words: str
    lines_a: tuple[int, int] | None
    lines_b: tuple[int, int] | None
    distance_mm: float
    time_s: float


@dataclass(frozen=True, slots=True, eq=False)
class MotionDiff:
    """Two motions compared. same_mm: largest distance where the moves are the same; other: b measured against a."""

    time_a_s: float
    time_b_s: float
    changes: tuple[Change, ...]
    same_mm: float
    other: Measured

    def same(self, tolerance_mm: float, tolerance_s: float) -> bool:
        """Whether both are the same motion within tolerances."""
        return (
            all(change.distance_mm <= tolerance_mm and abs(change.time_s) <= tolerance_s for change in self.changes)
            and self.same_mm <= tolerance_mm
            and abs(self.time_b_s - self.time_a_s) <= tolerance_s
        )

    def as_json(self) -> dict[str, Any]:
        """The fields as plain data."""
        return {
            "time_a_s": self.time_a_s,
            "time_b_s": self.time_b_s,
            "same_moves_um": 1e3 * self.same_mm,
            "changes": [asdict(change) for change in self.changes],
        }


def motion_of(job: Job, plan: Plan) -> Motion:
    """A planned job, its moves with the times at which they begin."""
    moves = moves_of_program(job.commands, plan.trajectory.axes)
    return Motion(job, plan.trajectory, moves, _begins(moves, plan))


def _begins(moves: Sequence[Move], plan: Plan) -> F8:
    """When each move begins. Lines of the plan are a subsequence of those of the moves: merged ones have no time of
    their own and begin with the next that has.
    """
    trajectory = plan.trajectory
    base = trajectory.base if isinstance(trajectory, FilteredTrajectory) else trajectory
    line = base.intervals.line[base.pieces.interval]
    new = np.flatnonzero(np.concatenate([[True], np.diff(line) != 0]))
    begin = np.full(len(moves) + 1, np.nan)
    k = 0
    for piece in new.tolist():
        j = k
        while j < len(moves) and moves[j].line != line[piece]:
            j += 1
        if j < len(moves):
            begin[j] = base.begin_s[piece]
            k = j + 1
    begin[-1] = trajectory.duration_s
    for j in range(len(moves) - 1, -1, -1):
        if np.isnan(begin[j]):
            begin[j] = begin[j + 1]
    if len(moves):
        begin[0] = 0.0
    return begin


def compare_motions(a: Motion, b: Motion) -> MotionDiff:
    """Compare two motions over the same axes."""
    changes: list[Change] = []
    same_mm, parts = 0.0, []
    for kind, a0, a1, b0, b1 in _matched([m.key for m in a.moves], [m.key for m in b.moves]):
        part = _distance(a, b, (a0, a1), (b0, b1))
        parts.append(part)
        distance = float(part.error_um.max(initial=0.0)) * 1e-3
        if kind == "equal":
            same_mm = max(same_mm, distance)
            continue
        time_s = float((b.begin_s[b1] - b.begin_s[b0]) - (a.begin_s[a1] - a.begin_s[a0]))
        words = _words(kind, a, b, (a0, a1), (b0, b1))
        changes.append(Change(words, _lines(a, a0, a1), _lines(b, b0, b1), distance, time_s))
    return MotionDiff(
        a.trajectory.duration_s, b.trajectory.duration_s, tuple(changes), same_mm, _joined(parts, a.trajectory)
    )


def _matched(a: list[tuple[object, ...]], b: list[tuple[object, ...]]) -> Iterator[tuple[str, int, int, int, int]]:
    """Stretches of equal and unlike moves, as ``difflib`` names them, in order."""
    head = 0
    while head < min(len(a), len(b)) and a[head] == b[head]:
        head += 1
    tail = 0
    while tail < min(len(a), len(b)) - head and a[len(a) - 1 - tail] == b[len(b) - 1 - tail]:
        tail += 1
    if head:
        yield "equal", 0, head, 0, head
    middle_a, middle_b = a[head : len(a) - tail], b[head : len(b) - tail]
    if middle_a or middle_b:
        if max(len(middle_a), len(middle_b)) <= MOST_MATCHED:
            matcher = SequenceMatcher(None, middle_a, middle_b, autojunk=False)
            for kind, a0, a1, b0, b1 in matcher.get_opcodes():
                yield kind, head + a0, head + a1, head + b0, head + b1
        else:
            yield "replace", head, len(a) - tail, head, len(b) - tail
    if tail:
        yield "equal", len(a) - tail, len(a), len(b) - tail, len(b)


def _distance(a: Motion, b: Motion, moves_a: tuple[int, int], moves_b: tuple[int, int]) -> Measured:
    """Places of b's stretch against a's stretch; where a has none, against the place where a stands then."""
    from sim.compare_kernel import distances, follow

    t_a = _times(a.trajectory, *(float(a.begin_s[k]) for k in moves_a))
    t_b = _times(b.trajectory, *(float(b.begin_s[k]) for k in moves_b))
    q_a, q_b = np.ascontiguousarray(a.trajectory.q(t_a)), np.ascontiguousarray(b.trajectory.q(t_b))
    step = float(np.linalg.norm(np.diff(q_a, axis=0), axis=1).max(initial=0.0))
    segment = follow(q_b, q_a, 4 * step + AHEAD_MM, LOST_MM)
    reach = int(REACH_S / STEP_S)
    first = np.clip(segment - reach, 0, len(t_a) - 2)
    last = np.clip(segment + reach, 1, len(t_a) - 1)
    distance, nearest_s = distances(t_b, q_b, first, last, t_a, q_a)
    planned = np.column_stack([np.interp(nearest_s, t_a, q_a[:, k]) for k in range(q_a.shape[1])])
    lag_ms = 1e3 * ((t_b - t_b[0]) - (nearest_s - t_a[0]))
    return Measured(tuple(a.trajectory.axes), t_b, q_b, planned, nearest_s, 1e3 * distance, lag_ms)


def _times(trajectory: Trajectory, begin_s: float, end_s: float) -> F8:
    """Samples of a stretch of time, its junctions among them; at least two."""
    t = sample_times(trajectory, STEP_S)
    inside = t[(t > begin_s) & (t < end_s)]
    return np.concatenate([[begin_s], inside, [end_s]])


def _joined(parts: list[Measured], trajectory: Trajectory) -> Measured:
    if not parts:
        rest = np.array([0.0, trajectory.duration_s])
        q, zero = trajectory.q(rest), np.zeros(2)
        return Measured(tuple(trajectory.axes), rest, q, q, rest, zero, zero)
    columns = ("t_s", "q", "planned", "nearest_s", "error_um", "lag_ms")
    return Measured(parts[0].axes, *(np.concatenate([getattr(p, name) for p in parts]) for name in columns))


def _lines(motion: Motion, first: int, last: int) -> tuple[int, int] | None:
    return (motion.moves[first].line, motion.moves[last - 1].line) if last > first else None


def _words(kind: str, a: Motion, b: Motion, moves_a: tuple[int, int], moves_b: tuple[int, int]) -> str:
    axes = a.trajectory.axes
    old, new = _told(a, axes, *moves_a), _told(b, axes, *moves_b)
    if kind == "insert":
        return f"only in the second: {new}"
    if kind == "delete":
        return f"only in the first: {old}"
    return f"{old} became {new}"


def _told(motion: Motion, axes: Sequence[str], first: int, last: int) -> str:
    shown = []
    for k in range(first, min(last, first + SHOWN_MOVES)):
        shown.append(motion.moves[k].words(axes, motion.moves[k - 1] if k else None))
    more = last - first - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more > 0 else "")
