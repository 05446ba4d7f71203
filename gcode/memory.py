"""What a canned cycle remembers from line to line."""

from __future__ import annotations

from dataclasses import field

from gcode.records import dataclass


@dataclass(slots=True)
class CycleMemory:
    """Sticky words of the present cycle; ``initial``: height at which the series began, None outside a series."""

    words: dict[str, float] = field(default_factory=dict)
    depth: float = 0.0
    initial: float | None = None
