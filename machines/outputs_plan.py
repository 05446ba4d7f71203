"""What a program asks of spindle, coolant and outputs, before anything moves: the rests it needs, and what cannot be.

The plan rests after every change of the spindle's speed for as long as the machine file says that it takes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from gcode.canon import AXES, Command, Coolant, Dwell, MoveBlock, Output, Position, Spindle, Text
from gcode.errors import Diagnostic
from gcode.source import split_lines
from machines.outputs_schema import SpindleTable
from machines.schema import MachineConfig
from machines.spindle import change_s, wanted_rpm
from machines.wiring import nmc_buses
from nmc.budget import BusTiming

REFUSED, UNDRIVEN = "SP001", "SP002"
SURFACE_WARNING = "GC203"


def with_waits(
    commands: Iterable[Command | MoveBlock], config: MachineConfig, start: Position
) -> Iterator[Command | MoveBlock]:
    """The commands with a dwell behind every change of the spindle's speed, and behind what is switched at rest."""
    x_mm, rest_s = start[0], switch_rest_s(config)
    present: Spindle | None = None
    for item in _one_change_a_line(commands):
        yield item
        x_mm = _x_after(item, x_mm)
        seconds = 0.0
        if isinstance(item, Spindle) and config.spindle is not None:
            seconds = wait_s(config.spindle, present, item, x_mm)
            present = item
        elif _switches_at_rest(item, config):
            seconds = rest_s
        if seconds > 0 and isinstance(item, Command):
            yield Dwell(item.line, seconds)


def _one_change_a_line(commands: Iterable[Command | MoveBlock]) -> Iterator[Command | MoveBlock]:
    """Of several spindle commands of one line, such as M4 S1000, the last: the spindle goes there at once."""
    last: Spindle | None = None
    for item in commands:
        if last is not None and not isinstance(item, Text):
            if not (isinstance(item, Spindle) and item.line == last.line):
                yield last
            last = None
        if isinstance(item, Spindle):
            last = item
        else:
            yield item
    if last is not None:
        yield last


def wait_s(table: SpindleTable, present: Spindle | None, command: Spindle, x_mm: float) -> float:
    """How long the plan rests for a command at machine X ``x_mm``; ``present``: the one that holds until then."""
    old_rpm = wanted_rpm(table, present, x_mm) if present is not None else 0.0
    return change_s(table, old_rpm, wanted_rpm(table, command, x_mm))


def switch_rest_s(config: MachineConfig) -> float:
    """How long the plan rests for an output switched at rest, s: four exchanges of the slowest bus, in whole ms."""
    slowest = min(table.baud for table in nmc_buses(config).values())
    return math.ceil(4 * BusTiming.at(slowest).worst_ns(2) / 1e6) / 1e3


def drives_anything(config: MachineConfig) -> bool:
    """Whether the machine has a spindle or outputs of its own."""
    return bool(config.spindle or config.coolant or config.output or config.analog)


def _switches_at_rest(item: Command | MoveBlock, config: MachineConfig) -> bool:
    if isinstance(item, Coolant):
        return config.coolant is not None
    if isinstance(item, Output) and not item.synchronised:
        return str(item.index) in (config.analog if item.analog else config.output)
    return False


def _x_after(item: Command | MoveBlock, x_mm: float) -> float:
    """Machine X behind a command."""
    if isinstance(item, MoveBlock):
        return float(item.end[-1, item.axes.index("X")]) if "X" in item.axes and len(item) else x_mm
    end = getattr(item, "end", None)
    return float(end[AXES.index("X")]) if end is not None else x_mm


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a diagnostic points. letter: the word that is meant, "" for the whole line."""

    line: int
    letter: str
    code: str
    message: str
    hint: str


def output_diagnostics(
    commands: Sequence[Command | MoveBlock], config: MachineConfig, text: str, file: str
) -> list[Diagnostic]:
    """What the machine cannot do of it (errors), and what nothing on this machine answers to (one warning each)."""
    lines = split_lines(text)
    found: list[Diagnostic] = []
    told: set[tuple[int, str]] = set()
    for item in _one_change_a_line(commands):
        if isinstance(item, MoveBlock):
            continue
        for place in _places(item, config):
            once = (0 if place.code == UNDRIVEN else place.line, place.message)
            if once in told:
                continue
            told.add(once)
            severity = "error" if place.code == REFUSED else "warning"
            first, last = _columns(lines[place.line - 1] if 0 < place.line <= len(lines) else "", place.letter)
            found.append(
                Diagnostic(file, place.line, first, last, place.code, severity, place.message, place.hint)  # type: ignore[arg-type]
            )
    return found


def followed(found: Iterable[Diagnostic], config: MachineConfig) -> list[Diagnostic]:
    """Diagnostics without the warning that surface speed needs a machine that follows it, where this one does."""
    return [item for item in found if item.code != SURFACE_WARNING or config.spindle is None]


def _places(command: Command, config: MachineConfig) -> Iterator[_Place]:
    if isinstance(command, Spindle):
        yield from _spindle(command, config.spindle)
    elif isinstance(command, Coolant):
        table = config.coolant
        for name, code, on in (("mist", "M7", command.mist), ("flood", "M8", command.flood)):
            if on and (table is None or getattr(table, name) is None):
                words = f"the machine has no coolant.{name}: {code} switches nothing"
                yield _Place(command.line, "", UNDRIVEN, words, "give it one in [coolant] of the machine file")
    elif isinstance(command, Output):
        yield from _output(command, config)


def _spindle(command: Spindle, table: SpindleTable | None) -> Iterator[_Place]:
    line = command.line
    if table is None:
        if command.direction:
            words = "the machine has no [spindle]: M3 and M4 are left to whoever stands at the machine"
            yield _Place(line, "", UNDRIVEN, words, "give it one in the machine file")
        return
    if command.spelled.startswith("ORIENT_SPINDLE"):
        yield _Place(line, "", REFUSED, "M19: this spindle knows no angle", "stop it with M5")
    if not command.direction:
        return
    if command.direction < 0 and table.drive == "output" and table.reverse is None:
        yield _Place(line, "", REFUSED, "M4: this spindle turns one way only", "spindle.reverse would turn it round")
    if command.surface_mm_s:
        if table.drive == "output" and table.speed is None:
            words = "G96: this spindle has one speed only"
            yield _Place(line, "", REFUSED, words, "spindle.speed would set it; or use G97")
        return
    rpm = abs(command.speed_rpm)
    if rpm and not table.min_rpm <= rpm <= table.max_rpm:
        words = f"S{rpm:g}: the spindle turns at {table.min_rpm:g} to {table.max_rpm:g} rpm"
        yield _Place(line, "S", REFUSED, words, "")


def _output(command: Output, config: MachineConfig) -> Iterator[_Place]:
    section, letter = ("analog", "E") if command.analog else ("output", "P")
    key = str(command.index)
    if key not in getattr(config, section):
        words = f"the machine has no [{section}.{key}]: {letter}{key} switches nothing"
        yield _Place(command.line, letter, UNDRIVEN, words, "give it one in the machine file")
        return
    if not command.analog:
        return
    table = config.analog[key]
    low, high = sorted((table.least, table.greatest))
    if not math.isfinite(command.value) or not low <= command.value <= high:
        words = f"Q{command.value:g}: analog output {key} goes from {low:g} to {high:g}"
        yield _Place(command.line, "Q", REFUSED, words, "")


def _columns(source: str, letter: str) -> tuple[int, int]:
    """Columns of a word in a source line, comments aside; the whole line if it is not written there."""
    bare = re.sub(r"\([^)]*\)|;.*", lambda match: " " * len(match.group()), source)
    word = re.search(rf"{letter}\s*[-+]?[0-9. ]*[0-9.]", bare, re.IGNORECASE) if letter else None
    if word is None:
        stripped = source.strip()
        first = source.find(stripped) + 1 if stripped else 1
        return first, first + max(len(stripped), 1)
    return word.start() + 1, word.end() + 1
