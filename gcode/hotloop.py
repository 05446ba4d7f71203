"""Running compiled loops: state in, rows out, and back to the interpreter when something is not as it should be."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gcode.blockpath import can_run, rows_block
from gcode.canon import MoveBlock, Text
from gcode.codegen import CHECK_EVERY, MARK_FEED, NotCompilableError, Unit, write_loop
from gcode.errors import GcodeError
from gcode.hothelpers import HELPERS
from gcode.machine import Machine
from gcode.program import Construct, Program

WARM = 12
"""Passes of a loop before it is compiled."""

Loop = Callable[[tuple[Any, ...], list[float]], Iterator[tuple[Any, ...]]]


_GIVES_UP = (ArithmeticError, ValueError, TypeError, NameError, RecursionError)


@dataclass(slots=True)
class Compiled:
    """One loop, ready to run."""

    unit: Unit
    loop: Loop
    incremental: bool


@dataclass(slots=True)
class HotLoops:
    """Counts the passes of loops, compiles the warm ones and runs them."""

    machine: Machine
    passes: dict[tuple[int, int], int] = field(default_factory=dict)
    ready: dict[tuple[int, int], Compiled | None] = field(default_factory=dict)

    def is_warm(self, program: Program, index: int) -> bool:
        """Counts one more pass of the ``while`` at ``index``; whether it is time to run it compiled."""
        key = (id(program), index)
        if key in self.ready and self.ready[key] is None:
            return False
        self.passes[key] = self.passes.get(key, 0) + 1
        return self.passes[key] > WARM and can_run(self.machine) and self.machine.state.feed > 0.0

    def run(self, program: Program, construct: Construct) -> Iterator[int]:
        """Runs the loop as far as it goes; yields the number of lines executed since, when rows are handed out.

        The state of machine and parameters is then that of the loop's ``while`` line; after the last one, of the line
        behind its end (told by ``finished``).
        """
        self.finished_at = -1
        compiled = self._compiled(program, construct)
        if compiled is None:
            return
        rows: list[float] = []
        try:
            for state in compiled.loop(self._state(compiled.unit), rows):
                self._take(program, compiled.unit, state, rows)
                rows.clear()
                yield CHECK_EVERY * compiled.unit.lines
        except _GIVES_UP:
            self.ready[id(program), construct.start] = None
        else:
            self.finished_at = construct.end + 1

    finished_at: int = -1

    def _compiled(self, program: Program, construct: Construct) -> Compiled | None:
        key = (id(program), construct.start)
        found = self.ready.get(key)
        incremental = self.machine.state.incremental
        if found is None or found.incremental != incremental:
            windows = frozenset(self.machine.parameters.windows)
            try:
                unit = write_loop(program, construct, windows, self.machine.setup.axes, incremental=incremental)
            except (NotCompilableError, GcodeError):
                self.ready[key] = None
                return None
            space = dict(HELPERS)
            exec(compile(unit.source, f"<loop of line {construct.start + 1}>", "exec"), space)
            found = Compiled(unit, space["loop"], incremental)
            self.ready[key] = found
        if found.unit.modal and self.machine.state.motion not in {0, 10}:
            return None
        return found

    def _state(self, unit: Unit) -> tuple[Any, ...]:
        """The values of the loop's variables now; None for a name that is not defined."""
        parameters, state = self.machine.parameters, self.machine.state
        own = [
            parameters.numbered(int(name[1:])) if name[0] == "#" else parameters.frames[-1].get(name)
            for name in unit.own
        ]
        shared = [
            parameters.numbered(int(name[1:])) if name[0] == "#" else parameters.globals.get(name)
            for name in unit.shared
        ]
        # a vacant parameter of Macro B is None here, with which nothing can be calculated: then the loop gives up
        own, shared = (
            [None if value is None or math.isnan(value) else value for value in values] for values in (own, shared)
        )
        places = [state.position[axis] for axis in unit.axes]
        return (*own, *shared, *places, state.motion, state.feed, parameters.returned)

    def _take(self, program: Program, unit: Unit, values: tuple[Any, ...], rows: Sequence[float]) -> None:
        """Hands out rows and writes the variables back. Raises what ``_GIVES_UP`` names if a value is no number."""
        count = len(unit.own) + len(unit.shared)
        table = np.array(rows, dtype=np.float64).reshape(-1, len(unit.axes) + 3)
        numbers = [value for value in values[:count] if value is not None]
        if not np.isfinite(table).all() or not all(map(math.isfinite, numbers)):
            raise OverflowError
        machine = self.machine
        known = machine.parameters.values
        for name, value in zip((*unit.own, *unit.shared), values, strict=False):
            if value is None and name[0] == "#" and int(name[1:]) in known:
                raise TypeError  # it became vacant
        machine.emit.block(self._block(program, unit, table))
        parameters, state = machine.parameters, machine.state
        for number, name in enumerate((*unit.own, *unit.shared)):
            value = values[number]
            if value is None:
                continue
            if name[0] == "#":
                parameters.values[int(name[1:])] = value
            elif name[0] == "_":
                parameters.globals[name] = value
            else:
                parameters.frames[-1][name] = value
        for axis, value in zip(unit.axes, values[count:], strict=False):
            state.position[axis] = value
        state.motion, state.feed, parameters.returned = int(values[-3]), values[-2], values[-1]

    def _block(self, program: Program, unit: Unit, table: Any) -> MoveBlock:
        kinds = table[:, 0]
        is_move = kinds >= 0.0
        before = np.cumsum(is_move)
        notes: list[tuple[int, Text]] = []
        for index in np.flatnonzero(~is_move).tolist():
            line = int(table[index, 1])
            if kinds[index] == MARK_FEED:
                function = f"SET_FEED_RATE({table[index, -1]:.4f})"
            else:
                read = program.line(line - 1)
                function = f'COMMENT("{(read.comment if read and read.comment else "").lstrip()}")'
            notes.append((int(before[index]), Text(line, function)))
        moves = table[is_move]
        return rows_block(self.machine, unit.axes, moves, tuple(notes))
