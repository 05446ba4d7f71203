"""Reading a line in a dialect: what lenient dialects forgive, sender lines, checksums, and Macro B statements."""

from __future__ import annotations

import re
from dataclasses import replace

from gcode.block import Line
from gcode.dialects import Dialect
from gcode.errors import GcodeError
from gcode.records import dataclass
from gcode.scanner import MAX_LINE, scan_line

_CHECKSUM = re.compile(r"\*\s*(\d{1,3})\s*$")
_SLASHES = re.compile(r"^\s*/(?:/|\s*[a-z]{3,}\b)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Read:
    """A line as read, and what was forgiven in it. ``line`` is None if nothing of it is executed."""

    line: Line | None
    warnings: tuple[GcodeError, ...] = ()


def read_line(text: str, number: int, dialect: Dialect) -> Read:
    """Reads one line. Raises ``GcodeError`` for what the dialect does not forgive."""
    stripped = text.strip()
    if not stripped or stripped == "%":
        return Read(None)
    if not dialect.lenient:
        if len(text) > MAX_LINE:
            raise _too_long(text)
        return Read(scan_line(text, number))
    return _lenient(text, stripped, number, dialect)


def _too_long(text: str) -> GcodeError:
    return GcodeError(
        "GC017",
        f"a line of {len(text)} characters",
        f"at most {MAX_LINE}: split it, or shorten the comment",
        f"column {MAX_LINE + 1}",
    )


def _lenient(text: str, stripped: str, number: int, dialect: Dialect) -> Read:
    warnings: list[GcodeError] = []
    if len(text) > MAX_LINE:
        warnings.append(_too_long(text))
    if stripped.startswith("%") or _SLASHES.match(text):
        warnings.append(GcodeError("GC210", "the line is taken for a comment", "put it in ( )", (0, 1)))
        return Read(None, tuple(warnings))
    if stripped[0] in "$?" and dialect.sender_lines:
        warnings.append(GcodeError("GC211", "a line for the sender, not for the machine: ignored", "remove it", (0, 1)))
        return Read(None, tuple(warnings))
    if stripped.startswith("<") and stripped.endswith(">"):
        return Read(None, tuple(warnings))
    checked = _CHECKSUM.search(text)
    if checked is not None and "(" not in text and ";" not in text:
        _check_sum(text, checked)
        text = text[: checked.start()]
    if dialect.macro_b:
        from gcode.macrob import macro_statement

        statement = macro_statement(text, number)
        if statement is not None:
            return Read(statement, tuple(warnings))
    line = scan_line(text, number, lenient=True, macro_b=dialect.macro_b)
    if text.count("(") != text.count(")"):
        warnings.append(
            GcodeError("GC212", "a comment is not closed, or holds another one", "close it with ')'", (0, 1))
        )
    return Read(replace(line, text=text), tuple(warnings))


def _check_sum(text: str, match: re.Match[str]) -> None:
    """A line's checksum is the exclusive or of its bytes before the star."""
    found = 0
    for byte in text[: match.start()].encode():
        found ^= byte
    if found != int(match.group(1)):
        raise GcodeError(
            "GC097",
            f"the checksum of the line is {found}, not {match.group(1)}",
            "the line was changed or damaged; remove the checksum if it was changed on purpose",
            f"column {match.start() + 1}",
        )
