"""Macro B of Fanuc and Haas: IF .. GOTO, IF .. THEN, GOTO, WHILE .. DO m, END m, and the arguments of G65."""

from __future__ import annotations

import re

from gcode.block import Assignment, Line, Statement
from gcode.errors import GcodeError
from gcode.expressions import Value
from gcode.source import compact
from gcode.values import read_expression, read_open_expression, read_parameter, read_value

_START = re.compile(r"^(?:/\d?)?(?:n\d+)?(if\[|while\[|goto|end\d|do\d)")

ARGUMENTS = {
    **{"a": 1, "b": 2, "c": 3, "d": 7, "e": 8, "f": 9, "h": 11, "i": 4, "j": 5, "k": 6, "m": 13, "q": 17},
    **{"r": 18, "s": 19, "t": 20, "u": 21, "v": 22, "w": 23, "x": 24, "y": 25, "z": 26},
}
"""Letters of a macro call and the local parameters they fill (argument specification I)."""


def macro_statement(text: str, number: int) -> Line | None:
    """The Macro B statement on a line, or None. Raises ``GcodeError``."""
    line, comments = compact(text, lenient=True)
    match = _START.match(line)
    if match is None:
        return None
    at = match.start(1)
    sequence = re.match(r"^(?:/\d?)?n(\d+)", line)
    statement, assignments = _read(line, at)
    comment = comments[-1] if comments else None
    return Line(number, text, (), assignments, comment, sequence.group(1) if sequence else None, 0, statement)


def _read(line: str, at: int) -> tuple[Statement, tuple[Assignment, ...]]:
    if line.startswith("goto", at):
        target, end = read_value(line, at + 4)
        return Statement("goto", "", None, (target,), (at, end)), ()
    if line.startswith(("end", "do"), at):
        keyword = "mend" if line.startswith("end", at) else "mdo"
        label = line[at + (3 if keyword == "mend" else 2) :].rstrip("\x01")
        return Statement(keyword, label, None, (), (at, len(line))), ()
    keyword = "if" if line.startswith("if", at) else "while"
    condition, end = read_expression(line, at + len(keyword))
    if keyword == "while":
        if not line.startswith("do", end) or not line[end + 2 : end + 3].isdigit():
            raise GcodeError("GC080", "WHILE without DO", "write WHILE [...] DO1 ... END1", (at, end))
        return Statement("mwhile", line[end + 2 :].rstrip("\x01"), None, (condition,), (at, end)), ()
    if line.startswith("goto", end):
        target, stop = read_value(line, end + 4)
        return Statement("ifgoto", "", None, (condition, target), (at, stop)), ()
    if line.startswith("then", end):
        assignment, stop = _assignment(line, end + 4)
        return Statement("ifthen", "", None, (condition,), (at, stop)), (assignment,)
    raise GcodeError("GC080", "IF without GOTO or THEN", "write IF [...] GOTO 10 or IF [...] THEN #1=2", (at, end))


def _assignment(line: str, at: int) -> tuple[Assignment, int]:
    if line[at : at + 1] != "#":
        raise GcodeError("GC033", "THEN needs an assignment", "write IF [...] THEN #1=2", (at, at + 1))
    target, end = read_parameter(line, at)
    index: Value = target.index if hasattr(target, "index") else 0.0
    if line[end : end + 1] != "=":
        raise GcodeError("GC033", "'=' is missing after the parameter", "write #1=...", (at, end))
    value, stop = read_open_expression(line, end + 1)
    return Assignment(None, index, value, (at, stop)), stop
