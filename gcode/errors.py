"""Errors and warnings of the interpreter: located, coded, with a hint, and printable with a caret.

A step that refuses a line raises ``GcodeError`` and says where in the line by a word letter or by a span; the driver,
which alone knows file and line, turns it into a ``Diagnostic``. Columns count characters from 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Literal

from gcode.records import dataclass

Severity = Literal["error", "warning"]


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One error or warning. ``column`` to ``end_column`` (exclusive) is what the carets stand under.

    ``calls``: the lines of the calls that were open, innermost last (empty in the main program).
    """

    file: str
    line: int
    column: int
    end_column: int
    code: str
    severity: Severity
    message: str
    hint: str = ""
    calls: tuple[str, ...] = ()

    def text(self, source_line: str = "") -> str:
        """The diagnostic as a compiler prints it: one headline, the source line with carets, calls and the hint."""
        lines = [f"{self.file}:{self.line}:{self.column}: {self.severity} {self.code}: {self.message}"]
        if source_line.strip():
            shown = source_line.expandtabs(1).rstrip()
            first = min(self.column, len(shown) + 1)
            width = max(1, min(self.end_column, len(shown) + 1) - first)
            start = max(
                0, min(first - 1, len(shown)) - 100
            )  # a line of thousands of characters shows its neighbourhood
            lines.append("    " + shown[start : start + 160])
            lines.append("    " + " " * (first - 1 - start) + "^" * min(width, 160))
        lines.extend(f"    {call}" for call in self.calls)
        if self.hint:
            lines.append(f"    hint: {self.hint}")
        return "\n".join(lines)

    def as_json(self) -> str:
        """One JSON object on one line: file, line, column, end_column, code, severity, message, hint (and calls)."""
        import json

        record = asdict(self)
        if not self.calls:
            del record["calls"]
        return json.dumps(record, ensure_ascii=False)

    def with_file(self, file: str) -> Diagnostic:
        """The same diagnostic named for another file."""
        return replace(self, file=file)


class GcodeError(Exception):
    """A line is refused. ``at``: the letter of a word ("X", "G", "M6" for one code), or a span of compact indices.

    Compact indices count the characters of the line without its blanks, as the scanner sees it.
    """

    def __init__(self, code: str, message: str, hint: str = "", at: str | tuple[int, int] | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.hint = hint
        self.at = at

    def placed(self, at: str | tuple[int, int]) -> GcodeError:
        """The same error, placed at ``at`` if it had no place yet."""
        if self.at is None:
            self.at = at
        return self


def nearest(word: str, choices: Sequence[str], limit: int = 2) -> str | None:
    """The choice within ``limit`` edits of ``word`` (case ignored), or None. Swapped neighbours count as one edit."""
    best: tuple[int, str] | None = None
    for choice in choices:
        distance = _edits(word.upper(), choice.upper())
        if distance <= min(limit, max(1, len(choice) - 1)) and (best is None or distance < best[0]):
            best = (distance, choice)
    return best[1] if best else None


def _edits(a: str, b: str) -> int:
    """Edits (insert, delete, replace, swap of neighbours) from ``a`` to ``b``: optimal string alignment."""
    rows = [list(range(len(b) + 1))]
    for i, x in enumerate(a, 1):
        row = [i]
        for j, y in enumerate(b, 1):
            cost = min(rows[-1][j] + 1, row[-1] + 1, rows[-1][j - 1] + (x != y))
            if i > 1 and j > 1 and x == b[j - 2] and a[i - 2] == y:
                cost = min(cost, rows[-2][j - 2] + 1)
            row.append(cost)
        rows.append(row)
    return rows[-1][-1]
