"""How long a program takes: by line, operation, tool and kind of motion, from the plan itself.

The machine runs the plan, so the plan's time is the machine's time; nothing here is a rule of thumb. Operations are
the stretches that a program's own comments name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, cast

import numpy as np

from gcode.canon import Command, MoveBlock, Text, ToolChange
from gcode.source import split_lines
from groupstart.report.preview import in_windows, window_parts
from machines.job import Job, plan_job
from machines.load import MachineFile
from planner.jerk import FilteredTrajectory
from planner.timing import Solver
from planner.trajectory import PathTrajectory
from planner.types import F8

COMMENT = "COMMENT("
Part = tuple[float, PathTrajectory | FilteredTrajectory]


@dataclass(frozen=True, slots=True)
class Share:
    """Part of a program's time. line: where it begins (of tools: 0)."""

    name: str
    line: int
    time_s: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """A program's time in s: all of it, and its parts in three ways, each adding up to all of it."""

    file: str
    machine: str
    time_s: float
    cutting_s: float
    rapid_s: float
    rest_s: float
    operations: tuple[Share, ...] = field(default=())
    tools: tuple[Share, ...] = field(default=())

    def as_json(self) -> dict[str, Any]:
        """The fields as plain data."""
        return asdict(self)


def estimate(job: Job, machine: MachineFile, solver: str = "auto") -> Estimate:
    """Time of a checked job. Raises PlanError with the program's line."""
    if not in_windows(job, machine):
        parts: Iterable[Part] = [(0.0, plan_job(job, machine.config, cast("Solver", solver)).trajectory)]
    else:
        parts = window_parts(job, machine)
    last_line = job.text.count("\n") + 2
    by_line, kinds = np.zeros(last_line + 1), np.zeros(3)
    changes: list[tuple[float, int]] = []
    end_s = 0.0
    for begin_s, trajectory in parts:
        base = trajectory.base if isinstance(trajectory, FilteredTrajectory) else trajectory
        _add_times(base, by_line, kinds)
        for event in trajectory.events:
            if isinstance(event.command, ToolChange):
                changes.append((begin_s + event.time_s, event.command.tool))
        end_s = begin_s + trajectory.duration_s
    return Estimate(
        job.name, machine.config.machine.name, end_s, float(kinds[0]), float(kinds[1]), float(kinds[2]),
        _operations(by_line, list(headings(job))), _tools(changes, end_s),
    )  # fmt: skip


def _add_times(base: PathTrajectory, by_line: F8, kinds: F8) -> None:
    """Add the time of every piece to its line and to its kind: cutting, rapid, rest."""
    pieces, p = base.pieces, base.intervals
    np.add.at(by_line, np.clip(p.line[pieces.interval], 0, len(by_line) - 1), pieces.duration_s)
    rest = (pieces.speed_mm_s == 0) & (pieces.accel_mm_s2 == 0)
    rapid = np.isinf(p.feed_mm_s[pieces.interval]) & ~rest
    kinds[0] += pieces.duration_s[~rest & ~rapid].sum()
    kinds[1] += pieces.duration_s[rapid].sum()
    kinds[2] += pieces.duration_s[rest].sum()


def comments(commands: Sequence[Command | MoveBlock]) -> Iterator[tuple[int, str]]:
    """Line and words of every comment of a program."""
    for command in commands:
        if isinstance(command, MoveBlock):
            texts: Iterable[Text] = (text for _, text in command.notes)
        else:
            texts = (command,) if isinstance(command, Text) else ()
        for text in texts:
            if text.function.startswith(COMMENT):
                yield text.line, text.function[len(COMMENT) : -1].strip('"').strip()


def headings(job: Job) -> Iterator[tuple[int, str]]:
    """Line and words of every comment that stands alone on its line: those are what CAM names its operations by."""
    lines = split_lines(job.text)
    for line, words in comments(job.commands):
        source = lines[line - 1] if 0 < line <= len(lines) else ""
        if not re.sub(r"\([^)]*\)?|;.*|^\s*[Nn]\d+|[%/\s]", "", source):
            yield line, words


def _operations(by_line: F8, found: list[tuple[int, str]]) -> tuple[Share, ...]:
    """Time between each comment and the next; comments without motion give their place to the last of them."""
    starts = sorted({line: words for line, words in found if words}.items())
    edges = [0, *(line for line, _ in starts), len(by_line)]
    names = ["", *(words for _, words in starts)]
    shares = []
    for name, first, last in zip(names, edges[:-1], edges[1:], strict=True):
        time_s = float(by_line[first:last].sum())
        if time_s > 0:
            shares.append(Share(name or "(before the first comment)", first, time_s))
    return tuple(shares)


def _tools(changes: list[tuple[float, int]], end_s: float) -> tuple[Share, ...]:
    """Time with each tool in the spindle, in the order of first use."""
    starts = [(0.0, 0), *changes]
    ends = [time_s for time_s, _ in changes] + [end_s]
    total: dict[int, float] = {}
    for (begin_s, tool), until_s in zip(starts, ends, strict=True):
        if until_s > begin_s:
            total[tool] = total.get(tool, 0.0) + until_s - begin_s
    return tuple(Share(f"T{tool}" if tool else "(no tool yet)", 0, time_s) for tool, time_s in total.items())
