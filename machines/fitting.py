"""A plan that a bus can follow: planned anew with lower accelerations, or speeds, where the estimate asks for it."""

from __future__ import annotations

from dataclasses import dataclass

from machines.busload import HABITS, Load, overload
from machines.job import Job, plan_job
from machines.schema import MachineConfig
from planner.errors import PlanError
from planner.plan import Plan
from planner.timing import Solver

TRIES = 10
AIM = 0.7
"""Share of the limit that is aimed at: an estimate may be too low."""
MARGIN = 0.97
"""A little less than what would just do: a slower plan has its worst moment elsewhere."""
LEAST = 0.002
"""Share below which a plan is not made any slower."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """A plan for a slow bus. load: what is left to be told of it; words: what was done.

    words are empty where nothing slower could be planned.
    """

    plan: Plan
    load: Load | None
    words: str


def fitted(job: Job, config: MachineConfig, plan: Plan, load: Load, profile: str, simulated: bool) -> Fitted:
    """Plan anew until the estimate is well within ``contour_steps``, or as slowly as it goes.

    Stop Here points stand for a turn, so speeds are what counts there; of all else accelerations.
    """
    speeds = HABITS[load.profile].stands
    share, found = 1.0, plan
    aim = AIM
    left = overload(config, plan.trajectory, profile, simulated, aim)
    if left is not None and left.share <= 0:  # the floor, which no slowness lowers, is already more than that
        aim, left = 1.0, load
    for _ in range(TRIES):
        wanted = share if left is None else max(share * min(left.share, 1.0) * MARGIN, LEAST)
        if wanted >= share or (left is not None and left.share <= 0):
            break
        try:
            found = plan_job(job, slower(config, wanted, speeds=speeds), _solver(plan))
        except PlanError:  # as the program stands it can be planned, only not that slowly
            break
        share, left = wanted, overload(config, found.trajectory, profile, simulated, aim)
    if share == 1.0:
        return Fitted(plan, load, "")
    what = "speeds" if speeds else "accelerations"
    times = f"{found.trajectory.duration_s:.1f} s instead of {plan.trajectory.duration_s:.1f} s"
    words = f"planned with {what} of {100 * share:.2g} % for the bus: {times}"
    return Fitted(found, overload(config, found.trajectory, profile, simulated), words)


def _solver(plan: Plan) -> Solver:
    return "kernel" if plan.report.solver == "kernel" else "auto"


def slower(config: MachineConfig, share: float, *, speeds: bool) -> MachineConfig:
    """The machine with this share of accelerations and pull-in jumps, or of velocities, of what is streamed."""
    keys = ("max_velocity",) if speeds else ("max_acceleration", "pull_in_velocity")
    axes = dict(config.axis)
    for name, axis in axes.items():
        if axis.chip != "cy545":
            axes[name] = axis.model_copy(update={key: getattr(axis, key) * share for key in keys})
    return config.model_copy(update={"axis": axes})
