"""plan(): canonical commands and limits to a time-optimal trajectory within tolerance.

The stages, each a file: reader (columns of moves) -> fold (merge) -> polygon (vertices and legs) -> intervals (lines
and parabolas) -> timing (toppra or the compiled kernel; pieces of constant s'' and rests) -> trajectory -> jerk
filter.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gcode.canon import Command, MoveBlock
from planner.constraints import Constraints, constraints_of
from planner.deviation import Deviation
from planner.errors import PlanError
from planner.jerk import FilteredTrajectory, filter_widths_s, within_jerk
from planner.kinematics import Kinematics
from planner.planfile import save_plan
from planner.polygon import PathRules
from planner.report import PlanReport
from planner.rotary_table import RotaryTable
from planner.survey import survey
from planner.timing import Solver, Timed, schedule, solve
from planner.trajectory import PathTrajectory, path_trajectory
from planner.types import F8, Limits

BATCH_MOVES = 8192
"""moves a batch of the path stage: small enough for the cache, large enough for numpy."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A planned program: its trajectory, the timed path under it, and what is to be said of it.

    setting: what it was planned with, so that it can be timed anew; None where that is not possible.
    """

    trajectory: PathTrajectory | FilteredTrajectory
    timed: Timed
    limits: Limits
    report: PlanReport
    setting: Setting | None = None

    def save(self, path: str | Path) -> None:
        """Write plan.npz: t_s f8[N] (at most 1 ms apart, and every junction), q f8[N, A], v f8[N, A], line i4[N],
        axes."""
        save_plan(path, self.trajectory)


@dataclass(frozen=True, slots=True, eq=False)
class Setting:
    """What all stages are told of the machine: limits, constraints (of joints too), rules of the path stage."""

    limits: Limits
    constraints: Constraints
    rules: PathRules
    start: F8


def setting_of(
    limits: Limits, start: F8, kinematics: Kinematics | RotaryTable | None = None, filter_s: float | None = None
) -> Setting:
    """Check and gather. Raises PlanError.

    filter_s: width of the jerk filter, the jerk limits left aside; None: from the jerk limits, with smaller
    accelerations.
    """
    start = np.asarray(start, dtype=np.float64)
    if len(start) != len(limits.axes):
        raise PlanError(0, "", f"start has {len(start)} numbers for {len(limits.axes)} axes")
    tau = next(iter(filter_widths_s(limits)), 0.0) if filter_s is None else filter_s
    return _setting(within_jerk(limits, tau) if filter_s is None else limits, start, kinematics, tau)


def _setting(limits: Limits, start: F8, kinematics: Kinematics | RotaryTable | None, tau: float) -> Setting:
    table = kinematics if isinstance(kinematics, RotaryTable) else None
    constraints = constraints_of(limits, kinematics if isinstance(kinematics, Kinematics) else None)
    matrix = constraints.matrix(len(limits.axes))
    jump = None if tau > 0 else limits.velocity_jump
    rules = PathRules(
        limits.axes, matrix, constraints.acceleration, limits.tolerance_mm, tau, velocity_jump=jump, table=table
    )
    return Setting(limits, constraints, rules, start)


def plan(
    commands: Iterable[Command | MoveBlock],
    limits: Limits,
    *,
    start: F8,
    solver: Solver = "auto",
    kinematics: Kinematics | RotaryTable | None = None,
    filter_s: float | None = None,
    work_offset: F8 | None = None,
    travel: Mapping[str, tuple[float, float]] | None = None,
    measured: bool = False,
) -> Plan:
    """Plan a whole program.

    start: f8[A], machine position at its beginning. solver: "toppra" (reference), "kernel" (compiled), "auto" by
    size. kinematics: joints with limits of their own, or a rotary table (limits and trajectory are then those of the
    machine's axes, the program that of the work). filter_s: width of the jerk filter, None: from ``limits.jerk``. For
    the report: work_offset f8[A], machine position of the work zero; travel, allowed reach by axis; measured, sample
    the trajectory against the program. Raises PlanError with the program's line.
    """
    tries = filter_widths_s(limits) if filter_s is None else ()
    commands = list(commands) if measured or len(tries) > 1 else commands
    setting = setting_of(limits, start, kinematics, filter_s)
    if len(tries) > 1:
        settings = [_setting(within_jerk(limits, tau), setting.start, kinematics, tau) for tau in tries]
        setting = min(settings, key=lambda s: _duration_s(commands, s))
    timed, deviation, chosen = _timed(commands, setting, solver)
    trajectory = trajectory_of(timed, setting)
    if measured and len(timed.intervals):
        deviation = replace(deviation, measured_mm=_measured(trajectory, commands, setting))
    report = survey(trajectory, timed, limits, setting.constraints, chosen, deviation, work_offset, travel)
    return Plan(trajectory, timed, limits, report, setting)


def _timed(commands: Iterable[Command | MoveBlock], setting: Setting, solver: Solver) -> tuple[Timed, Deviation, str]:
    """The whole path timed, what it uses of the tolerance, and who solved."""
    from planner.paths import join_intervals
    from planner.stages import chunks

    parts, marks, deviation, count = [], [], Deviation(), 0
    for chunk, _ in chunks(commands, setting.start, setting.rules, BATCH_MOVES):
        parts.append(chunk.intervals)
        marks += [replace(m, node=m.node + count) for m in chunk.marks]
        count += len(chunk.intervals)
        deviation = deviation.worst(chunk.deviation)
    intervals = join_intervals(parts)
    x, cap, chosen = solve(intervals, setting.constraints, solver) if count else (np.zeros(1), np.zeros(0), "none")
    return Timed(intervals, x, cap, tuple(marks), setting.rules.tau_s), deviation, chosen


def _duration_s(commands: Iterable[Command | MoveBlock], setting: Setting) -> float:
    timed, _, _ = _timed(commands, setting, "kernel")
    return float(schedule(timed, setting.constraints)[0].duration_s.sum())


def _measured(
    trajectory: PathTrajectory | FilteredTrajectory, commands: Iterable[Command | MoveBlock], setting: Setting
) -> float:
    """Deviation by samples every 0.5 ms, vertices included."""
    from planner.measure import measure
    from planner.reader import MoveReader

    reader = MoveReader(setting.limits.axes, setting.start, setting.limits.tolerance_mm)
    for item in commands:
        reader.read(item)
    found = measure(trajectory, reader.take()[0], setting.limits.velocity, setting.limits.acceleration, 5e-4)
    return max(found.deviation_mm, found.miss_mm)


def trajectory_of(timed: Timed, setting: Setting) -> PathTrajectory | FilteredTrajectory:
    """The trajectory of a timed path, filtered where the setting asks for it."""
    pieces, events = schedule(timed, setting.constraints)
    base = path_trajectory(setting.limits.axes, timed.intervals, pieces, events, setting.start)
    return FilteredTrajectory(base, setting.rules.tau_s) if setting.rules.tau_s > 0 else base


def windows(
    commands: Iterable[Command | MoveBlock],
    limits: Limits,
    *,
    start: F8,
    moves: int = BATCH_MOVES,
    kinematics: Kinematics | RotaryTable | None = None,
    filter_s: float | None = None,
) -> Iterator[Timed]:
    """Plan a stream: timed windows one after the other, each final when it is handed out; memory is bounded.

    moves: about how many moves are read before the next attempt to commit. The windows together are what ``plan``
    makes of the same commands. Raises PlanError.
    """
    from planner.stages import TimingStage, chunks

    setting = setting_of(limits, start, kinematics, filter_s)
    stage = TimingStage(setting.constraints, setting.rules.tau_s)
    for chunk, last in chunks(commands, setting.start, setting.rules, moves):
        window = stage.push(chunk, last)
        if window is not None:
            yield window
