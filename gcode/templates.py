"""Lines with expressions, by their shape: lines that differ in their numbers only are parsed once.

    G1 X[30.1+#1*8.2]   and   G1 X[-4.5+#1*0.7]   have the shape   G1 X[?+#1*?]

A shape becomes a Python function of its numbers. It does what the interpreter does with an assignment, or with G0 or
G1 and axis words; a line that it cannot vouch for (a division by zero, a huge value) is left to the interpreter, which
says what is wrong.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from gcode.block import Line
from gcode.blockpath import can_run, rows_block
from gcode.codegen import AXES, NotCompilableError, Writer
from gcode.errors import GcodeError
from gcode.expressions import Value
from gcode.hothelpers import HELPERS
from gcode.scanner import scan_line

if TYPE_CHECKING:
    from gcode.machine import Machine
    from gcode.program import Program

_NUMBER = re.compile(r"(?<![gG#\d.])(\d+\.?\d*|\.\d+)")
_FOREIGN = frozenset("(;%<@^$")
HOLD_ROWS = 8192
MAX_SHAPES = 5000

Function = Callable[[list[float], dict[int, float], list[float], list[tuple[float, ...]], int, int], int]


class _ShapeWriter(Writer):
    """Expressions whose numbers are the list ``c`` and whose parameters are read from the dictionary ``V``."""

    def expression(self, value: Value) -> str:
        """Python source of a value."""
        text = super().expression(value)
        if text.startswith("n") and text.endswith("_"):
            return f"c[{self.place(text)}]"
        return f"V.get({text[1:]}, 0.0)" if re.fullmatch(r"p\d+", text) else text

    def place(self, variable: str) -> int:
        """The index of a number in the line."""
        names = {v: k for k, v in self.names.own.items()}
        return int(names[variable].lstrip("?"))


def _source(line: Line, writer: _ShapeWriter, *, incremental: bool) -> tuple[str, bool]:
    """The function of a shape, and whether it needs a modal motion."""
    if line.statement is not None or line.delete or line.comment is not None or (line.words and line.assignments):
        raise NotCompilableError
    out = ["def shape(c, V, pos, R, n, m):"]
    checked: list[str] = []
    stores: list[str] = []
    for number, assignment in enumerate(line.assignments):
        if assignment.name is not None or not isinstance(assignment.index, float):
            raise NotCompilableError
        writer.names.numbered(assignment.index)
        out.append(f" t{number} = {writer.expression(assignment.value)}")
        checked.append(f"t{number}")
        stores.append(f" V[{int(assignment.index)}] = t{number}")
    coded = False
    used: set[str] = set()
    for word in line.words:
        if word.letter == "g":
            if coded or word.value not in (0.0, 1.0):
                raise NotCompilableError
            coded = True
            stores.insert(0, f" m = {0 if word.value == 0.0 else 10}")
            continue
        axis = AXES.find(word.letter)
        if axis < 0 or word.letter in used or word.letter not in writer.allowed:
            raise NotCompilableError
        used.add(word.letter)
        value = writer.expression(word.value)
        out.append(f" a{axis} = {f'pos[{axis}]+{value}' if incremental else value}")
        checked.append(f"a{axis}")
        stores.append(f" pos[{axis}] = a{axis}")
    if not used and not line.assignments:
        raise NotCompilableError
    out += [f" if not -1e300 < {name} < 1e300: raise OverflowError" for name in checked]
    out += stores
    if used:
        out.append(" R.append((m, n, *pos))")
    out.append(" return m")
    return "\n".join(out), bool(used) and not coded


class Templates:
    """Executes lines by their shapes and holds their rows until ``flush``."""

    def __init__(self, machine: Machine, program: Program) -> None:
        self.machine = machine
        self.program = program
        self.rows: list[tuple[float, ...]] = []
        self.allowed = False
        self._shapes: dict[str, tuple[Function, bool] | None] = {}
        self._incremental = False

    def prepare(self) -> None:
        """Looks at the modes: after every line that the interpreter executed."""
        state = self.machine.state
        self.allowed = (
            can_run(self.machine)
            and state.feed > 0.0
            and not self.machine.parameters.vacant
            and self.machine.emit.held is None
        )
        if state.incremental != self._incremental:
            self._incremental = state.incremental
            self._shapes.clear()

    def is_full(self) -> bool:
        """Whether so many rows are held that it is time to hand them out."""
        return len(self.rows) >= HOLD_ROWS

    def run(self, number: int, text: str) -> bool:
        """Executes the line if its shape is known to be harmless. False: nothing was done."""
        parts = _NUMBER.split(text)
        shape = "\0".join(parts[::2])
        found = self._shapes.get(shape, False)
        if found is False:
            found = self._learn(shape)
        if found is None:
            return False
        function, modal = found  # type: ignore[misc]
        machine = self.machine
        state = machine.state
        motion = state.motion
        if modal and motion not in {0, 10}:
            return False
        try:
            state.motion = function(
                list(map(float, parts[1::2])), machine.parameters.values, state.position, self.rows, number, motion
            )
        except (ArithmeticError, ValueError):
            return False
        return True

    def _learn(self, shape: str) -> tuple[Function, bool] | None:
        if len(self._shapes) > MAX_SHAPES or not _FOREIGN.isdisjoint(shape) or shape.lstrip().startswith("/"):
            return None
        pieces = shape.split("\0")
        text = pieces[0] + "".join(f"#<?{index}>{piece}" for index, piece in enumerate(pieces[1:]))
        found: tuple[Function, bool] | None = None
        try:
            line = scan_line(_without_sequence(text), 0)
            writer = _ShapeWriter(self.program, frozenset(), self.machine.setup.axes)
            source, modal = _source(line, writer, incremental=self._incremental)
            space = dict(HELPERS)
            exec(compile(source, "<shape>", "exec"), space)
            found = (space["shape"], modal)
        except (NotCompilableError, GcodeError, ValueError):
            pass
        self._shapes[shape] = found
        return found

    def flush(self) -> list[int]:
        """Hands the held rows out as a block; gives the lines of rapids below Z0 (for a warning)."""
        if not self.rows:
            return []
        table = np.empty((len(self.rows), 12))
        table[:, :11] = self.rows
        table[:, 11] = self.machine.state.feed
        self.rows.clear()
        before = self.machine.emit.frame.to_program(self.machine.emit.last)
        axes = [axis for axis in range(9) if axis < 3 or (table[:, 2 + axis] != before[axis]).any()]
        columns = [0, 1, *(2 + axis for axis in axes), 11]
        self.machine.emit.block(rows_block(self.machine, axes, table[:, columns], ()))
        low = (table[:, 0] == 0.0) & (table[:, 4] < 0.0)
        return [int(line) for line in table[low, 1][:1]]


def _without_sequence(text: str) -> str:
    """An N word's number is a placeholder too; it has no meaning."""
    return re.sub(r"^\s*[nN]\s*#<\?\d+>", "", text)
