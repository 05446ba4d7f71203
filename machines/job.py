"""A job: a program's text, read, checked against a machine, and planned. All refusals come before any motion.

``read_job`` interprets the whole program and holds it against the machine's axes and travel; every mistake found is a
diagnostic with its place. ``plan_job`` then plans what passed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gcode.canon import AXES, ORIGIN, Command, MoveBlock, Position
from gcode.errors import Diagnostic
from gcode.interp import interpret
from gcode.setup import Setup
from gcode.source import split_lines
from machines.cy545 import cy545_tables
from machines.outputs_plan import drives_anything, followed, output_diagnostics, with_waits
from machines.questions import question_diagnostics
from machines.schema import MachineConfig
from machines.travel import Excess, Travel, bounds, check_travel, offset_that_fits
from machines.usercommands import numbers
from machines.wiring import indexers, planned_axes, planner_limits, travel
from planner.cy545_plan import plan_indexed
from planner.cy545_split import refusals
from planner.errors import PlanError
from planner.plan import Plan, plan
from planner.reader import needs_encoder
from planner.timing import Solver

BEYOND_TRAVEL = "TR001"


@dataclass(frozen=True, slots=True)
class Job:
    """A program as it will run. ``lines``: its source lines, for carets under diagnostics."""

    name: str
    text: str
    commands: Sequence[Command | MoveBlock]
    diagnostics: tuple[Diagnostic, ...]
    start: Position = ORIGIN
    dialect: tuple[str, str] = ("linuxcnc", "")
    """How it was read, and why."""

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The diagnostics that forbid running it."""
        return tuple(item for item in self.diagnostics if item.severity == "error")


def read_job(text: str, setup: Setup, config: MachineConfig | None = None) -> Job:
    """Interpret a program; with a machine also refuse foreign axes and moves beyond its travel."""
    if config is not None:
        setup = replace(setup, axes="".join(planned_axes(config)), user_commands=numbers(config.user_command))
    result = interpret(text, setup)
    found = tuple(result.diagnostics)
    commands = tuple(result.commands)
    if config is not None:
        found = tuple(followed(found, config))
    if config is not None and not any(item.severity == "error" for item in found):
        found += tuple(travel_diagnostics(commands, travel(config), text, setup))
        found += tuple(_interpolated(commands, config, text, setup))
        found += tuple(_synchronised(commands, text, setup))
        found += tuple(output_diagnostics(commands, config, text, setup.file))
        simulated = all(bus.port == "sim" for bus in config.bus.values())
        found += tuple(question_diagnostics(commands, text, setup.file, simulated=simulated))
    return Job(setup.file, text, commands, found, setup.start, (result.dialect, result.dialect_reason))


def plan_job(job: Job, config: MachineConfig, solver: Solver = "auto") -> Plan:
    """Plan a job without errors. Raises PlanError with the program's line."""
    limits = planner_limits(config)
    start = np.array([job.start[AXES.index(axis)] for axis in limits.axes])
    alone = indexers(config)
    commands = planned_commands(job, config)
    if alone:
        return plan_indexed(commands, limits, alone, start=start, solver=solver)
    return plan(commands, limits, start=start, solver=solver)


def planned_commands(job: Job, config: MachineConfig) -> Sequence[Command | MoveBlock]:
    """The commands as they are planned: with the rests that spindle and outputs of the machine need."""
    if not drives_anything(config):
        return job.commands
    return list(with_waits(job.commands, config, job.start))


def plan_diagnostic(error: PlanError, job: Job) -> Diagnostic:
    """A refusal of the planner as a diagnostic of the program."""
    line = max(error.line, 1)
    first, last = _columns(job.text, line, error.axis)
    return Diagnostic(job.name, line, first, last, "PL001", "error", error.message, error.hint)


def _interpolated(
    commands: Sequence[Command | MoveBlock], config: MachineConfig, text: str, setup: Setup
) -> list[Diagnostic]:
    """One error for each CY545 axis that a program would interpolate: the first line, and how many moves do."""
    alone = tuple(cy545_tables(config))
    if not alone:
        return []
    axes = planned_axes(config)
    start = np.array([setup.start[AXES.index(axis)] for axis in axes])
    by_axis: dict[str, list[PlanError]] = {}
    for error in refusals(commands, axes, alone, start):
        by_axis.setdefault(error.axis, []).append(error)
    found = []
    for axis, errors in by_axis.items():
        first, last = _columns(text, errors[0].line, axis)
        message = errors[0].message + (f" ({_moves(len(errors))} do)" if len(errors) > 1 else "")
        found.append(Diagnostic(setup.file, errors[0].line, first, last, "PL001", "error", message, errors[0].hint))
    return found


def _synchronised(commands: Sequence[Command | MoveBlock], text: str, setup: Setup) -> list[Diagnostic]:
    """One error for each line whose motion would have to follow the spindle."""
    refused = {error.line: error for item in commands if (error := needs_encoder(item)) is not None}
    return [
        Diagnostic(setup.file, line, *_columns(text, line, ""), "PL001", "error", error.message, error.hint)
        for line, error in refused.items()
    ]


def travel_diagnostics(
    commands: Sequence[Command | MoveBlock], limits: Travel, text: str, setup: Setup
) -> list[Diagnostic]:
    """One error for each axis and side that leaves its travel: first line, count of moves, farthest place."""
    found = check_travel(commands, limits, setup.start)
    if not found:
        return []
    hint = _travel_hint(commands, limits, setup)
    return [_travel_diagnostic(item, limits, text, setup.file, hint) for item in found]


def _travel_diagnostic(item: Excess, limits: Travel, text: str, file: str, hint: str) -> Diagnostic:
    first, last = _columns(text, item.line, item.axis)
    if item.limit is None:
        message = f"the machine has no axis {item.axis} ({_moves(item.moves)})"
        return Diagnostic(file, item.line, first, last, BEYOND_TRAVEL, "error", message)
    least, greatest = limits[item.axis]
    words = f"{item.axis} leaves its travel of {least:g} to {greatest:g} ({_moves(item.moves)}; farthest "
    words += f"{item.axis}{item.farthest:.3f} in line {item.farthest_line})"
    return Diagnostic(file, item.line, first, last, BEYOND_TRAVEL, "error", words, hint)


def _travel_hint(commands: Sequence[Command | MoveBlock], limits: Travel, setup: Setup) -> str:
    shift = offset_that_fits(bounds(commands, setup.start), limits)
    if shift is None:
        return "the program is larger than the machine's travel"
    offset = setup.work_offset or ORIGIN
    wanted = [offset[AXES.index(axis)] + shift.get(axis, 0.0) for axis in "XYZ"]
    return "--work-offset " + ",".join(f"{value:.3f}".rstrip("0").rstrip(".") for value in wanted) + " would fit it"


def _moves(count: int) -> str:
    return f"{count} move" + ("s" if count != 1 else "")


def _columns(text: str, line: int, axis: str) -> tuple[int, int]:
    """Columns of the axis's word in a source line, comments aside; the whole line if it is not written there."""
    lines = split_lines(text)
    source = lines[line - 1] if line <= len(lines) else ""
    bare = re.sub(r"\([^)]*\)|;.*", lambda match: " " * len(match.group()), source)
    word = re.search(rf"{axis}\s*[-+]?[0-9. ]*[0-9.]", bare, re.IGNORECASE) if axis else None
    if word is None:
        stripped = source.strip()
        first = source.find(stripped) + 1 if stripped else 1
        return first, first + max(len(stripped), 1)
    return word.start() + 1, word.end() + 1
