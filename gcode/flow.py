"""The flow of control: which line runs next. O-words, M98 and M99, calls into other files, and their bounds.

The stack holds one ``Call`` for each open subprogram. Parameters 1 to 30 belong to the call level of an O-word
subprogram (M98 shares them), named local parameters to every level.
"""

from __future__ import annotations

from dataclasses import field

from gcode.block import Block, Line, Statement
from gcode.errors import GcodeError
from gcode.expressions import Value, evaluate, whole
from gcode.library import Library
from gcode.machine import Context, Machine
from gcode.parameters import LOCAL_COUNT, MACRO_LOCALS
from gcode.program import Program
from gcode.records import dataclass

MAX_CALLS = 50
"""Deepest nesting of calls (LinuxCNC: 10)."""


@dataclass(slots=True)
class Call:
    """One open call: where to return, how it was called and what to put back."""

    program: Program
    back: int
    name: str
    style: str
    line: int
    locals: dict[int, float]
    repeats: dict[int, int]
    turns_left: int = 0
    start: int = 0


@dataclass(slots=True)
class Flow:
    """Where execution is: ``program`` and ``index`` (the next line), and the open calls."""

    machine: Machine
    program: Program
    library: Library
    index: int = 0
    main: Program = field(init=False)
    calls: list[Call] = field(default_factory=list)
    repeats: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.main = self.program

    def statement(self, statement: Statement) -> None:
        """Executes the O-word on the line before ``index``. Raises ``GcodeError``."""
        here = self.index - 1
        step = _STEPS.get(statement.keyword)
        if step is not None and here not in self.program.broken:
            step(self, here, statement)

    def test(self, statement: Statement) -> float:
        """The value of the statement's first argument."""
        return evaluate(statement.arguments[0], self.machine.parameters)

    def call_stack(self) -> tuple[str, ...]:
        """The open calls as text, innermost first."""
        return tuple(f"in O{call.name}, called on line {call.line}" for call in reversed(self.calls))

    def enter(self, name: str, style: str, arguments: dict[int, float], turns: int = 1) -> None:
        """Goes to subprogram ``name``; the line before ``index`` is the caller."""
        if len(self.calls) >= MAX_CALLS:
            raise GcodeError(
                "GC084", f"more than {MAX_CALLS} calls inside each other", "a subprogram calls itself for ever"
            )
        program, start = self._find_sequence(name) if style == "m97" else self._find(name)
        values = self.machine.parameters.values
        count = {"call": LOCAL_COUNT, "g65": MACRO_LOCALS}.get(style, 0)
        saved = {number: values[number] for number in range(1, count + 1) if number in values}
        call = Call(self.program, self.index, name, style, self.index, saved, self.repeats, turns - 1, start)
        self.calls.append(call)
        self.machine.parameters.frames.append({})
        self.machine.contexts.append(Context())
        for number in range(1, count + 1):
            values.pop(number, None)
        values.update(arguments)
        self.repeats = {}
        self.program, self.index = program, start

    def _find(self, name: str) -> tuple[Program, int]:
        program = self.program
        if name in program.subs:
            start = program.subs[name].start
            if program is not self.main and self.calls and start > self.index:
                hint = f"in a file of subprograms O{name} must stand before the one that calls it"
                raise GcodeError("GC085", f"subprogram O{name} is not yet defined", hint)
            return program, start + 1
        if name in program.labels:
            return program, program.labels[name] + 1
        main = self.main
        if name in main.subs:
            return main, main.subs[name].start + 1
        other = self.library.load(name)
        if other is not None:
            if name in other.subs:
                return other, other.subs[name].start + 1
            return other, other.first
        known = sorted({*program.subs, *main.subs})
        hint = f"defined here: {' '.join('O' + n for n in known[:8])}" if known else "define it with 'sub' and 'endsub'"
        raise GcodeError("GC085", f"subprogram O{name} is not defined", f"{hint}; or give its folder with --include")

    def leave(self, value: float | None) -> None:
        """Returns from the innermost call."""
        call = self.calls[-1]
        parameters = self.machine.parameters
        if call.turns_left > 0:
            call.turns_left -= 1
            self.repeats = {}
            parameters.frames[-1] = {}
            self.index = call.start
            return
        self.calls.pop()
        parameters.frames.pop()
        count = {"call": LOCAL_COUNT, "g65": MACRO_LOCALS}.get(call.style, 0)
        for number in range(1, count + 1):
            parameters.values.pop(number, None)
        parameters.values.update(call.locals)
        self.program, self.index, self.repeats = call.program, call.back, call.repeats
        if call.style == "call":
            parameters.returned = value
        context = self.machine.contexts.pop()
        if context.restore:
            from gcode.saved import SavedModes, restore_modes

            if isinstance(context.modes, SavedModes):
                restore_modes(self.machine, context.modes)

    def m98(self, block: Block) -> None:
        """M98 P (subprogram) L (times)."""
        if "p" not in block.words:
            raise GcodeError("GC025", "M98 without P", "P is the number of the subprogram", "M98")
        number = block.whole("p")
        turns = block.whole("l") if "l" in block.words else 1
        if turns > 0:
            self.enter(str(number), "m98", {}, turns)

    def m97(self, block: Block) -> None:
        """M97 P: calls the lines from N number to M99 in the same file (Haas)."""
        if "p" not in block.words:
            raise GcodeError("GC025", "M97 without P", "P is the N number of the subprogram", "M97")
        turns = block.whole("l") if "l" in block.words else 1
        if turns > 0:
            self.enter(str(block.whole("p")), "m97", {}, turns)

    def g65(self, words: dict[str, float]) -> None:
        """G65 P (program) L (times) and arguments by letter."""
        if "p" not in words:
            raise GcodeError("GC025", "G65 without P", "P is the number of the macro program", "g")
        from gcode.macrob import ARGUMENTS

        turns = int(words.get("l", 1.0))
        arguments = {ARGUMENTS[letter]: value for letter, value in words.items() if letter in ARGUMENTS}
        if turns > 0:
            self.enter(str(int(words["p"])), "g65", arguments, turns)

    def goto(self, target: Value, span: tuple[int, int]) -> None:
        """GOTO n: the next line is the one with N n."""
        number = whole(evaluate(target, self.machine.parameters), "the target of GOTO")
        try:
            _, self.index = self._find_sequence(str(number))
        except GcodeError as error:
            raise error.placed(span) from None

    def _find_sequence(self, number: str) -> tuple[Program, int]:
        index = self.program.sequences.get(number)
        if index is None:
            raise GcodeError("GC085", f"there is no line N{number}", "the target of a jump is the N word of a line")
        return self.program, index

    def m99(self) -> bool:
        """M99: returns from a call; False in the main program, where it ends it."""
        if not self.calls:
            return False
        if self.calls[-1].style == "call":
            raise GcodeError("GC086", "M99 in a subprogram called by CALL", "end it with ENDSUB", "M99")
        self.leave(None)
        return True


def _if(flow: Flow, here: int, statement: Statement) -> None:
    if flow.test(statement) != 0.0:
        return
    construct = flow.program.at[here]
    for branch in construct.branches:
        line = flow.program.line(branch)
        assert line is not None
        assert line.statement is not None
        if line.statement.keyword == "else" or flow.test(line.statement) != 0.0:
            flow.index = branch + 1
            return
    flow.index = construct.end + 1


def _past_branches(flow: Flow, here: int, _statement: Statement) -> None:
    flow.index = flow.program.at[here].end + 1


def _while(flow: Flow, here: int, statement: Statement) -> None:
    construct = flow.program.at[here]
    if construct.kind == "do":
        if flow.test(statement) != 0.0:
            flow.index = construct.start + 1
    elif flow.test(statement) == 0.0:
        flow.index = construct.end + 1


def _endwhile(flow: Flow, here: int, _statement: Statement) -> None:
    flow.index = flow.program.at[here].start


def _repeat(flow: Flow, here: int, statement: Statement) -> None:
    count = flow.test(statement)
    times = int(count + 0.5) if count > 0.0 else 0
    if times < 1:
        flow.index = flow.program.at[here].end + 1
    else:
        flow.repeats[here] = times - 1


def _endrepeat(flow: Flow, here: int, _statement: Statement) -> None:
    start = flow.program.at[here].start
    left = flow.repeats.get(start, 0)
    if left > 0:
        flow.repeats[start] = left - 1
        flow.index = start + 1


def _break(flow: Flow, here: int, _statement: Statement) -> None:
    flow.index = flow.program.at[here].end + 1


def _continue(flow: Flow, here: int, _statement: Statement) -> None:
    flow.index = flow.program.at[here].end


def _sub(flow: Flow, here: int, _statement: Statement) -> None:
    flow.index = flow.program.at[here].end + 1


def _call(flow: Flow, _here: int, statement: Statement) -> None:
    parameters = flow.machine.parameters
    if len(statement.arguments) > LOCAL_COUNT:
        raise GcodeError(
            "GC087", f"more than {LOCAL_COUNT} arguments", "pass the others in #31 and above", statement.span
        )
    arguments = {number: evaluate(argument, parameters) for number, argument in enumerate(statement.arguments, 1)}
    for number in range(len(arguments) + 1, LOCAL_COUNT + 1):
        arguments[number] = 0.0
    name = statement.label
    if statement.value is not None:
        name = str(round(evaluate(statement.value, parameters)))
    try:
        flow.enter(name, "call", arguments)
    except GcodeError as error:
        raise error.placed(statement.span) from None


def _return(flow: Flow, _here: int, statement: Statement) -> None:
    if not flow.calls:
        return
    if flow.calls[-1].style == "m98":
        raise GcodeError(
            "GC086", f"{statement.keyword.upper()} in a subprogram called by M98", "end it with M99", statement.span
        )
    flow.leave(flow.test(statement) if statement.arguments else None)


def _goto(flow: Flow, _here: int, statement: Statement) -> None:
    flow.goto(statement.arguments[0], statement.span)


def _ifgoto(flow: Flow, _here: int, statement: Statement) -> None:
    if flow.test(statement) != 0.0:
        flow.goto(statement.arguments[1], statement.span)


def _macro_while(flow: Flow, here: int, statement: Statement) -> None:
    if flow.test(statement) == 0.0:
        flow.index = flow.program.at[here].end + 1


_STEPS = {
    "goto": _goto,
    "ifgoto": _ifgoto,
    "mwhile": _macro_while,
    "mend": _endwhile,
    "if": _if,
    "elseif": _past_branches,
    "else": _past_branches,
    "while": _while,
    "endwhile": _endwhile,
    "repeat": _repeat,
    "endrepeat": _endrepeat,
    "break": _break,
    "continue": _continue,
    "sub": _sub,
    "endsub": _return,
    "return": _return,
    "call": _call,
}


def is_call(line: Line) -> int | None:
    """97, 98 or 99 if the line has that M code, so that flow handles it."""
    for word in line.words:
        if word.letter == "m" and word.value in (97.0, 98.0, 99.0):
            assert isinstance(word.value, float)
            return int(word.value)
    return None
