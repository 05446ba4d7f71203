"""Programmed coordinates that are scaled, turned or polar before the work offsets apply: G50/G51, G68/G69, G15/G16.

    work = turn(scale(programmed))

The interpreter keeps positions in work coordinates; a word is understood in programmed coordinates, and axes without a
word keep theirs. Source: Fanuc and Mach manuals as their users quote them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from gcode.arcgeometry import Point
from gcode.block import Block
from gcode.emit import PLANE_AXES
from gcode.errors import GcodeError
from gcode.frame import turned
from gcode.state import AXIS_INDEX


@dataclass(slots=True)
class Local:
    """The transformation of now. ``axes``: the plane in which it turns. Scale factors are of X, Y and Z."""

    axes: tuple[int, int, int] = (0, 1, 2)
    turn_deg: float = 0.0
    turn_center: Point = (0.0, 0.0)
    factors: list[float] = field(default_factory=lambda: [1.0, 1.0, 1.0])
    scale_center: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    polar: bool = False

    def is_identity(self) -> bool:
        """Whether it changes nothing."""
        return self.turn_deg == 0.0 and self.factors == [1.0, 1.0, 1.0] and not self.polar

    def to_work(self, position: list[float]) -> list[float]:
        """Programmed to work coordinates."""
        q = list(position)
        for axis in range(3):
            q[axis] = self.scale_center[axis] + self.factors[axis] * (q[axis] - self.scale_center[axis])
        first, second, _ = self.axes
        a, b = turned(q[first] - self.turn_center[0], q[second] - self.turn_center[1], self.turn_deg)
        q[first], q[second] = a + self.turn_center[0], b + self.turn_center[1]
        return q

    def to_program(self, position: list[float]) -> list[float]:
        """Work to programmed coordinates."""
        q = list(position)
        first, second, _ = self.axes
        a, b = turned(q[first] - self.turn_center[0], q[second] - self.turn_center[1], -self.turn_deg)
        q[first], q[second] = a + self.turn_center[0], b + self.turn_center[1]
        for axis in range(3):
            q[axis] = self.scale_center[axis] + (q[axis] - self.scale_center[axis]) / self.factors[axis]
        return q

    def vector(self, a: float, b: float) -> Point:
        """A vector of the plane (an arc's centre) in work coordinates."""
        first, second, _ = self.axes
        return turned(a * self.factors[first], b * self.factors[second], self.turn_deg)

    def flips(self) -> bool:
        """Whether arcs change their sense (one axis of the plane mirrored)."""
        first, second, _ = self.axes
        return self.factors[first] * self.factors[second] < 0.0

    def size(self) -> float:
        """The scale of the plane. GC098 if its two axes differ, for then a circle is none."""
        first, second, _ = self.axes
        a, b = abs(self.factors[first]), abs(self.factors[second])
        if abs(a - b) > 1e-12:
            raise GcodeError("GC098", "an arc under unequal scaling", "scale both axes of the plane alike", "motion")
        return a

    def end(self, position: list[float], block: Block, *, incremental: bool) -> list[float]:
        """Where the words of ``block`` lead from ``position``, in work coordinates."""
        q = self.to_program(position)
        words = block.words
        first, second, _ = self.axes
        plane = {"xyzabcuvw"[first], "xyzabcuvw"[second]} if self.polar else set()
        for letter, axis in AXIS_INDEX.items():
            if letter in words and letter not in plane:
                q[axis] = q[axis] + words[letter] if incremental else words[letter]
        if self.polar and plane & words.keys():
            if incremental:
                raise GcodeError("GC026", "incremental polar coordinates (G16 with G91)", "use G90 with G16", "axes")
            q[first], q[second] = self._polar(words, q[first], q[second])
        return self.to_work(q)

    def _polar(self, words: dict[str, float], a: float, b: float) -> Point:
        first, second, _ = self.axes
        radius = words.get("xyzabcuvw"[first], math.hypot(a, b))
        angle = math.radians(words["xyzabcuvw"[second]]) if "xyzabcuvw"[second] in words else math.atan2(b, a)
        return radius * math.cos(angle), radius * math.sin(angle)


def localize_arc(
    local: Local, block: Block, motion: int, letters: tuple[str, str], *, absolute: bool
) -> tuple[Block, int]:
    """An arc's block and motion code with its centre words or R in work coordinates."""
    words = dict(block.words)
    first, second, _ = local.axes
    size = local.size()
    if "r" in words:
        words["r"] *= size
    one, two = letters
    if one in words or two in words:
        if absolute:
            place = [0.0] * 9
            place[first], place[second] = words.get(one, 0.0), words.get(two, 0.0)
            place = local.to_work(place)
            words[one], words[two] = place[first], place[second]
        else:
            words[one], words[two] = local.vector(words.get(one, 0.0), words.get(two, 0.0))
    if local.flips():
        motion = 50 - motion
    return Block(block.line, block.g, block.m, words, block.motion, block.comment), motion


def plane_axes(plane: int) -> tuple[int, int, int]:
    """The axes of G17, G18 or G19."""
    return PLANE_AXES.get(plane, (0, 1, 2))
