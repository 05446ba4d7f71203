"""The plan report of a machine with CY545 axes: those of the common stretches together, and the index moves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from nmc.chips.cy545 import ramp_entry_ns
from planner.cy545 import Indexer
from planner.cy545_sequence import IndexMove, Stage
from planner.deviation import Deviation
from planner.quantize import NS_PER_S
from planner.report import AxisReport, PlanReport
from planner.types import Limits, Trajectory


def report_of_sequence(
    trajectory: Trajectory,
    stages: Sequence[Stage],
    reports: Sequence[PlanReport],
    limits: Limits,
    indexers: Mapping[str, Indexer],
) -> PlanReport:
    """One report; ``notes`` tell of the index moves, and of a rate table that is not the manual's."""
    total = _sum(reports)
    moves = [stage.index for stage in stages if stage.index is not None]
    axes: dict[str, AxisReport] = {}
    start = trajectory.q(np.zeros(1))[0]
    for k, axis in enumerate(limits.axes):
        if axis in indexers:
            axes[axis] = _index_axis(indexers[axis], [m for m in moves if m.axis == axis], float(start[k]), limits, k)
        else:
            axes[axis] = _widest([report.axes[axis] for report in reports], float(start[k]), limits, k)
    return replace(
        total,
        duration_s=trajectory.duration_s,
        rapid_s=total.rapid_s + sum(move.duration_s for move in moves),
        axes=axes,
        notes=_notes(moves, indexers),
        tolerance_mm=limits.tolerance_mm,
    )


def _notes(moves: Sequence[IndexMove], indexers: Mapping[str, Indexer]) -> tuple[str, ...]:
    notes = []
    for axis, indexer in indexers.items():
        mine = [move for move in moves if move.axis == axis]
        if mine:
            time_s = sum(move.duration_s for move in mine)
            rests_s = len(mine) * (indexer.before_s + indexer.after_s)
            words = f"{axis}: {len(mine)} index moves in {time_s:.2f} s, all else at rest"
            notes.append(f"{words}; {rests_s:.2f} s more for commands and confirmations")
        if indexer.rates.stand_in:
            words = f"rate table {indexer.rates.source} is a stand-in, not the manual's chapter 17: "
            notes.append(f"{axis}: {words}times and speeds of a real CY545 will differ")
    return tuple(notes)


def _index_axis(indexer: Indexer, moves: Sequence[IndexMove], stands: float, limits: Limits, k: int) -> AxisReport:
    """Peaks of the chip's ramps: the fastest rate, and the steepest change from one table entry to the next."""
    scale = abs(indexer.steps_per_unit)
    velocity = acceleration = 0.0
    for move in moves:
        fastest = NS_PER_S / int(move.profile.period_ns.min())
        velocity = max(velocity, fastest / scale)
        rates = [indexer.rate_hz(index) for index in range(move.settings.first, move.settings.rate + 1)]
        used = np.array([rate for rate in rates if rate <= fastest * (1 + 1e-6)])
        entry_s = ramp_entry_ns(move.settings.slope, indexer.crystal_mhz) / NS_PER_S
        acceleration = max(acceleration, float(np.diff(used).max(initial=0.0)) / entry_s / scale)
    reach = [stands, *(move.end_steps / move.steps_per_unit for move in moves)]
    least, greatest = min(reach), max(reach)
    return AxisReport(
        least,
        greatest,
        velocity,
        acceleration,
        float(limits.velocity[k]),
        float(limits.acceleration[k]),
        work_least=least,
        work_greatest=greatest,
    )


def _widest(found: Sequence[AxisReport], stands: float, limits: Limits, k: int) -> AxisReport:
    """An axis over all stretches."""
    if not found:
        return AxisReport(stands, stands, 0.0, 0.0, float(limits.velocity[k]), float(limits.acceleration[k]))
    jerks = [axis.jerk for axis in found if axis.jerk is not None]
    return replace(
        found[0],
        least=min(axis.least for axis in found),
        greatest=max(axis.greatest for axis in found),
        velocity=max(axis.velocity for axis in found),
        acceleration=max(axis.acceleration for axis in found),
        jerk=max(jerks) if jerks else None,
        acceleration_limit=float(limits.acceleration[k]),
        work_least=min(axis.work_least for axis in found),
        work_greatest=max(axis.work_greatest for axis in found),
    )


def _sum(reports: Sequence[PlanReport]) -> PlanReport:
    """Times and counts added up, deviations and jumps the worst, places one after the other."""
    deviation = Deviation()
    limited: dict[str, float] = {}
    jumps: dict[str, float] = {}
    moving_s = sum(report.cutting_s + report.rapid_s for report in reports) or 1.0
    for report in reports:
        deviation = deviation.worst(report.deviation)
        share = (report.cutting_s + report.rapid_s) / moving_s
        for cause, value in report.limited_by.items():
            limited[cause] = limited.get(cause, 0.0) + value * share
        for axis, jump in report.velocity_jumps.items():
            jumps[axis] = max(jumps.get(axis, 0.0), jump)
    slow = sorted((c for report in reports for c in report.slow_corners), key=lambda c: c.speed_mm_s)
    solvers = {report.solver for report in reports if report.solver != "none"}
    return PlanReport(
        duration_s=0.0,
        cutting_s=sum(report.cutting_s for report in reports),
        rapid_s=sum(report.rapid_s for report in reports),
        dwell_s=sum(report.dwell_s for report in reports),
        filter_s=sum(report.filter_s for report in reports),
        tool_changes=sum(report.tool_changes for report in reports),
        waits=sum(report.waits for report in reports),
        intervals=sum(report.intervals for report in reports),
        stops=sum(report.stops for report in reports),
        solver=", ".join(sorted(solvers)) or "none",
        axes={},
        deviation=deviation,
        tolerance_mm=0.0,
        limited_by=limited,
        slow_corners=tuple(slow[:5]),
        soft_limits=tuple(limit for report in reports for limit in report.soft_limits),
        velocity_jumps=jumps,
    )
