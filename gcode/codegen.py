"""Loops of O-words as Python source: assignments, conditions, G0 and G1 with axis words, calls of such subprograms.

The source is a generator function that keeps all parameters in local variables and appends moves to a flat list. It
gives its whole state now and then, so that an error inside (a division by zero, an undefined name) can be repeated by
the complete interpreter from the last such point, which then says what is wrong and where.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

from gcode.block import AXIS_LETTERS, Line, Statement
from gcode.comments import is_active
from gcode.expressions import Binary, Function, NamedParameter, Negative, Parameter, Value
from gcode.program import Construct, Program

AXES = "xyzabcuvw"
MARK_COMMENT, MARK_FEED = -1.0, -2.0
CHECK_EVERY = 2000
GREATEST = 5000
"""Parameters above are windows, offsets and probe results."""

_INFIX = {"+": "({}+{})", "-": "({}-{})", "*": "({}*{})", "/": "({}/{})", "**": "pow_({},{})", "mod": "mod_({},{})"}
_COMPARE = {
    "lt": "{}<{}",
    "gt": "{}>{}",
    "le": "{}<={}",
    "ge": "{}>={}",
    "eq": "abs({}-{})<1e-4",
    "ne": "abs({}-{})>=1e-4",
}
_LOGIC = {"and": "({} and {})", "or": "({} or {})", "xor": "(({}) != ({}))"}
_FUNCTIONS = {
    "sin": "sin({}*pi/180.0)",
    "cos": "cos({}*pi/180.0)",
    "tan": "tan({}*pi/180.0)",
    "asin": "(asin({})*180.0/pi)",
    "acos": "(acos({})*180.0/pi)",
    "sqrt": "sqrt({})",
    "exp": "exp({})",
    "ln": "log({})",
    "abs": "abs({})",
    "fix": "float(floor({}))",
    "fup": "float(ceil({}))",
    "round": "round_({})",
}


class NotCompilableError(Exception):
    """Something in the loop needs the complete interpreter."""


@dataclass(slots=True)
class Names:
    """Variables of the generated source. ``shared``: parameters above 30 and globals; ``own``: of one level."""

    windows: frozenset[str]
    shared: dict[str, str] = field(default_factory=dict)
    own: dict[str, str] = field(default_factory=dict)

    def numbered(self, index: Value) -> str:
        """The variable of ``#index``."""
        if not isinstance(index, float) or index != int(index) or not 1 <= index <= GREATEST:
            raise NotCompilableError
        number = int(index)
        store = self.own if number <= 30 else self.shared
        return store.setdefault(f"#{number}", f"p{number}")

    def named(self, name: str) -> str:
        """The variable of ``#<name>``."""
        if name in self.windows or "[" in name:
            raise NotCompilableError
        store, letter = (self.shared, "g") if name.startswith("_") else (self.own, "n")
        return store.setdefault(name, f"{letter}{len(store)}_")


@dataclass(slots=True)
class Unit:
    """A compiled loop: its source and the order of its state: own and shared parameters, then axes, motion and feed."""

    source: str = ""
    own: list[str] = field(default_factory=list)
    shared: list[str] = field(default_factory=list)
    axes: list[int] = field(default_factory=list)
    modal: bool = False
    lines: int = 0


class Writer:
    """Writes the source of one loop."""

    def __init__(self, program: Program, windows: frozenset[str], allowed_axes: str) -> None:
        self.program = program
        self.allowed = frozenset(allowed_axes.lower())
        self.main = Names(windows)
        self.names = self.main
        self.axes: set[int] = set()
        self.subs: dict[str, list[str]] = {}
        self.modal = False
        self.count = 0
        self.loops: list[tuple[str, bool]] = []
        self.in_sub = False

    def expression(self, value: Value) -> str:
        """Python source of a value."""
        if isinstance(value, float):
            return repr(value)
        if isinstance(value, Parameter):
            return self.names.numbered(value.index)
        if isinstance(value, NamedParameter):
            return self.names.named(value.name)
        if isinstance(value, Negative):
            return f"(-{self.expression(value.operand)})"
        if isinstance(value, Function):
            return _FUNCTIONS[value.name].format(self.expression(value.operand))
        if isinstance(value, Binary):
            if value.operator == "atan":
                return f"(atan2({self.expression(value.left)},{self.expression(value.right)})*180.0/pi)"
            if value.operator in _INFIX:
                return _INFIX[value.operator].format(self.expression(value.left), self.expression(value.right))
            return f"(1.0 if {self.condition(value)} else 0.0)"
        raise NotCompilableError

    def condition(self, value: Value) -> str:
        """Python source of a truth value."""
        if isinstance(value, Binary) and value.operator in _COMPARE:
            return _COMPARE[value.operator].format(self.expression(value.left), self.expression(value.right))
        if isinstance(value, Binary) and value.operator in _LOGIC:
            return _LOGIC[value.operator].format(self.condition(value.left), self.condition(value.right))
        return f"abs({self.expression(value)})>0.0"

    def body(self, first: int, last: int, indent: str) -> list[str]:
        """The lines from index ``first`` to before ``last``."""
        out: list[str] = []
        index = first
        while index < last:
            line = self.program.line(index)
            if line is None:
                index += 1
                continue
            self.count += 1
            if line.delete:
                raise NotCompilableError
            if line.statement is not None:
                more, index = self._statement(index, line.statement, indent)
                out += more
                continue
            out += self._plain(line, indent)
            index += 1
        return out or [f"{indent}pass"]

    def _assign(self, line: Line, indent: str) -> list[str]:
        """All values are read before the first is stored."""
        assigned: list[tuple[str, str]] = []
        for assignment in line.assignments:
            value = self.expression(assignment.value)
            if assignment.name is None:
                assigned.append((self.names.numbered(assignment.index), value))
            else:
                assigned.append((self.names.named(assignment.name), value))
        if not assigned:
            return []
        targets, values = ", ".join(t for t, _ in assigned), ", ".join(v for _, v in assigned)
        return [f"{indent}{targets} = {values}"]

    def _plain(self, line: Line, indent: str) -> list[str]:
        out = self._assign(line, indent)
        moves = self._move(line, indent)
        if out and moves and len(line.words):
            raise NotCompilableError
        if line.comment is not None:
            if is_active(line.comment):
                raise NotCompilableError
            out.append(self._mark(MARK_COMMENT, line.number, indent))
        return out + moves

    def _mark(self, kind: float, number: int, indent: str) -> str:
        return f"{indent}R += ({kind}, {float(number)}, @POSITION@ f)"

    def _move(self, line: Line, indent: str) -> list[str]:
        out: list[str] = []
        targets: list[tuple[str, str]] = []
        coded = False
        for word in line.words:
            letter = word.letter
            if letter == "g":
                if coded or word.value not in (0.0, 1.0):
                    raise NotCompilableError
                coded = True
                out.append(f"{indent}m = {0 if word.value == 0.0 else 10}")
            elif letter == "f":
                out.insert(0, f"{indent}f = {self._positive(word.value)}")
                out.insert(1, self._mark(MARK_FEED, line.number, indent))
            elif letter in AXIS_LETTERS and letter in self.allowed:
                axis = AXES.index(letter)
                if any(name == f"a{axis}" for name, _ in targets):
                    raise NotCompilableError
                self.axes.add(axis)
                targets.append((f"a{axis}", self.expression(word.value)))
            else:
                raise NotCompilableError
        if targets:
            names = ", ".join(name for name, _ in targets)
            out.append(f"{indent}{names} = @MOVE@" + "@,@".join(f"{name}@=@{value}" for name, value in targets))
            self.modal |= not coded
        if targets or coded:
            out.append(f"{indent}R += (m, {float(line.number)}, @POSITION@ f)")
        return out

    def _positive(self, value: Value) -> str:
        if isinstance(value, float):
            if value <= 0.0:
                raise NotCompilableError
            return repr(value)
        return f"positive_({self.expression(value)})"

    def _statement(self, index: int, statement: Statement, indent: str) -> tuple[list[str], int]:
        if index in self.program.broken:
            raise NotCompilableError
        construct = self.program.at.get(index)
        keyword = statement.keyword
        if keyword == "call":
            return [f"{indent}ret = {self._call(statement)}"], index + 1
        if keyword in {"return", "endsub"} and self.in_sub:
            value = self.expression(statement.arguments[0]) if statement.arguments else "None"
            return [f"{indent}return {value}"], index + 1
        if keyword == "ifthen":
            return self._if_then(index, statement, indent), index + 1
        if construct is None:
            raise NotCompilableError
        if keyword == "if":
            return self._if(construct, indent), construct.end + 1
        if keyword in {"while", "mwhile", "repeat", "do"}:
            return self.loop(construct, indent), construct.end + 1
        if keyword in {"break", "continue"} and self.loops and self.loops[-1] == (construct.label, True):
            return [f"{indent}{keyword}"], index + 1
        if keyword == "break" and self.loops and self.loops[-1][0] == construct.label:
            return [f"{indent}break"], index + 1
        raise NotCompilableError

    def _if(self, construct: Construct, indent: str) -> list[str]:
        bounds = [construct.start, *construct.branches, construct.end]
        out: list[str] = []
        for number, (start, end) in enumerate(pairwise(bounds)):
            line = self.program.line(start)
            assert line is not None
            assert line.statement is not None
            if number and line.statement.keyword == "else":
                out.append(f"{indent}else:")
            else:
                word = "elif" if number else "if"
                out.append(f"{indent}{word} {self.condition(line.statement.arguments[0])}:")
            out += self.body(start + 1, end, indent + " ")
        return out

    def _if_then(self, index: int, statement: Statement, indent: str) -> list[str]:
        """IF [...] THEN #1=2 of Macro B."""
        line = self.program.line(index)
        assert line is not None
        head = f"{indent}if {self.condition(statement.arguments[0])}:"
        return [head, *self._assign(line, indent + " ")]

    def loop(self, construct: Construct, indent: str) -> list[str]:
        """A loop with its bound: in the main level it gives its state, in a subprogram it gives up."""
        line = self.program.line(construct.start)
        assert line is not None
        assert line.statement is not None
        deeper = indent + " "
        self.loops.append((construct.label, construct.kind != "do"))
        if construct.kind == "do":
            out = [f"{indent}while True:", *self._check(deeper), *self.body(construct.start + 1, construct.end, deeper)]
            test = self.program.line(construct.end)
            assert test is not None
            assert test.statement is not None
            out.append(f"{deeper}if not ({self.condition(test.statement.arguments[0])}): break")
        else:
            value = line.statement.arguments[0]
            head = (
                f"while {self.condition(value)}:"
                if construct.kind != "repeat"
                else f"for _ in range(times_({self.expression(value)})):"
            )
            out = [indent + head, *self._check(deeper), *self.body(construct.start + 1, construct.end, deeper)]
        self.loops.pop()
        return out

    def _check(self, indent: str) -> list[str]:
        if self.in_sub:
            return [f"{indent}c += 1", f"{indent}if c > 200000: raise OverflowError"]
        if len(self.loops) > 1:
            return [f"{indent}c += 1", f"{indent}if c > 200000: raise OverflowError"]
        return [
            f"{indent}c += 1",
            f"{indent}if c > {CHECK_EVERY} or len(R) > 65536:",
            f"{indent} c = 0",
            f"{indent} yield @STATE@",
        ]

    def _call(self, statement: Statement) -> str:
        name = statement.label
        construct = self.program.subs.get(name)
        if statement.value is not None or construct is None or construct.end < 0 or len(statement.arguments) > 30:
            raise NotCompilableError
        arguments = [self.expression(argument) for argument in statement.arguments]
        if name not in self.subs:
            self.subs[name] = []
            self.subs[name] = self._sub(name, construct)
        return f"s{list(self.subs).index(name)}({', '.join(arguments)})"

    def _sub(self, name: str, construct: Construct) -> list[str]:
        outer, loops, in_sub = self.names, self.loops, self.in_sub
        self.names, self.loops, self.in_sub = Names(outer.windows, outer.shared), [], True
        end = self.program.line(construct.end)
        assert end is not None
        assert end.statement is not None
        body = self.body(construct.start + 1, construct.end, "  ")
        result = end.statement.arguments
        body.append(f"  return {self.expression(result[0]) if result else 'None'}")
        parameters = ", ".join(f"p{number}=0.0" for number in range(1, 31))
        self.names, self.loops, self.in_sub = outer, loops, in_sub
        return [f" def s{list(self.subs).index(name)}({parameters}):", "  nonlocal @SHARED@ m, f, c, ret, R", *body]


def write_loop(
    program: Program, construct: Construct, windows: frozenset[str], axes: str, *, incremental: bool
) -> Unit:
    """The source of a ``while`` loop that begins at ``construct`` (of either kind). Raises ``NotCompilableError``."""
    writer = Writer(program, windows, axes)
    body = writer.loop(construct, " ")
    own, shared = writer.main.own, writer.main.shared
    unit = Unit("", list(own), list(shared), sorted(writer.axes | {0, 1, 2}), writer.modal, writer.count + 2)
    places = [f"a{axis}" for axis in unit.axes]
    state = f"({''.join(name + ', ' for name in [*own.values(), *shared.values(), *places])}m, f, ret)"
    subs = (line for sub in writer.subs.values() for line in sub)
    lines = ["def loop(S, R):", f" {state} = S", " c = 0", *subs, *body, f" yield {state}"]
    outer = "".join(f"{name}, " for name in [*shared.values(), *places])
    position = "".join(f"{name}, " for name in places)
    unit.source = "\n".join(_filled(line, state, outer, position, incremental) for line in lines)
    return unit


def _filled(line: str, state: str, shared: str, position: str, incremental: bool) -> str:
    if "@MOVE@" in line:
        head, _, tail = line.partition("@MOVE@")
        values = []
        for pair in tail.split("@,@"):
            name, _, value = pair.partition("@=@")
            values.append(f"{name}+{value}" if incremental else value)
        line = head + ", ".join(values)
    return line.replace("@STATE@", state).replace("@SHARED@ ", shared).replace("@POSITION@ ", position)
