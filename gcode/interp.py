"""The driver: a program's text goes in, canonical commands and diagnostics come out.

``Run.events`` is a generator of commands that stops at synch points and goes on with the machine's answer. A line that
is refused is noted and skipped, so that one pass finds all errors of a file; what follows an error is still checked,
with care not to report consequences of what was skipped.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from dataclasses import dataclass

from gcode.block import AXIS_LETTERS, Block, Line
from gcode.canon import Command, End, Position
from gcode.compensation import flush
from gcode.dialects import DIALECTS, guess
from gcode.errors import Diagnostic, GcodeError
from gcode.execute import execute
from gcode.expressions import evaluate, whole
from gcode.flow import Flow, is_call
from gcode.foreigngroups import MACRO
from gcode.library import Library
from gcode.machine import Machine
from gcode.named import ini_value, install
from gcode.offsets import emit_origin, emit_rotation, emit_shift
from gcode.places import place
from gcode.program import Program, has_percent
from gcode.recovery import meant, recover
from gcode.resolve import resolve
from gcode.scanner import scan_line
from gcode.setup import Setup
from gcode.state import AXIS_INDEX
from gcode.synch import Answer, Assumptions, Synch

Event = Command
ONCE = frozenset({"GC040", "GC202", "GC203", "GC204", "GC205", "GC206"})
"""Reported once a file: the cure of the first is the cure of all."""


@dataclass(frozen=True, slots=True)
class Interpretation:
    """What a program means: the commands before the first error, and every diagnostic of the file in order of lines."""

    commands: list[Command]
    diagnostics: list[Diagnostic]
    dialect: str = "linuxcnc"
    dialect_reason: str = ""

    @property
    def errors(self) -> list[Diagnostic]:
        """The diagnostics that are errors."""
        return [diagnostic for diagnostic in self.diagnostics if diagnostic.severity == "error"]


class Run:
    """One interpretation of one program. ``diagnostics`` grows as lines are executed."""

    def __init__(self, text: str, setup: Setup) -> None:
        self.setup = setup
        name, self.dialect_reason = guess(text) if setup.dialect == "auto" else (setup.dialect, "it was asked for")
        self.dialect = DIALECTS[name]
        self.machine = Machine(setup, name)
        self.machine.parameters.vacant = self.dialect.macro_b
        self.main = Program(text, setup.file, self.dialect)
        self.flow = Flow(self.machine, self.main, Library(setup.include, self.dialect), self.main.first)
        self.diagnostics: list[Diagnostic] = []
        self.failed = False
        self._reported: set[tuple[str, ...]] = set()
        self._uncertain: set[int] = set()
        self._steps = 0
        self._modal_macro: dict[str, float] | None = None
        self.machine.run_text = self._run_text
        self.machine.profile = self._profile
        self.machine.parameters.foreign = lambda name: ini_value(setup.ini, name)
        install(self.machine, lambda: float(self.flow.index), lambda: float(len(self.flow.calls)))

    def events(self) -> Generator[Event, Answer | None, None]:
        """Executes the program. Yields commands, and ``Synch`` where an ``Answer`` must be sent back.

        After the first error nothing more is yielded; the rest of the file is only checked.
        """
        machine, emit = self.machine, self.machine.emit
        self._begin()
        if self.dialect.refused:
            self._refuse_dialect()
            return
        if self.setup.dialect == "auto" and self.dialect.name != "linuxcnc":
            self._say_dialect()
        yield from emit.take()
        self._report_structure()
        while not machine.finished and len(self.diagnostics) <= self.setup.max_errors:
            if not self._next():
                break
            out = emit.take()
            if not self.failed:
                yield from out
            synch, machine.synch = machine.synch, None
            if synch is not None:
                answer = None if self.failed else (yield synch)
                machine.answered(synch, answer or Answer())
        flush(machine)
        emit.line = 0
        emit.text("ON_RESET()")
        if not self.failed:
            yield from emit.take()

    def commands(self, assumptions: Assumptions | None = None) -> Iterator[Command]:
        """The commands, with every synch point answered by ``assumptions``."""
        assume = assumptions or Assumptions()
        events = self.events()
        answer: Answer | None = None
        before: Position = self.machine.emit.last
        while True:
            try:
                event = events.send(answer)
            except StopIteration:
                return
            answer = None
            if isinstance(event, Synch):
                answer = assume.answer(event, before)
            else:
                before = self.machine.emit.last
                yield event

    def _begin(self) -> None:
        """What the interpreter tells the machine before the first line."""
        emit = self.machine.emit
        emit.frame_change("USE_LENGTH_UNITS(CANON_UNITS_MM)")
        emit_origin(self.machine)
        emit_shift(self.machine)
        emit_rotation(self.machine)
        emit.text("SET_FEED_REFERENCE(CANON_XYZ)")
        emit.text("ON_RESET()")

    def _refuse_dialect(self) -> None:
        error = GcodeError(
            "GC100", f"not interpreted: {self.dialect.refused}", "post the job for a milling machine", (0, 1)
        )
        if self.main.lines:
            self.report(error, self.main, 0)

    def _say_dialect(self) -> None:
        message = f"read in dialect {self.dialect.name}: {self.dialect_reason}"
        self.report(GcodeError("GC209", message, "choose another with --dialect", (0, 1)), self.main, 0, "warning")

    def _report_structure(self) -> None:
        for fault in self.main.faults:
            self._note(fault.error, self.main, fault.index, "error")

    def _next(self) -> bool:
        """Executes the next line. False at the end of the program."""
        flow = self.flow
        program, index = flow.program, flow.index
        if index >= program.stop:
            return self._end_of_file(program)
        flow.index = index + 1
        self._steps += 1
        if self._steps > self.setup.max_steps:
            error = GcodeError("GC089", f"more than {self.setup.max_steps} lines executed", "a loop never ends")
            self.report(error, program, index)
            return False
        text = program.lines[index]
        block: Block | None = None
        try:
            line = program.line(index)
            if line is not None:
                block = self._execute(line)
        except GcodeError as error:
            self.report(error, program, index)
            self._recover(block, index + 1, text, error)
        except RecursionError:
            self.report(GcodeError("GC037", "an expression is nested too deeply", "split it", (0, 1)), program, index)
        for note in program.notes.pop(index, ()):
            self.report(note, program, index, "warning")
        if self.machine.warnings:
            for warning in self.machine.warnings:
                self.report(warning, program, index, "warning")
            self.machine.warnings.clear()
        if self.machine.finished:
            self._missing_percent()
        return True

    def _execute(self, line: Line) -> Block | None:
        """Executes one line that was read."""
        if line.delete and line.delete in self.setup.block_delete:
            return None
        if line.statement is not None:
            if line.statement.keyword == "ifthen":
                if self.flow.test(line.statement) != 0.0:
                    self._assign(line)
                return None
            self.flow.statement(line.statement)
            return None
        if not line.words and not line.assignments and line.comment is None:
            return None
        machine = self.machine
        block = resolve(line, machine.parameters, self.dialect, machine.warnings)
        code = is_call(line)
        if code == 97 and self.dialect.macro_b:
            self.flow.m97(block)
            return block
        if MACRO in block.g:
            self._macro(block)
            return block
        if code == 98:
            self.flow.m98(block)
            return block
        if code == 99 and self.flow.m99():
            return block
        if line.assignments:
            self._assign(line)
        try:
            execute(machine, block)
        except GcodeError:
            self._block_failed(block)
            raise
        if self._uncertain:
            self._settled(block)
        if self._modal_macro is not None and block.motion in {0, 10, 20, 30}:
            self.flow.g65(self._modal_macro)
        return block

    def _macro(self, block: Block) -> None:
        """G65 calls a macro, G66 calls one after every move, G67 ends that."""
        code = block.g[MACRO]
        if code == 650:
            self.flow.g65(block.words)
        elif code == 660:
            self._modal_macro = dict(block.words)
        else:
            self._modal_macro = None

    def _block_failed(self, block: Block) -> None:
        """A block failed while it was executed: stand where it meant to go."""
        self.machine.emit.take()
        self._uncertain |= recover(self.machine, block, "")

    def _run_text(self, text: str) -> None:
        block = resolve(scan_line(text, self.machine.emit.line), self.machine.parameters)
        execute(self.machine, block)

    def _profile(self, name: str) -> Iterator[Block]:
        """The blocks of subprogram ``name``: its flow and assignments are executed, its motion is not."""
        flow = self.flow
        depth = len(flow.calls)
        flow.enter(name, "call", {})
        while len(flow.calls) > depth:
            program, index = flow.program, flow.index
            if index >= program.stop:
                flow.leave(None)
                continue
            flow.index = index + 1
            line = program.line(index)
            if line is None:
                continue
            if line.statement is not None:
                flow.statement(line.statement)
                continue
            block = resolve(line, self.machine.parameters)
            self._assign(line)
            yield block

    def _end_of_file(self, program: Program) -> bool:
        """Past the last line: returns from a file that was called, or ends the program. False: nothing follows."""
        emit = self.machine.emit
        if self.flow.calls and program is not self.main:
            self.flow.leave(None)
            return True
        if has_percent(program) and program.stop < len(program.lines):
            emit.command(End(program.stop + 1, ""))
            self.machine.finished = True
            return False
        if program.lines:
            last = max((i for i, t in enumerate(program.lines) if t.strip()), default=0)
            self.report(
                GcodeError("GC201", "the program has no end", "add M2 or M30 as its last line", (0, 1)),
                program,
                last,
                "warning",
            )
        return False

    def _missing_percent(self) -> None:
        """A program that began with % and ended by M2 should have a % behind it."""
        emit = self.machine.emit
        if has_percent(self.main) and self.main.stop == len(self.main.lines):
            emit.line = len(self.main.lines)
            emit.comment("interpreter: percent sign missing from end of file")

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
        for (target, value), assignment in zip(settings, line.assignments, strict=True):
            if isinstance(target, int):
                parameters.set_numbered(target, value)
            else:
                try:
                    parameters.set_named(target, value)
                except GcodeError as error:
                    raise error.placed(assignment.span) from None

    def _settled(self, block: Block) -> None:
        """A good absolute move makes the axes it names certain again."""
        if block.motion in {0, 10} and not self.machine.state.incremental:
            self._uncertain -= {AXIS_INDEX[letter] for letter in AXIS_LETTERS & block.words.keys()}

    def _recover(self, block: Block | None, number: int, text: str, error: GcodeError) -> None:
        """After a line that could not be read: stand where it meant to go, as far as that is known."""
        self.machine.emit.take()
        if block is not None:
            return
        guess = meant(self.machine, text, number, error)
        self._uncertain |= recover(self.machine, guess, text)
        if guess is None and "f" in text.lower():
            self._reported.add(("GC040",))

    def report(self, error: GcodeError, program: Program, index: int, severity: str = "error") -> None:
        """Notes a diagnostic, unless it is only a consequence of an earlier one or was reported before."""
        if severity == "error":
            self.failed = True
            if error.code == "GC044" and self._uncertain:
                return
        if error.code in ONCE:
            if (error.code,) in self._reported:
                return
            self._reported.add((error.code,))
        self._note(error, program, index, severity)

    def _note(self, error: GcodeError, program: Program, index: int, severity: str) -> None:
        found = place(error, program.name, index + 1, program.lines[index], severity, self.flow.call_stack())
        key = (found.file, str(found.line), str(found.column), found.code)
        if key not in self._reported:
            self._reported.add(key)
            self.diagnostics.append(found)


def interpret(text: str, setup: Setup | None = None, assumptions: Assumptions | None = None) -> Interpretation:
    """Interprets a program. Never raises for what the text contains: the diagnostics say it."""
    run = Run(text, setup or Setup())
    commands = list(run.commands(assumptions))
    return Interpretation(
        commands,
        sorted(run.diagnostics, key=lambda d: (d.file != run.main.name, d.line, d.column)),
        run.dialect.name,
        run.dialect_reason,
    )
