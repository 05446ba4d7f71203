"""plan() of a machine with CY545 axes: each stretch of common motion planned as ever, index moves between them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcode.canon import Command, MoveBlock
from nmc.chips.cy545 import CRYSTAL_SHARE, STEPS_MAX
from planner.cy545 import Indexer, choose, profile
from planner.cy545_report import report_of_sequence
from planner.cy545_sequence import IndexMove, SequenceBuilder
from planner.cy545_split import Index, split
from planner.plan import Plan, plan
from planner.quantize import nearest_step
from planner.report import PlanReport
from planner.timing import Solver
from planner.types import F8, Limits


def plan_indexed(
    commands: Iterable[Command | MoveBlock],
    limits: Limits,
    indexers: Sequence[Indexer],
    *,
    start: F8,
    solver: Solver = "auto",
    travel: Mapping[str, tuple[float, float]] | None = None,
) -> Plan:
    """Plan a whole program; arguments as of ``planner.plan.plan``. Raises PlanError with line, axis and the ways out.

    The plan's trajectory is an ``IndexedTrajectory``, or one under the jerk filter.
    """
    by_axis = {indexer.axis: indexer for indexer in indexers}
    start = np.asarray(start, dtype=np.float64)
    common = [k for k, axis in enumerate(limits.axes) if axis not in by_axis]
    shared = _of_axes(limits, common)
    builder = SequenceBuilder(limits.axes, common, start)
    reports: list[PlanReport] = []
    for stage in split(commands, limits.axes, tuple(by_axis), start):
        if isinstance(stage, Index):
            indexer = by_axis[stage.axis]
            for move in index_moves(indexer, stage):
                builder.index(move, indexer.before_s, indexer.after_s + move.duration_s / CRYSTAL_SHARE)
        else:
            planned = plan(stage.commands, shared, start=stage.start[common], solver=solver, travel=travel)
            builder.together(planned.trajectory, planned.timed)
            reports.append(planned.report)
    trajectory, timed = builder.finished()
    return Plan(trajectory, timed, limits, report_of_sequence(trajectory, builder.stages, reports, limits, by_axis))


def index_moves(indexer: Indexer, stage: Index) -> Iterator[IndexMove]:
    """The motions of an index move: several if it is too long for one, none if it is below half a step."""
    scale = indexer.steps_per_unit
    at, end = nearest_step(stage.start, scale), nearest_step(stage.end, scale)
    settings = choose(indexer, stage.line, stage.feed)
    while at != end:
        steps = min(max(end - at, -STEPS_MAX), STEPS_MAX)
        ramp = profile(indexer, settings, abs(steps))
        yield IndexMove(stage.line, stage.axis, scale, at, steps, settings, ramp)
        at += steps


def _of_axes(limits: Limits, columns: Sequence[int]) -> Limits:
    """The limits of some of the axes."""
    return replace(
        limits,
        axes=tuple(limits.axes[k] for k in columns),
        velocity=limits.velocity[list(columns)],
        acceleration=limits.acceleration[list(columns)],
        jerk=None if limits.jerk is None else limits.jerk[list(columns)],
    )
