"""Refusal files: programs that must be refused, with the place, the code and the hint in their first line.

    ; 4:8 GC005 fanuc | give X a number
    G21 G90
    ...

The first line names line and column of the diagnostic (lines count from the one after it), its code, a dialect other
than linuxcnc if need be, and words that the hint or the message must contain. The tool table has T1, T2, T3 and T99;
the machine has one user command, M110.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from gcode.setup import Setup, Tool

_HEAD = re.compile(r"^; (\d+):(\d+) (GC\d{3})(?: (\w+))? \| (.*)$")
_TOOLS = {1: Tool(1, 1, diameter=6.0), 2: Tool(2, 2, diameter=3.0), 3: Tool(3, 3, diameter=1.0), 99: Tool(99, 99)}


@dataclass(frozen=True, slots=True)
class Refusal:
    """One refusal file."""

    line: int
    column: int
    code: str
    dialect: str
    words: str
    program: str

    def setup(self, file: str) -> Setup:
        """The setup it is meant for."""
        return Setup(tools=_TOOLS, dialect=self.dialect, file=file, max_steps=50_000, user_commands=frozenset({110}))


def read_refusal(text: str) -> Refusal:
    """Raises ValueError if the first line is not of the form above."""
    head, _, program = text.partition("\n")
    match = _HEAD.match(head)
    if match is None:
        raise ValueError(f"not a refusal file: {head!r}")
    line, column, code, dialect, words = match.groups()
    return Refusal(int(line), int(column), code, dialect or "linuxcnc", words, program)
