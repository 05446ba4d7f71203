"""A line as read (``Line``) and a line as executed (``Block``).

A ``Line`` holds words whose values may still be expressions; it is read once however often it is executed. A ``Block``
holds numbers: codes by modal group and one value per letter.
"""

from __future__ import annotations

from dataclasses import field

from gcode.expressions import Span, Value
from gcode.records import dataclass


@dataclass(frozen=True, slots=True)
class Word:
    """A letter and its value at a compact span. Polar words have letters ``@`` and ``^``, the spindle word ``$``."""

    letter: str
    value: Value
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Assignment:
    """``#index = value`` (``name`` None) or ``#<name> = value``."""

    name: str | None
    index: Value
    value: Value
    span: Span


@dataclass(frozen=True, slots=True)
class Statement:
    """An O-word line: ``keyword`` of label ``label`` with bracketed ``arguments``. Keyword "" is a bare O number.

    ``label`` is the name in lower case, or the number as digits; an O-word whose label is computed keeps ``value``.
    """

    keyword: str
    label: str
    value: Value | None
    arguments: tuple[Value, ...]
    span: Span


@dataclass(frozen=True, slots=True)
class Line:
    """One physical line, read. ``delete``: 0, or the number of its block delete switch (``/`` is 1)."""

    number: int
    text: str
    words: tuple[Word, ...]
    assignments: tuple[Assignment, ...] = ()
    comment: str | None = None
    sequence: str | None = None
    delete: int = 0
    statement: Statement | None = None


@dataclass(slots=True)
class Block:
    """One line with numbers. ``motion``: the motion code this line will execute, or None."""

    line: int
    g: dict[str, int] = field(default_factory=dict)
    m: dict[str, int] = field(default_factory=dict)
    words: dict[str, float] = field(default_factory=dict)
    motion: int | None = None
    comment: str | None = None

    def has_axes(self) -> bool:
        """Whether any axis word stands on the line (polar words do not count)."""
        return not AXIS_LETTERS.isdisjoint(self.words)

    def whole(self, letter: str) -> int:
        """The value of ``letter`` rounded to an integer."""
        value = self.words[letter]
        return int(value + (0.5 if value >= 0.0 else -0.5))


AXIS_LETTERS = frozenset("xyzabcuvw")
