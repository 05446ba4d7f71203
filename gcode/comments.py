"""Comments that do something: MSG, DEBUG, PRINT, LOG and its files, ABORT."""

from __future__ import annotations

import re

from gcode.block import Block
from gcode.canon import Message, Printed
from gcode.errors import GcodeError
from gcode.expressions import TOLERANCE_EQUAL, evaluate
from gcode.machine import Machine
from gcode.source import compact
from gcode.values import read_parameter

_ACTIVE = re.compile(r"\s*(msg|debug|print|logopen|logappend|logclose|log|abort)(,|$)", re.IGNORECASE)
_MARK = re.compile(r"%d|%f|%\.\df|#\d+|#<[^>()]*>")


def is_active(text: str) -> bool:
    """Whether a comment does something."""
    return _ACTIVE.match(text) is not None


def comment(machine: Machine, block: Block) -> None:
    """The last parenthesised comment of a line."""
    text = block.comment or ""
    emit = machine.emit
    match = _ACTIVE.match(text)
    if match is None:
        emit.comment(text.lstrip())
        return
    keyword, rest = match.group(1).lower(), text[match.end() :]
    if keyword == "msg":
        emit.command(Message(emit.line, rest))
    elif keyword == "debug":
        if machine.parameters.values.get(5599, 1.0) > 0.0:
            emit.command(Message(emit.line, expand(machine, rest)))
    elif keyword == "print":
        emit.command(Printed(emit.line, expand(machine, rest)))
    elif keyword == "log":
        emit.text(f'LOG("{expand(machine, rest)}")')
    elif keyword in {"logopen", "logappend"}:
        emit.text(f'{keyword.upper()}("{rest}")')
    elif keyword == "logclose":
        emit.text("LOGCLOSE()")
    else:
        raise GcodeError(
            "GC038", f"the program aborts itself: {expand(machine, rest).strip()}", "see the comment", (0, 1)
        )


def expand(machine: Machine, text: str) -> str:
    """Replaces ``#5`` and ``#<name>`` by their values.

    ``%d``, ``%f`` and ``%.3f`` choose how the values after them are shown: whole, with 4 or with 3 decimals; without
    one there are 6. A parameter that cannot be read shows as ``######``.
    """
    form = "%f"
    pieces: list[str] = []
    at = 0
    for match in _MARK.finditer(text):
        pieces.append(text[at : match.start()])
        at = match.end()
        mark = match.group()
        if mark.startswith("#"):
            pieces.append(_shown(machine, mark, form))
        else:
            form = {"%d": "%.0f", "%f": "%.4f"}.get(mark, mark)
    pieces.append(text[at:])
    return "".join(pieces)


def _shown(machine: Machine, mark: str, form: str) -> str:
    try:
        value, _ = read_parameter(compact(mark)[0], 0)
        number = evaluate(value, machine.parameters)
    except GcodeError:
        return "######"
    return form % (0.0 if abs(number) < TOLERANCE_EQUAL else number)
