"""The state of the interpreter: position, offsets and modes, in program units and work coordinates.

That is how RS274/NGC keeps them.

Everything mutable of a run is here or in ``Parameters``; a snapshot of both is enough to continue from any line.
"""

from __future__ import annotations

import math
from dataclasses import field

from gcode.canon import Position
from gcode.frame import LINEAR, Frame, turned
from gcode.records import dataclass
from gcode.setup import Tool

AXIS_INDEX = {letter: index for index, letter in enumerate("xyzabcuvw")}
NO_TOOL = Tool(0)


def position_of(values: list[float]) -> Position:
    """Nine floats as a position."""
    x, y, z, a, b, c, u, v, w = values
    return (x, y, z, a, b, c, u, v, w)


def nine() -> list[float]:
    """Nine zeros."""
    return [0.0] * 9


@dataclass(slots=True)
class State:
    """Modes and positions. Lengths are in program units (``unit_mm`` mm each), angles in degrees, codes in tenths."""

    unit_mm: float = 1.0
    machine_unit_mm: float = 1.0
    position: list[float] = field(default_factory=nine)
    shift: list[float] = field(default_factory=nine)
    origin: list[float] = field(default_factory=nine)
    tool_offset: list[float] = field(default_factory=nine)
    rotation_deg: float = 0.0
    system: int = 1
    motion: int = 800
    plane: int = 170
    incremental: bool = False
    ijk_absolute: bool = False
    feed_mode: int = 940
    feed: float = 0.0
    spindle_direction: int = 0
    spindle_rpm: float = 0.0
    mist: bool = False
    flood: bool = False
    feed_override: bool = True
    speed_override: bool = True
    adaptive_feed: bool = False
    feed_hold: bool = False
    control: int = 640
    tolerance: float | None = None
    merge: float | None = None
    retract: int = 990
    spindle_mode: int = 970
    spindle_limit_rpm: float = math.inf
    lathe_diameter: bool = False
    compensation: int = 400
    tool_length: int = 490
    selected_tool: int | None = None
    tool_in_spindle: int = 0
    tool_was_selected: bool = False

    def frame(self) -> Frame:
        """The frame of now."""
        return Frame(
            self.unit_mm,
            position_of(self.shift),
            position_of(self.origin),
            position_of(self.tool_offset),
            self.rotation_deg,
        )

    def from_machine_units(self, value: float, axis: int) -> float:
        """A parameter or tool table value of ``axis`` (machine units) in program units."""
        return value * self.machine_unit_mm / self.unit_mm if axis in LINEAR else value

    def to_machine_units(self, value: float, axis: int) -> float:
        """A program value of ``axis`` in machine units."""
        return value * self.unit_mm / self.machine_unit_mm if axis in LINEAR else value

    def absolute(self) -> list[float]:
        """The position in the machine frame, in program units and degrees."""
        p = [value + self.shift[i] for i, value in enumerate(self.position)]
        p[0], p[1] = self.rotated(p[0], p[1], self.rotation_deg)
        return [value + self.origin[i] + self.tool_offset[i] for i, value in enumerate(p)]

    def relative(self, absolute: list[float]) -> list[float]:
        """Machine frame coordinates (program units) in work coordinates."""
        p = [value - self.origin[i] - self.tool_offset[i] for i, value in enumerate(absolute)]
        p[0], p[1] = self.rotated(p[0], p[1], -self.rotation_deg)
        return [value - self.shift[i] for i, value in enumerate(p)]

    def rotated(self, x: float, y: float, degrees: float) -> tuple[float, float]:
        """(x, y) turned by ``degrees``; untouched for zero."""
        return turned(x, y, degrees) if degrees else (x, y)

    def convert_units(self, unit_mm: float) -> None:
        """Changes the program unit; every length keeps its size."""
        factor = self.unit_mm / unit_mm
        for values in (self.position, self.shift, self.origin, self.tool_offset):
            for axis in LINEAR:
                values[axis] *= factor
        self.feed *= factor
        if self.tolerance is not None:
            self.tolerance *= factor
        if self.merge is not None:
            self.merge *= factor
        self.unit_mm = unit_mm
