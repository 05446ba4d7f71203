"""From an error of a step to a diagnostic with columns: finds the word that the error speaks of."""

from __future__ import annotations

import re

from gcode.codes import G_GROUP_OF, MOTION
from gcode.errors import Diagnostic, GcodeError, Severity
from gcode.source import COMMENT_MARK, columns, compact

_WORD = re.compile(r"([a-z@^$])([+-]?[\d.]*)")
_AXES = frozenset("xyzabcuvw@^")


def place(
    error: GcodeError, file: str, number: int, text: str, severity: str = "error", calls: tuple[str, ...] = ()
) -> Diagnostic:
    """The diagnostic of ``error`` on line ``number`` whose text is ``text``."""
    if isinstance(error.at, str) and error.at.startswith("column "):
        column = int(error.at.split()[1])
        end_column = column + 1
    else:
        column, end_column = columns(text, *_span(error, text))
    kind: Severity = "warning" if severity == "warning" else "error"
    return Diagnostic(file, number, column, end_column, error.code, kind, error.message, error.hint, calls)


def _span(error: GcodeError, text: str) -> tuple[int, int]:
    at = error.at
    if isinstance(at, tuple):
        return at
    try:
        line, _ = compact(text)
    except GcodeError:
        return 0, 1
    whole = (0, max(1, len(line.rstrip(COMMENT_MARK))))
    if at is None:
        return whole
    words = [(m.group(1), m.group(2), m.start(), _value_end(line, m)) for m in _WORD.finditer(line)]
    return _find(at.lower(), words) or whole


def _value_end(line: str, match: re.Match[str]) -> int:
    """The end of the word, with its bracket or parameter."""
    end = match.end()
    if match.group(2) or end >= len(line) or line[end] not in "[#":
        return end
    depth = 0
    while end < len(line):
        depth += (line[end] == "[") - (line[end] == "]")
        end += 1
        if depth == 0 and (end >= len(line) or line[end] not in "[#<>0123456789_") and line[end - 1] != "#":
            break
    return end


def _find(at: str, words: list[tuple[str, str, int, int]]) -> tuple[int, int] | None:
    if at == "axes":
        chosen = [word for word in words if word[0] in _AXES]
    elif at == "arc centre":
        chosen = [word for word in words if word[0] in "ijkr"] or [word for word in words if word[0] == "g"]
    elif at == "motion":
        chosen = [word for word in words if word[0] == "g" and _is_motion(word[1])]
        chosen = chosen or [word for word in words if word[0] in _AXES]
    elif len(at) > 1:
        chosen = [word for word in words if word[0] == at[0] and _same_number(word[1], at[1:])]
    else:
        chosen = [word for word in words if word[0] == at][:1]
    if not chosen:
        return None
    return chosen[0][2], chosen[-1][3]


def _is_motion(number: str) -> bool:
    try:
        return G_GROUP_OF.get(round(10.0 * float(number))) == MOTION
    except ValueError:
        return False


def _same_number(found: str, wanted: str) -> bool:
    try:
        return float(found) == float(wanted)
    except ValueError:
        return False
