"""The driver: a program's text goes in, canonical commands and diagnostics come out.

``Run`` executes line after line. A line that is refused is noted and skipped, so that one pass finds all errors of a
file; what follows an error is still checked, with care not to report consequences of what was skipped.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gcode.block import AXIS_LETTERS, Block, Line
from gcode.canon import Command, End
from gcode.errors import Diagnostic, GcodeError
from gcode.execute import execute
from gcode.expressions import evaluate, whole
from gcode.machine import Machine
from gcode.offsets import emit_origin, emit_rotation, emit_shift
from gcode.places import place
from gcode.recovery import meant, recover
from gcode.resolve import resolve
from gcode.scanner import scan_line
from gcode.setup import Setup
from gcode.source import split_lines
from gcode.state import AXIS_INDEX


@dataclass(frozen=True, slots=True)
class Interpretation:
    """What a program means: the commands before the first error, and every diagnostic of the file in order of lines."""

    commands: list[Command]
    diagnostics: list[Diagnostic]

    @property
    def errors(self) -> list[Diagnostic]:
        """The diagnostics that are errors."""
        return [diagnostic for diagnostic in self.diagnostics if diagnostic.severity == "error"]


class Run:
    """One interpretation of one program. ``diagnostics`` grows as lines are executed."""

    def __init__(self, text: str, setup: Setup) -> None:
        self.setup = setup
        self.lines = split_lines(text)
        self.machine = Machine(setup)
        self.diagnostics: list[Diagnostic] = []
        self.failed = False
        self._reported: set[str] = set()
        self._uncertain: set[int] = set()
        self._percent = False

    def commands(self) -> Iterator[Command]:
        """Executes the program; yields its commands, stopping to yield (not to check) at the first error."""
        emit = self.machine.emit
        self._begin()
        yield from emit.take()
        for number, text in enumerate(self.lines, 1):
            self._line(number, text)
            out = emit.take()
            if not self.failed:
                yield from out
            if self.machine.finished or len(self.diagnostics) > self.setup.max_errors:
                break
        else:
            self._missing_end()
        self._missing_percent()
        emit.line = 0
        emit.text("ON_RESET()")
        if not self.failed:
            yield from emit.take()

    def _begin(self) -> None:
        """What the interpreter tells the machine before the first line."""
        emit = self.machine.emit
        emit.frame_change("USE_LENGTH_UNITS(CANON_UNITS_MM)")
        emit_origin(self.machine)
        emit_shift(self.machine)
        emit_rotation(self.machine)
        emit.text("SET_FEED_REFERENCE(CANON_XYZ)")
        emit.text("ON_RESET()")

    def _missing_end(self) -> None:
        number = len(self.lines)
        if not number:
            return
        error = GcodeError("GC201", "the program has no end", "add M2 or M30 as its last line", (0, 1))
        self.report(error, number, self.lines[-1], "warning")

    def _missing_percent(self) -> None:
        """A program that began with % and ended by M2 should have a % behind it."""
        emit = self.machine.emit
        if self._percent and self.machine.finished and not any(t.strip() == "%" for t in self.lines[emit.line - 1 :]):
            emit.line = len(self.lines)
            emit.comment("interpreter: percent sign missing from end of file")

    def _line(self, number: int, text: str) -> None:
        """Reads and executes one line; reports what is wrong with it."""
        machine = self.machine
        stripped = text.strip()
        if not stripped or (stripped == "%" and self._percent_line(number, text)):
            return
        block: Block | None = None
        try:
            line = scan_line(text, number)
            if line.delete in self.setup.block_delete and line.delete:
                return
            if line.statement is not None:
                if line.statement.keyword == "":
                    return
                raise GcodeError(
                    "GC099", f"O-word {line.statement.keyword.upper()} is not supported", "", line.statement.span
                )
            if not line.words and not line.assignments and line.comment is None:
                return
            block = resolve(line, machine.parameters)
            self._assign(line)
            if len(text) > 255:
                raise GcodeError("GC017", f"a line of {len(text)} characters", "at most 255: split it", (255, 256))
            execute(machine, block)
            self._settled(block)
        except GcodeError as error:
            self.report(error, number, text)
            self._recover(block, number, text, error)
        for warning in machine.warnings:
            self.report(warning, number, text, "warning")
        machine.warnings.clear()

    def _percent_line(self, number: int, text: str) -> bool:
        """A line that is only ``%``: the first opens, the next closes the program."""
        first = not any(line.strip() for line in self.lines[: number - 1])
        if first:
            self._percent = True
            return True
        if not self._percent:
            return False
        emit = self.machine.emit
        emit.line = number
        emit.command(End(number, ""))
        self.machine.finished = True
        return True

    def _assign(self, line: Line) -> None:
        """Parameter settings take effect after the whole line was read, before it is executed."""
        parameters = self.machine.parameters
        settings: list[tuple[str | int, float]] = []
        for assignment in line.assignments:
            try:
                target: str | int
                if assignment.name is None:
                    target = whole(evaluate(assignment.index, parameters), "a parameter number")
                    parameters.check_writable(target)
                else:
                    target = assignment.name
                settings.append((target, evaluate(assignment.value, parameters)))
            except GcodeError as error:
                raise error.placed(assignment.span) from None
        for target, value in settings:
            if isinstance(target, int):
                parameters.set_numbered(target, value)
            else:
                parameters.set_named(target, value)

    def _settled(self, block: Block) -> None:
        """A good absolute move makes the axes it names certain again."""
        if self._uncertain and block.motion in {0, 10} and not self.machine.state.incremental:
            self._uncertain -= {AXIS_INDEX[letter] for letter in AXIS_LETTERS & block.words.keys()}

    def _recover(self, block: Block | None, number: int, text: str, error: GcodeError) -> None:
        """After an error: stand where the line meant to go, as far as that is known."""
        self.machine.emit.take()
        if block is None:
            block = meant(self.machine, text, number, error)
        self._uncertain |= recover(self.machine, block, text)
        if block is None and "f" in text.lower():
            self._reported.add("GC040")

    def report(self, error: GcodeError, number: int, text: str, severity: str = "error") -> None:
        """Notes a diagnostic, unless it is only a consequence of an earlier one."""
        if severity == "error":
            self.failed = True
            if error.code == "GC044" and self._uncertain:
                return
        if error.code in ONCE:
            if error.code in self._reported:
                return
            self._reported.add(error.code)
        self.diagnostics.append(place(error, self.setup.file, number, text, severity))


ONCE = frozenset({"GC040", "GC202", "GC203", "GC204", "GC205", "GC206"})
"""Reported once a file: the cure of the first is the cure of all."""


def interpret(text: str, setup: Setup | None = None) -> Interpretation:
    """Interprets a program. Never raises for what the text contains: the diagnostics say it."""
    run = Run(text, setup or Setup())
    commands = list(run.commands())
    return Interpretation(commands, sorted(run.diagnostics, key=lambda d: (d.line, d.column)))
