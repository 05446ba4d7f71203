"""Where a key of a TOML file stands: ``tomllib`` gives values without lines, errors need both.

A scanner of headers and of keys at the start of a line. It steps over strings and arrays that run over several lines.
A key inside an inline table has no line of its own and is found at the line of the table.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

KeyPath = tuple[str, ...]

_PART = r"""(?:[A-Za-z0-9_-]+|"(?:[^"\\]|\\.)*"|'[^']*')"""
_DOTTED = rf"{_PART}(?:\s*\.\s*{_PART})*"
_HEADER = re.compile(rf"\s*\[\[?\s*({_DOTTED})\s*\]\]?")
_KEY = re.compile(rf"\s*({_DOTTED})\s*=(.*)", re.DOTALL)
_PART_RE = re.compile(_PART)
_STRIP = re.compile(r""""(?:[^"\\]|\\.)*"|'[^']*'|#.*""")


def key_lines(text: str) -> Mapping[KeyPath, int]:
    """1-based line of every table header and key of a TOML text, by key path."""
    lines: dict[KeyPath, int] = {}
    table: KeyPath = ()
    closing = ""  # what ends the value that is still open: a triple quote, or "]"
    depth = 0
    for number, line in enumerate(text.splitlines(), start=1):
        if closing in ('"""', "'''"):
            closing = "" if closing in line else closing
            continue
        if closing == "]":
            depth += _brackets(line)
            closing = "]" if depth > 0 else ""
            continue
        if header := _HEADER.match(line):
            table = _parts(header.group(1))
            _note(lines, table, number)
        elif key := _KEY.match(line):
            _note(lines, table + _parts(key.group(1)), number)
            closing, depth = _open_value(key.group(2))
    return lines


def line_of(lines: Mapping[KeyPath, int], path: KeyPath) -> int | None:
    """Line of ``path``, or of the nearest table around it that has one."""
    for length in range(len(path), 0, -1):
        if (line := lines.get(path[:length])) is not None:
            return line
    return None


def _parts(dotted: str) -> KeyPath:
    return tuple(part.strip("\"'") for part in _PART_RE.findall(dotted))


def _note(lines: dict[KeyPath, int], path: KeyPath, number: int) -> None:
    for length in range(1, len(path) + 1):
        lines.setdefault(path[:length], number)


def _open_value(value: str) -> tuple[str, int]:
    """What keeps a value open beyond its line, and how many brackets deep."""
    stripped = value.strip()
    for quote in ('"""', "'''"):
        if stripped.startswith(quote):
            return ("" if quote in stripped[3:] else quote), 0
    depth = _brackets(value)
    return ("]" if depth > 0 else ""), depth


def _brackets(text: str) -> int:
    bare = _STRIP.sub("", text)
    return bare.count("[") - bare.count("]")
