"""A program on a machine with CY545 axes as one trajectory: common motion and index moves, one after the other.

    common motion | before_s | index move | after_s | common motion | ...
                  `------ all others rest ----------'

The rests hold the commands before an index move and the confirmation after it. An index move is one straight interval
whose pieces have the constant rates of the chip's ramp; the stretches of common motion are planned by themselves and
widened by the axes that stand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from planner.cy545 import RampSettings, StepProfile
from planner.jerk import FilteredTrajectory
from planner.paths import join_intervals, resting
from planner.quantize import NS_PER_S
from planner.timeline import joined, no_pieces, rest_piece
from planner.timing import NodeMark, Pieces, Timed
from planner.trajectory import PathTrajectory, path_trajectory
from planner.types import F8, Event, Intervals


@dataclass(frozen=True, slots=True, eq=False)
class IndexMove:
    """One motion of a CY545. start_steps: the motor's position before it; steps: signed."""

    line: int
    axis: str
    steps_per_unit: float
    start_steps: int
    steps: int
    settings: RampSettings
    profile: StepProfile

    @property
    def end_steps(self) -> int:
        """The motor's position after it."""
        return self.start_steps + self.steps

    @property
    def duration_s(self) -> float:
        """From the first step to the end of the last step's period."""
        return self.profile.duration_ns / NS_PER_S


@dataclass(frozen=True, slots=True)
class Stage:
    """A stretch of the trajectory in which something moves; ``index``: the index move, None of common motion."""

    begin_s: float
    duration_s: float
    index: IndexMove | None = None


@dataclass(frozen=True, eq=False)
class IndexedTrajectory(PathTrajectory):
    """A path trajectory that knows which of its stretches CY545s make by themselves. stages: ascending in time."""

    stages: tuple[Stage, ...] = ()


class SequenceBuilder:
    """Grows stretch by stretch.

    axes: all, A; common: columns of those that are not on CY545s; here: f8[A]; drain_s: width of the jerk filter of
    all stretches, 0 without.
    """

    def __init__(self, axes: tuple[str, ...], common: Sequence[int], here: F8, drain_s: float = 0.0) -> None:
        self.axes = axes
        self.common = np.array(common, dtype=np.intp)
        self.here = here.copy()
        self.end_s = 0.0
        self.drain_s = drain_s
        self.stages: list[Stage] = []
        self._events: list[Event] = []
        self._intervals: list[Intervals] = []
        self._pieces = no_pieces()
        self._timed: list[tuple[F8, F8, list[NodeMark]]] = []

    @property
    def _nodes(self) -> int:
        return sum(len(p) for p in self._intervals)

    def together(self, motion: PathTrajectory | FilteredTrajectory, timed: Timed) -> None:
        """Append a stretch of common motion."""
        base = motion.base if isinstance(motion, FilteredTrajectory) else motion
        self._events += [replace(event, time_s=event.time_s + self.end_s) for event in base.events]
        if base.duration_s <= 0:
            return
        intervals = self._widened(base.intervals)
        shifted = replace(base.pieces, interval=base.pieces.interval + np.int32(self._nodes))
        moves = bool(len(timed.intervals))
        x, cap = (timed.x, timed.cap) if moves else (np.zeros(2), np.zeros(1))
        self._append(intervals, shifted, x, cap, list(timed.marks))
        if moves:
            self.stages.append(Stage(self.end_s, base.duration_s))
        self.end_s += base.duration_s
        self.here[self.common] = motion.q(np.array([motion.duration_s]))[0]

    def index(self, move: IndexMove, before_s: float, after_s: float) -> None:
        """Append an index move with a rest on both sides."""
        column = self.axes.index(move.axis)
        scale = abs(move.steps_per_unit)
        tangent = np.zeros((1, len(self.axes)))
        tangent[0, column] = np.sign(move.steps * move.steps_per_unit)
        start = self.here[None, :].copy()
        start[0, column] = move.start_steps / move.steps_per_unit
        length = np.array([abs(move.steps) / scale])
        line, ends = np.array([move.line], np.int32), np.ones(2, dtype=np.bool_)
        intervals = Intervals(length, start, tangent, tangent, np.array([np.inf]), line, ends)
        steps = move.profile
        speed = NS_PER_S / steps.period_ns / scale
        ramp = Pieces(
            np.diff(steps.begin_ns) / NS_PER_S,
            np.full(len(speed), self._nodes, np.int32),
            steps.begin_steps[:-1] / scale,
            speed,
            np.zeros(len(speed)),
        )
        pieces = joined(rest_piece(before_s, self._nodes, 0.0), ramp)
        pieces = joined(pieces, rest_piece(after_s, self._nodes, float(length[0])))
        self._append(intervals, pieces, np.zeros(2), np.array([speed.max() ** 2]), [])
        self.stages.append(Stage(self.end_s + before_s, move.duration_s, move))
        self.end_s += before_s + move.duration_s + after_s
        self.here[column] = move.end_steps / move.steps_per_unit

    def finished(self) -> tuple[IndexedTrajectory | FilteredTrajectory, Timed]:
        """The trajectory, filtered where its common stretches are, and the timed path under it."""
        none = path_trajectory(self.axes, resting(self.here), no_pieces(), (), self.here)
        intervals = join_intervals(self._intervals) if self._intervals else none.intervals
        pieces = self._pieces if len(self._pieces) else none.pieces
        base = IndexedTrajectory(self.axes, intervals, pieces, tuple(self._events), stages=tuple(self.stages))
        x = np.concatenate([np.concatenate([x[:-1] for x, _, _ in self._timed] or [np.zeros(1)]), [0.0]])
        cap = np.concatenate([cap for _, cap, _ in self._timed] or [np.zeros(1)])
        marks = [mark for _, _, marks in self._timed for mark in marks]
        timed = Timed(intervals, x, cap, tuple(marks), self.drain_s)
        return (FilteredTrajectory(base, self.drain_s) if self.drain_s > 0 else base), timed

    def _append(self, intervals: Intervals, pieces: Pieces, x: F8, cap: F8, marks: list[NodeMark]) -> None:
        moved = [replace(mark, node=mark.node + self._nodes) for mark in marks]
        self._timed.append((x, cap, moved))
        self._intervals.append(intervals)
        self._pieces = joined(self._pieces, pieces)

    def _widened(self, p: Intervals) -> Intervals:
        """Intervals over the common axes as intervals over all."""
        start = np.tile(self.here, (len(p), 1))
        start[:, self.common] = p.start
        tangent_in, tangent_out = np.zeros_like(start), np.zeros_like(start)
        tangent_in[:, self.common], tangent_out[:, self.common] = p.tangent_in, p.tangent_out
        return replace(p, start=start, tangent_in=tangent_in, tangent_out=tangent_out)
