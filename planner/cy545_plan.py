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
from planner.cy545_split import Index, Together, split
from planner.jerk import filter_widths_s, within_jerk
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
    stages = split(commands, limits.axes, tuple(by_axis), start)

    def stretch(stage: Together, tau_s: float, solver: Solver) -> Plan:
        kept = within_jerk(shared, tau_s)
        return plan(stage.commands, kept, start=stage.start[common], solver=solver, filter_s=tau_s, travel=travel)

    def duration_s(tau_s: float) -> float:
        found = (stretch(stage, tau_s, "kernel") for stage in stages if isinstance(stage, Together))
        return sum(each.trajectory.duration_s for each in found)

    # one filter for the whole, so that all stretches run empty in the same time
    widths = filter_widths_s(shared)
    tau_s = min(widths, key=duration_s) if len(widths) > 1 else next(iter(widths), 0.0)
    builder = SequenceBuilder(limits.axes, common, start, tau_s)
    reports: list[PlanReport] = []
    for stage in stages:
        if isinstance(stage, Index):
            indexer = by_axis[stage.axis]
            for move in index_moves(indexer, stage):
                builder.index(move, indexer.before_s, max(indexer.after_s, tau_s) + move.duration_s / CRYSTAL_SHARE)
        else:
            planned = stretch(stage, tau_s, solver)
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
        velocity_jump=None if limits.velocity_jump is None else limits.velocity_jump[list(columns)],
    )
