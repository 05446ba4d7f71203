"""The frame of the moment: how program coordinates become machine coordinates.

    machine = rotate(program + shift) + origin + tool          (rotation in XY only), times mm per program unit

``shift`` is G92/G52, ``origin`` the active one of G54 to G59.3, ``tool`` the tool offset. Rotary axes are degrees in
both. The interpreter works in program coordinates as RS274/NGC does, and this is the one place where they are left.
"""

from __future__ import annotations

import math

from gcode.canon import ORIGIN, Position, Text
from gcode.records import dataclass

LINEAR = (0, 1, 2, 6, 7, 8)
"""Indices of the axes that have a length unit."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Offsets in program units (``unit_mm`` mm each) and degrees; ``rotation_deg`` about Z."""

    unit_mm: float = 1.0
    shift: Position = ORIGIN
    origin: Position = ORIGIN
    tool: Position = ORIGIN
    rotation_deg: float = 0.0

    def to_machine(self, p: Position) -> Position:
        """Program coordinates to absolute machine mm and degrees."""
        s, o, t, unit = self.shift, self.origin, self.tool, self.unit_mm
        x = p[0] + s[0]
        y = p[1] + s[1]
        if self.rotation_deg:
            x, y = turned(x, y, self.rotation_deg)
        return (
            (x + o[0] + t[0]) * unit,
            (y + o[1] + t[1]) * unit,
            (p[2] + s[2] + o[2] + t[2]) * unit,
            p[3] + s[3] + o[3] + t[3],
            p[4] + s[4] + o[4] + t[4],
            p[5] + s[5] + o[5] + t[5],
            (p[6] + s[6] + o[6] + t[6]) * unit,
            (p[7] + s[7] + o[7] + t[7]) * unit,
            (p[8] + s[8] + o[8] + t[8]) * unit,
        )

    def to_program(self, p: Position) -> Position:
        """Absolute machine mm and degrees to program coordinates: the inverse of ``to_machine``."""
        s, o, t, unit = self.shift, self.origin, self.tool, self.unit_mm
        q = [v / unit - o[i] - t[i] if i in LINEAR else v - o[i] - t[i] for i, v in enumerate(p)]
        if self.rotation_deg:
            q[0], q[1] = turned(q[0], q[1], -self.rotation_deg)
        x, y, z, a, b, c, u, v, w = (value - s[i] for i, value in enumerate(q))
        return (x, y, z, a, b, c, u, v, w)


@dataclass(frozen=True, slots=True)
class FrameChange(Text):
    """A canonical function that changes the frame; ``frame`` is the one that holds from here on."""

    frame: Frame


def turned(x: float, y: float, degrees: float) -> tuple[float, float]:
    """(x, y) turned about the origin."""
    angle = degrees * math.pi / 180.0
    cosine, sine = math.cos(angle), math.sin(angle)
    return x * cosine - y * sine, x * sine + y * cosine
