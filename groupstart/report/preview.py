"""The preview page of a program: its planned path before anything has run, even simulated.

Short programs are planned as a whole. Long ones are planned in windows, each thinned to what the picture needs and
forgotten, so that memory does not grow with the program.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import cast

import numpy as np

from gcode.canon import AXES, ORIGIN, Command, Dwell, Feed, MoveBlock, Position
from groupstart.report.compose import compose
from groupstart.report.pathcolumns import PathColumns, path_columns
from groupstart.report.pathpage import MOST_SAMPLES, PageInput, path_blocks, path_facts
from machines.job import Job, plan_job, planned_commands
from machines.load import MachineFile
from machines.wiring import planner_limits
from planner.jerk import FilteredTrajectory
from planner.plan import Plan, setting_of, trajectory_of, windows
from planner.timing import Solver
from planner.trajectory import PathTrajectory

WINDOWED_FROM = 100_000
"""moves from which a program is planned in windows"""
WINDOW_MOVES = 16_384


def preview_page(job: Job, machine: MachineFile, solver: str, zero: Position | None = None) -> str:
    """The page as HTML. Raises PlanError with the program's line."""
    if not in_windows(job, machine):
        columns = columns_of_plan(plan_job(job, machine.config, cast("Solver", solver)))
    else:
        columns = columns_in_windows(job, machine)
    page = PageInput(job, machine, columns, path_facts(columns, job.text), zero or ORIGIN)
    return compose(f"{job.name} – groupstart", path_blocks(page, {"report": False}))


def in_windows(job: Job, machine: MachineFile) -> bool:
    """Whether a job is planned in windows; index moves of a CY545 need the whole program."""
    indexed = any(table.chip == "cy545" for table in machine.config.axis.values())
    return not indexed and moves_of(job.commands) >= WINDOWED_FROM


def columns_of_plan(plan: Plan) -> PathColumns:
    """Columns of a whole plan."""
    return path_columns([(0.0, plan.trajectory)], plan.limits, MOST_SAMPLES, plan.trajectory.duration_s)


def columns_in_windows(job: Job, machine: MachineFile) -> PathColumns:
    """Columns of a program that is planned window by window. Raises PlanError."""
    limits = planner_limits(machine.config)
    return path_columns(window_parts(job, machine), limits, MOST_SAMPLES, seconds_at_least(job.commands))


def window_parts(job: Job, machine: MachineFile) -> Iterator[tuple[float, PathTrajectory | FilteredTrajectory]]:
    """The plan of a job window by window, each with the time at which it begins (before a jerk filter)."""
    limits = planner_limits(machine.config)
    start = np.array([job.start[AXES.index(axis)] for axis in limits.axes])
    setting = setting_of(limits, start)
    begin_s = 0.0
    for timed in windows(planned_commands(job, machine.config), limits, start=start, moves=WINDOW_MOVES):
        trajectory = trajectory_of(timed, setting)
        path = trajectory.base if isinstance(trajectory, FilteredTrajectory) else trajectory
        if path.duration_s > 0:
            yield begin_s, path
            begin_s += path.duration_s


def moves_of(commands: Sequence[Command | MoveBlock]) -> int:
    """Number of moves of a program, about: commands, with the moves in blocks."""
    return sum(len(command) if isinstance(command, MoveBlock) else 1 for command in commands)


def seconds_at_least(commands: Sequence[Command | MoveBlock]) -> float:
    """A program's time if every feed were reached at once: what the finest sampling of its path is chosen by."""
    seconds, here = 0.0, np.array(ORIGIN)
    for command in commands:
        if isinstance(command, MoveBlock) and len(command):
            columns = [AXES.index(axis) for axis in command.axes]
            steps = np.linalg.norm(np.diff(command.end, axis=0, prepend=here[columns][None, :]), axis=1)
            feed = np.where(np.isfinite(command.feed_mm_s) & (command.feed_mm_s > 0), command.feed_mm_s, np.inf)
            seconds += float((steps / feed).sum())
            here[columns] = command.end[-1]
        elif isinstance(command, Feed):
            end = np.array(command.end)
            seconds += float(np.linalg.norm(end - here)) / max(command.feed_mm_s, 1e-9)
            here = end
        elif isinstance(command, Dwell):
            seconds += command.seconds
        elif hasattr(command, "end"):
            here = np.array(command.end)
    return seconds
