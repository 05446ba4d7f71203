"""A plan that a bus can follow: planned anew with lower accelerations, or speeds, where the estimate asks for it."""

from __future__ import annotations

from dataclasses import dataclass

from machines.busload import HABITS, Load, overload
from machines.job import Job, plan_job
from machines.schema import MachineConfig
from planner.errors import PlanError
from planner.plan import Plan
from planner.timing import Solver

TRIES = 6
AIM = 0.7
"""Share of the limit that is aimed at: an estimate may be too low by a third."""
MARGIN = 0.97
"""A little less than what would just do: a slower plan has its worst moment elsewhere."""
LEAST = 0.02


@dataclass(frozen=True, slots=True)
class Fitted:
    """A plan for a slow bus. load: what is left of it; share: of accelerations or speeds; words: what was done."""

    plan: Plan
    load: Load | None
    share: float
    words: str


def fitted(job: Job, config: MachineConfig, plan: Plan, load: Load, profile: str, simulated: bool) -> Fitted:
    """Plan anew until the estimate is well within ``contour_steps``; the plan as it was where that cannot be reached.

    Stop Here points stand for a turn, so speeds are what counts there; of all else accelerations.
    """
    speeds = HABITS[load.profile].stands
    for aim in (AIM, 1.0):
        share, found = 1.0, plan
        left = overload(config, plan.trajectory, profile, simulated, aim)
        for _ in range(TRIES):
            if left is None or share * left.share < LEAST:
                break
            share *= min(left.share, 1.0) * MARGIN
            try:
                found = plan_job(job, slower(config, share, speeds=speeds), _solver(plan))
            except PlanError:  # as the program stands it can be planned, only not that slowly
                break
            left = overload(config, found.trajectory, profile, simulated, aim)
        if left is None:
            what = "speeds" if speeds else "accelerations"
            times = f"{found.trajectory.duration_s:.1f} s instead of {plan.trajectory.duration_s:.1f} s"
            return Fitted(found, None, share, f"planned with {what} of {100 * share:.0f} % for the bus: {times}")
    return Fitted(plan, load, 1.0, "no lower accelerations or speeds make up for the bus: planned as before")


def _solver(plan: Plan) -> Solver:
    return "kernel" if plan.report.solver == "kernel" else "auto"


def slower(config: MachineConfig, share: float, *, speeds: bool) -> MachineConfig:
    """The machine with this share of the accelerations, or velocities, of the axes that are streamed."""
    key = "max_velocity" if speeds else "max_acceleration"
    axes = {
        name: axis if axis.chip == "cy545" else axis.model_copy(update={key: getattr(axis, key) * share})
        for name, axis in config.axis.items()
    }
    return config.model_copy(update={"axis": axes})
