"""Writes a few values into the text of a TOML file and leaves everything else as it is: comments, order, spacing.

``tomllib`` only reads, and a machine file is written by hand: its comments are worth more than its values. Only what is
needed is known here: plain keys, one a line, in plain ``[tables]``. Anything else is refused, never guessed at.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping

from machines.toml_lines import KeyPath, key_lines

Value = str | int | float | bool
_COMMENT = re.compile(r"""((?:[^"'#]|"(?:[^"\\]|\\.)*"|'[^']*')*?)(\s*#.*)?$""")


def set_values(text: str, table: KeyPath, values: Mapping[str, Value]) -> str:
    """The text with ``values`` in ``[table]``; a table that is not there is added behind its parent's tables.

    Raises ValueError where the file writes the table in a way that is not known here (inline, or dotted keys).
    """
    before = tomllib.loads(text)
    wanted = _merged(before, table, values)
    newline = "\r\n" if "\r\n" in text else "\n"
    lines = text.splitlines()
    header = _header_line(lines, table)
    if header is None:
        header = _place_of_new(lines, table)
        blank = [""] if header and lines[header - 1].strip() else []
        after = [""] if header < len(lines) and lines[header].strip() else []
        lines[header:header] = [*blank, f"[{'.'.join(table)}]", *after]
        header += len(blank)
    for key, value in values.items():
        _set_one(lines, header, table, key, toml_value(value))
    changed = newline.join(lines) + (newline if text.endswith("\n") or not text else "")
    try:
        understood = tomllib.loads(changed) == wanted
    except tomllib.TOMLDecodeError:
        understood = False
    if not understood:
        raise ValueError(f"[{'.'.join(table)}] is written in a way that cannot be changed safely: edit it by hand")
    return changed


def toml_value(value: Value) -> str:
    """A value as TOML writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04X}" for c in escaped) + '"'
    return repr(value)


def _merged(data: Mapping[str, object], table: KeyPath, values: Mapping[str, Value]) -> dict[str, object]:
    """What the file must say afterwards."""
    merged = dict(data)
    if not table:
        return merged | dict(values)
    inner = merged.get(table[0], {})
    if not isinstance(inner, dict):
        raise ValueError(f"{table[0]} is no table")
    merged[table[0]] = _merged(inner, table[1:], values)
    return merged


def _header_line(lines: list[str], table: KeyPath) -> int | None:
    """Index of ``[table]``."""
    for index, line in enumerate(lines):
        if _table_of(line) == table:
            return index
    return None


def _table_of(line: str) -> KeyPath | None:
    stripped = line.split("#", maxsplit=1)[0].strip()
    if not (stripped.startswith("[") and stripped.endswith("]")) or stripped.startswith("[["):
        return None
    return max(key_lines(stripped), key=len, default=None)


def _place_of_new(lines: list[str], table: KeyPath) -> int:
    """Where a new table goes: behind the last table of its parent, before the comments of the next; else at the end."""
    last = None
    for index, line in enumerate(lines):
        found = _table_of(line)
        if found is not None and found[: len(table) - 1] == table[:-1]:
            last = index
    if last is None or len(table) == 1:
        return len(lines)
    return _end_of_table(lines, last)


def _end_of_table(lines: list[str], header: int) -> int:
    """The line behind the last key of a table."""
    following = next((i for i in range(header + 1, len(lines)) if lines[i].lstrip().startswith("[")), len(lines))
    while following > header + 1 and (not lines[following - 1].strip() or lines[following - 1].lstrip()[0] == "#"):
        following -= 1
    return following


def _set_one(lines: list[str], header: int, table: KeyPath, key: str, value: str) -> None:
    """Replace the value of a key that is there, its comment kept; add one that is not."""
    end = _end_of_table(lines, header)
    for index in range(header + 1, end):
        left, equals, right = lines[index].partition("=")
        if equals and left.strip().strip("\"'") == key:
            match = _COMMENT.match(right)
            comment = (match.group(2) or "") if match else ""
            lines[index] = f"{left.rstrip()} = {value}{comment}"
            return
    lines.insert(end, f"{key} = {value}")
