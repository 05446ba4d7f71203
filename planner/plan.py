"""plan(): canonical commands and limits to a time-optimal trajectory within tolerance.

The stages, each a file: moves (columns) -> polygon (vertices and legs) -> intervals (lines and parabolas) -> timing
(toppra or the compiled kernel) -> pieces of constant s'' -> trajectory, with the rests of the program put in between.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gcode import canon
from gcode.canon import Command, MoveBlock
from planner import timing
from planner.errors import PlanError
from planner.intervals import intervals_of
from planner.moves import Mark, MoveReader, Moves
from planner.planfile import save_plan
from planner.polygon import Budget, polygon_of
from planner.report import PlanReport, report_of
from planner.timing import Pieces, Solver, Timing
from planner.trajectory import PathTrajectory
from planner.types import F8, Event, Index, Intervals, Limits


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned program: its trajectory and what is to be said of it."""

    trajectory: PathTrajectory
    limits: Limits
    report: PlanReport

    def save(self, path: str | Path) -> None:
        """Write plan.npz: t_s f8[N] (at most 1 ms apart, and every junction), q f8[N, A], v f8[N, A], line i4[N],
        axes."""
        save_plan(path, self.trajectory)


def plan(
    commands: Iterable[Command | MoveBlock],
    limits: Limits,
    *,
    start: F8,
    solver: Solver = "auto",
    budget: Budget | None = None,
) -> Plan:
    """Plan a whole program.

    start: f8[A], machine position at its beginning. solver: "toppra" (reference), "kernel" (compiled), "auto" by size.
    Raises PlanError with the program's line.
    """
    check_limits(limits, start)
    reader = MoveReader(limits.axes, np.asarray(start, dtype=np.float64), limits.tolerance_mm)
    for item in commands:
        reader.read(item)
    moves, marks = reader.take()
    polygon = polygon_of(moves, limits.axes, budget or Budget()) if len(moves) else None
    if polygon is None or not len(polygon):
        intervals, pieces = _at_rest(moves)
        node = np.zeros(len(moves) + 1, dtype=np.intp)
        solved: timing.Timing | None = None
    else:
        intervals, node_of = intervals_of(polygon)
        node = node_of[polygon.vertex_of]
        solved = timing.solve(intervals, limits, solver)
        pieces = timing.pieces_of(intervals, solved, limits.acceleration)
    pieces, events = _with_rests(pieces, marks, node, intervals)
    trajectory = PathTrajectory(limits.axes, intervals, pieces, tuple(events))
    return Plan(trajectory, limits, report_of(trajectory, limits, solved))


def check_limits(limits: Limits, start: F8) -> None:
    """Raise PlanError where limits or start make no sense."""
    if len(start) != len(limits.axes):
        raise PlanError(0, "", f"start has {len(start)} numbers for {len(limits.axes)} axes")
    for name, values in (("velocity", limits.velocity), ("acceleration", limits.acceleration)):
        for axis, value in zip(limits.axes, values, strict=True):
            if not (np.isfinite(value) and value > 0):
                raise PlanError(0, axis, f"axis {axis}: {name} limit must be positive, not {value}")


def _at_rest(moves: Moves) -> tuple[Intervals, Pieces]:
    """A program without motion: one interval that is never entered."""
    a = len(moves.start)
    flat = np.zeros((1, a))
    stop = np.ones(2, dtype=np.bool_)
    intervals = Intervals(np.ones(1), moves.start[None, :], flat, flat, np.ones(1), np.zeros(1, np.int32), stop)
    zero = np.zeros(1)
    return intervals, Pieces(zero, np.zeros(1, np.int32), zero, zero, zero)


def _with_rests(pieces: Pieces, marks: list[Mark], node: Index, p: Intervals) -> tuple[Pieces, list[Event]]:
    """Put the dwells between the pieces and give every mark its time."""
    time = np.concatenate([[0.0], np.cumsum(pieces.duration_s)])
    at: list[int] = []
    rest: list[tuple[float, int, float]] = []
    events: list[Event] = []
    waited = 0.0
    for mark in marks:
        n = int(node[mark.moves])
        m = int(np.searchsorted(pieces.interval, n, side="left")) if n < len(p) else len(pieces)
        events.append(Event(float(time[m]) + waited, mark.command))
        if isinstance(mark.command, canon.Dwell) and mark.command.seconds > 0:
            i = max(n - 1, 0)
            at.append(m)
            rest.append((mark.command.seconds, i, float(p.length[i]) if n else 0.0))
            waited += mark.command.seconds
    if not at:
        return pieces, events
    seconds, interval, offset = (np.array(c) for c in zip(*rest, strict=True))
    return Pieces(
        np.insert(pieces.duration_s, at, seconds),
        np.insert(pieces.interval, at, interval),
        np.insert(pieces.offset_mm, at, offset),
        np.insert(pieces.speed_mm_s, at, 0.0),
        np.insert(pieces.accel_mm_s2, at, 0.0),
    ), events


__all__ = ["Plan", "PlanError", "Timing", "plan"]
