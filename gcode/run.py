"""One run of a program: executes lines, reports what is wrong, and hands out commands.

``Run.events`` is a generator of commands that stops at synch points and goes on with the machine's answer. A line that
is refused is noted and skipped, so that one pass finds all errors of a file; what follows an error is still checked,
with care not to report consequences of what was skipped.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING

from gcode.assign import assign
from gcode.block import AXIS_LETTERS, Block, Line
from gcode.bounds import begin, end_by_percent, missing_percent, over
from gcode.canon import Command, MoveBlock, Position
from gcode.dialects import DIALECTS, guess
from gcode.errors import GcodeError
from gcode.execute import execute
from gcode.flow import Flow, is_call
from gcode.foreigngroups import MACRO
from gcode.library import Library
from gcode.machine import Machine
from gcode.named import ini_value, install
from gcode.ondemand import flush
from gcode.patience import Patience
from gcode.program import Construct, Program, has_percent
from gcode.reports import Reports
from gcode.resolve import resolve
from gcode.scanner import scan_line
from gcode.setup import Setup
from gcode.state import AXIS_INDEX
from gcode.stream import NeedsStructureError, Stream, load_numpy, plain_line
from gcode.synch import Answer, Assumptions, Synch
from gcode.textsource import Source, TextSource, count_lines, percent_follows

if TYPE_CHECKING:
    from gcode.hotloop import HotLoops

Event = Command | MoveBlock


LINE_COST = 20
"""A line that the interpreter executes in a program with loops counts as much as so many of a compiled one."""


class Run(Reports):
    """One interpretation of one program. ``diagnostics`` grows as lines are executed."""

    def __init__(self, source: Source | str, setup: Setup) -> None:
        super().__init__()
        self.setup = setup
        self.source: Source = TextSource(source) if isinstance(source, str) else source
        automatic = setup.dialect == "auto"
        name, self.dialect_reason = guess(self.source.text()) if automatic else (setup.dialect, "it was asked for")
        self.dialect = DIALECTS[name]
        self.machine = Machine(setup, name)
        self.machine.parameters.vacant = self.dialect.macro_b
        self.flow = Flow(self.machine, Program("", setup.file, self.dialect), Library(setup.include, self.dialect))
        self._line_number = 0
        self._steps = 0
        self._modal_macro: dict[str, float] | None = None
        self._modal_level = 0
        self._hot: HotLoops | None = None
        self._passes = 0
        self._patience = Patience(self.flow)
        self.machine.run_text = self._run_text
        self.machine.profile = self._profile
        self.machine.parameters.foreign = lambda name: ini_value(setup.ini, name)
        install(self.machine, lambda: float(self._line_number), lambda: float(len(self.flow.calls)))

    def events(self) -> Generator[Event, Answer | None, None]:
        """Executes the program. Yields commands, and ``Synch`` where an ``Answer`` must be sent back.

        After the first error nothing more is yielded; the rest of the file is only checked.
        """
        emit = self.machine.emit
        if self.dialect.refused:
            self.at_first_line(
                self.source.text(),
                "GC100",
                f"not interpreted: {self.dialect.refused}",
                "post the job for a milling machine",
            )
            return
        if self.setup.dialect == "auto" and self.dialect.name != "linuxcnc":
            said = f"read in dialect {self.dialect.name}: {self.dialect_reason}"
            self.at_first_line(self.source.text(), "GC209", said, "choose another with --dialect", "warning")
        begin(self.machine)
        yield from emit.take()
        if self.dialect.macro_b:
            yield from self._structured(None)
        else:
            yield from self._streamed()
        self._flush()
        over(self.machine)
        if not self.failed:
            yield from emit.take()

    def _flush(self) -> None:
        """What cutter compensation still holds back at the end."""
        try:
            flush(self.machine)
        except GcodeError as error:
            self.report(error, self.setup.file, self._line_number, "")

    def stream(self, assumptions: Assumptions | None = None) -> Iterator[Event]:
        """Commands and blocks, with every synch point answered by ``assumptions``."""
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

    def commands(self, assumptions: Assumptions | None = None) -> Iterator[Command]:
        """As ``stream``, blocks taken apart."""
        from gcode.expand import expanded

        return expanded(self.stream(assumptions))

    def _streamed(self) -> Generator[Event, Answer | None, None]:
        """A program without O-words, as it is read; changes to the structured way if it has some."""
        machine = self.machine
        stream = Stream(self, self.source)
        try:
            for _ in stream.steps():
                yield from self._handed_out()
                if self._too_much():
                    return
        except NeedsStructureError as found:
            yield from self._structured(found.index)
            return
        if machine.finished and not stream.closed:
            if stream.percent and not percent_follows(self.source):
                missing_percent(self.machine, count_lines(self.source))
        elif stream.is_closed():
            end_by_percent(self.machine, stream.last_number)
        elif stream.last_number:
            self._missing_end(stream.last_number, stream.last_text or "?")
        yield from self._handed_out()

    def _structured(self, start: int | None) -> Generator[Event, Answer | None, None]:
        """A program with O-words: all lines are known, and their structure is checked before the first is executed."""
        flow = self.flow
        flow.main = flow.program = Program(self.source.text(), self.setup.file, self.dialect)
        flow.index = flow.main.first if start is None else start
        for fault in flow.main.faults:
            self._note(fault.error, flow.main.name, fault.index + 1, flow.main.lines[fault.index], "error")
        while not self.machine.finished and not self._too_much():
            if self.failed and not self._patience.lasts():
                return
            construct = self._warm_loop()
            if construct is not None:
                yield from self._run_hot(construct)
                continue
            if not self._next():
                break
            yield from self._handed_out()
        if self.machine.finished and has_percent(flow.main) and flow.main.stop == len(flow.main.lines):
            missing_percent(self.machine, len(flow.main.lines))
        yield from self._handed_out()

    def _warm_loop(self) -> Construct | None:
        """The loop that begins at the next line, if it has run often enough to be compiled."""
        flow = self.flow
        construct = flow.program.at.get(flow.index)
        if (
            construct is None
            or not self.may_run_columns()
            or construct.kind not in {"while", "mwhile"}
            or self._modal_macro is not None
            or construct.start != flow.index
            or construct.end < 0
        ):
            return None
        if self._hot is None:
            self._passes += 1
            if self._passes < 100:
                return None
            load_numpy()
            from gcode.hotloop import HotLoops

            self._hot = HotLoops(self.machine)
        return construct if self._hot.is_warm(flow.program, flow.index) else None

    def _run_hot(self, construct: Construct) -> Generator[Event, Answer | None, None]:
        """Runs a compiled loop; where it gives up, the interpreter goes on from its ``while`` line."""
        hot, flow = self._hot, self.flow
        assert hot is not None
        self._line_number = construct.start + 1
        for lines in hot.run(flow.program, construct):
            self._steps += lines
            yield from self._handed_out()
            if self.failed:
                self._patience.spend(lines // LINE_COST)
            if self._too_much() or self._patience.left <= 0:
                return
        if hot.finished_at >= 0:
            flow.index = hot.finished_at
        elif self._next():
            yield from self._handed_out()

    def _handed_out(self) -> Generator[Event, Answer | None, None]:
        """Yields what the last line gave, and asks the machine if the line waits for it."""
        out = self.machine.emit.take()
        if out and not self.failed:
            yield from out
        synch = self.machine.synch
        if synch is not None:
            self.machine.synch = None
            answer = None if self.failed else (yield synch)
            self.machine.answered(synch, answer or Answer())

    def _too_much(self) -> bool:
        if self._steps > self.setup.max_steps:
            text = f"no end after {self.setup.max_steps} steps"
            program = self.flow.program
            line = program.lines[self._line_number - 1] if self._line_number <= len(program.lines) else ""
            self.report(GcodeError("GC089", text, "a loop never ends"), program.name, self._line_number, line)
            return True
        return len(self.diagnostics) > self.setup.max_errors

    def _next(self) -> bool:
        """Executes the next line of a structured program. False at the end."""
        flow = self.flow
        program, index = flow.program, flow.index
        if index >= program.stop:
            return self._end_of_file(program)
        self.before_line(index + 1, main=program is flow.main)
        flow.index = index + 1
        self._execute_line(index + 1, program.lines[index], program)
        return True

    def before_line(self, number: int, *, main: bool) -> None:
        """Called before every line of a structured program; a hook for those who watch."""

    def may_run_columns(self) -> bool:
        """Whether runs of lines may be executed at once."""
        return True

    def execute_text(self, number: int, text: str) -> None:
        """Reads and executes one line of a stream, and reports what is wrong with it."""
        self._execute_line(number, text, None)

    def _execute_line(self, number: int, text: str, program: Program | None) -> None:
        self._line_number = number
        self._steps += LINE_COST if program is not None else 0
        name = program.name if program is not None else self.setup.file
        notes: tuple[GcodeError, ...] = ()
        block: Block | None = None
        try:
            if program is None:
                line, notes = plain_line(text, number, self.dialect)
            else:
                line = program.line(number - 1)
                notes = program.notes.pop(number - 1, ())
            if line is not None:
                block = self._execute(line)
        except GcodeError as error:
            self.report(error, name, number, text)
            self._recover(block, number, text, error)
        except RecursionError:
            self.report(
                GcodeError("GC037", "an expression is nested too deeply", "split it", (0, 1)), name, number, text
            )
        for note in notes:
            self.report(note, name, number, text, "warning")
        if self.machine.warnings:
            for warning in self.machine.warnings:
                self.report(warning, name, number, text, "warning")
            self.machine.warnings.clear()

    def _execute(self, line: Line) -> Block | None:
        """Executes one line that was read."""
        if line.delete and line.delete in self.setup.block_delete:
            return None
        if line.statement is not None:
            if line.statement.keyword != "ifthen":
                self.flow.statement(line.statement)
            elif self.flow.test(line.statement) != 0.0:
                assign(self.machine.parameters, line)
            return None
        if not line.words and not line.assignments and line.comment is None:
            return None
        machine = self.machine
        block = resolve(line, machine.parameters, self.dialect, machine.warnings)
        if self._is_call(line, block):
            return block
        if line.assignments:
            assign(machine.parameters, line)
        try:
            execute(machine, block)
        except GcodeError:
            from gcode.recovery import recover

            machine.emit.take()
            machine.emit.held = None
            machine.compensation = None
            self._uncertain |= recover(machine, block, "")
            raise
        if self._uncertain and block.motion in {0, 10} and not machine.state.incremental:
            self._uncertain -= {AXIS_INDEX[letter] for letter in AXIS_LETTERS & block.words.keys()}
        at_its_level = len(self.flow.calls) == self._modal_level
        if self._modal_macro is not None and at_its_level and block.motion in {0, 10, 20, 30}:
            self.flow.g65(self._modal_macro)
        return block

    def _is_call(self, line: Line, block: Block) -> bool:
        """Executes M97, M98, M99 and the macro calls G65 to G67; whether the line was one of them."""
        if MACRO in block.g:
            code = block.g[MACRO]
            if code == 650:
                self.flow.g65(block.words)
            else:
                self._modal_macro = dict(block.words) if code == 660 else None
                self._modal_level = len(self.flow.calls)
            return True
        number = is_call(line)
        if number == 97 and self.dialect.macro_b:
            self.flow.m97(block)
        elif number == 98:
            self.flow.m98(block)
        elif number == 99:
            return self.flow.m99()
        else:
            return False
        return True

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
            assign(self.machine.parameters, line)
            yield block

    def _end_of_file(self, program: Program) -> bool:
        """Past the last line: returns from a file that was called, or ends the program. False: nothing follows."""
        if self.flow.calls and program is not self.flow.main:
            self.flow.leave(None)
            return True
        if has_percent(program) and program.stop < len(program.lines):
            end_by_percent(self.machine, program.stop + 1)
            return False
        if program.lines:
            last = max((i for i, t in enumerate(program.lines) if t.strip()), default=0)
            self._missing_end(last + 1, program.lines[last])
        return False

    def _missing_end(self, number: int, text: str) -> None:
        error = GcodeError("GC201", "the program has no end", "add M2 or M30 as its last line", (0, 1))
        self.report(error, self.setup.file, number, text, "warning")

    def _recover(self, block: Block | None, number: int, text: str, error: GcodeError) -> None:
        """After a line that could not be read: stand where it meant to go, as far as that is known."""
        self.machine.emit.take()
        if block is not None:
            return
        from gcode.recovery import meant, recover

        guess_ = meant(self.machine, text, number, error)
        self._uncertain |= recover(self.machine, guess_, text)
        if guess_ is None and "f" in text.lower():
            self._reported.add(("GC040",))
