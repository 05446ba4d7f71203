"""Profiles of the lathe cycles: chains of straight and round segments, and what the cycles do with one segment.

Points are complex numbers, real part Z, imaginary part X. A profile is prepared so that it runs towards -Z with X
rising at its end; the cycle then dives into the material along falling segments and climbs out along rising ones.

Source: the behaviour of LinuxCNC's G70 to G72, tried against its tests.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Protocol

from gcode.errors import GcodeError

NEAR = 1e-6
COARSE = 1e-3


class Tool(Protocol):
    """Where the moves of a cycle go."""

    def line(self, end: complex) -> None:
        """Feed to ``end``."""

    def rapid(self, end: complex) -> None:
        """Rapid to ``end``."""

    def arc(self, ccw: bool, center: complex, end: complex) -> None:
        """Feed along an arc."""


def profile_error(message: str) -> GcodeError:
    """GC096: a profile that the cycle cannot cut."""
    return GcodeError("GC096", f"lathe cycle: {message}", "check the profile between SUB and ENDSUB", "motion")


@dataclass(slots=True)
class Segment:
    """One piece of a profile. ``center`` is None for a straight one. ``finish``: size of a corner yet to be made."""

    start: complex
    end: complex
    center: complex | None = None
    ccw: bool = False
    finish: float = 0.0

    def size(self) -> float:
        """Length of the chord, or the radius if that is smaller."""
        chord = abs(self.start - self.end)
        return chord if self.center is None else min(chord, abs(self.start - self.center))

    def is_monotonic(self) -> bool:
        """Whether it runs towards -Z only."""
        step = (self.end - self.start).real
        if self.center is None:
            return step <= COARSE
        if self.finish != 0.0:
            return True
        entry, leave = (self.start - self.center).imag, (self.end - self.center).imag
        if self.ccw:
            return entry >= -COARSE and leave >= -COARSE and step <= -COARSE
        return entry <= COARSE and leave <= COARSE and step <= -COARSE

    def mirrored(self, *, x: bool) -> None:
        """Mirrors X (or Z): arcs change their sense."""
        self.ccw = not self.ccw
        sign = 1.0 if x else -1.0
        self.start, self.end = sign * self.start.conjugate(), sign * self.end.conjugate()
        if self.center is not None:
            self.center = sign * self.center.conjugate()

    def turned(self) -> None:
        """A quarter turn: X becomes Z."""
        self.start, self.end = -1j * self.start, -1j * self.end
        if self.center is not None:
            self.center = -1j * self.center

    def moved(self, by: complex) -> None:
        """Shifts the segment."""
        self.start += by
        self.end += by
        if self.center is not None:
            self.center += by

    def offset(self, distance: float) -> None:
        """Shifts it sideways; arcs grow or shrink."""
        if self.center is None:
            across = 1j * distance * (self.start - self.end) / abs(self.start - self.end)
            self.start += across
            self.end += across
            return
        radius = abs(self.start - self.center)
        factor = (radius + (distance if self.ccw else -distance)) / radius
        self.start = factor * (self.start - self.center) + self.center
        self.end = factor * (self.end - self.center) + self.center

    def draw(self, tool: Tool) -> None:
        """Cuts the whole segment."""
        if self.center is None:
            tool.line(self.end)
        else:
            tool.arc(self.ccw, self.center, self.end)

    def at_height(self, x: float) -> list[float]:
        """The Z of its points at height ``x``, in the order in which the cycle meets them."""
        if self.center is None:
            low, high = sorted((self.start.imag, self.end.imag))
            if low > x + NEAR or high < x - NEAR:
                return []
            rise = (self.end - self.start).imag
            if abs(rise) < NEAR:
                return [self.start.real, self.end.real]
            return [(x - self.start.imag) / rise * (self.end - self.start).real + self.start.real]
        radius = abs(self.start - self.center)
        square = -(x - radius - self.center.imag) * (x + radius - self.center.imag)
        if square < -NEAR:
            return []
        half = max(square, 0.0) ** 0.5
        points = (complex(self.center.real + half, x), complex(self.center.real - half, x))
        return [point.real for point in points if self._covers(point)]

    def _covers(self, point: complex) -> bool:
        assert self.center is not None
        first = ((self.start - self.center).conjugate() * (point - self.center)).imag
        last = ((self.end - self.center).conjugate() * (point - self.center)).imag
        return first >= -NEAR and last <= NEAR if self.ccw else first <= NEAR and last >= -NEAR

    def top(self) -> complex:
        """The end of the climb of a counter-clockwise arc: its end, or its highest point before that."""
        assert self.center is not None
        if self.end.real < self.center.real:
            return complex(self.center.real, self.center.imag + abs(self.start - self.center))
        return self.end

    def climb(self, at: complex, tool: Tool) -> tuple[complex, bool]:
        """Out of the material along the segment from ``at``: the new place, and whether the climb ends here."""
        if self.center is None:
            if self.end.imag + NEAR < self.start.imag:
                return at, True
            if abs(at - self.start) > NEAR:
                raise profile_error("the tool left the profile")
            tool.line(self.end)
            return self.end, False
        if not self.ccw:
            if at.real > self.center.real:
                return at, True
            if abs(at - self.end) > COARSE:
                tool.arc(self.ccw, self.center, self.end)
            return self.end, False
        if at.real < self.center.real:
            return at, True
        top = self.top()
        if abs(at - top) > COARSE:
            tool.arc(self.ccw, self.center, top)
        return top, True

    def climb_over(self, at: complex, tool: Tool) -> complex:
        """Type 1: goes straight to the segment at the present height and up along it, if it rises there."""
        if self.center is None and self.end.imag < self.start.imag:
            return at
        meets = self.at_height(at.imag)
        if not meets:
            return at
        if self.center is None:
            tool.line(complex(meets[0], at.imag))
            tool.line(self.end)
            return self.end
        if not self.ccw:
            if meets[-1] > self.center.real:
                return at
            place, goal = complex(meets[-1], at.imag), self.end
        else:
            if meets[0] < self.center.real:
                return at
            place, goal = complex(meets[0], at.imag), self.top()
        tool.line(place)
        if abs(place - goal) > COARSE:
            tool.arc(self.ccw, self.center, goal)
        return goal

    def dive(self, at: complex, x: float, tool: Tool, *, fast: bool) -> tuple[complex, bool]:
        """Into the material along the segment down to height ``x``: the new place, and whether it does not fall."""
        move = tool.rapid if fast else tool.line
        if self.center is None:
            if self.start.imag <= self.end.imag + NEAR:
                return at, True
            if x < self.end.imag:
                move(self.end)
                return self.end, False
            meets = self.at_height(x)
            if not meets:
                raise profile_error("the start of a pass is above the profile")
            move(complex(meets[0], x))
            return complex(meets[0], x), False
        if abs(at - self.end) < NEAR or (at - self.end).real <= NEAR:
            return self.end, False
        meets = self.at_height(x) or self.at_height(x - NEAR)
        if self.ccw:
            if at.real - NEAR > self.center.real:
                return at, True
            goal = self.end if not meets or meets[-1] > self.center.real else complex(meets[-1], x)
        else:
            if at.real <= self.center.real:
                return at, True
            if meets and meets[0] < self.center.real:
                return at, False
            goal = complex(meets[0], x) if meets else self.end
        tool.arc(self.ccw, self.center, goal)
        return goal, False


def join(first: Segment, second: Segment) -> None:
    """Makes the end of ``first`` and the start of ``second`` the point where their curves meet."""
    if first.center is None and second.center is None:
        turn = (second.start - second.end).conjugate() / abs(second.start - second.end)
        a, b = (first.start - second.end) * turn, (first.end - second.end) * turn
        if (a - b).imag == 0.0:
            raise profile_error("two parallel lines do not meet")
        meet = (a + a.imag / (a - b).imag * (b - a)) / turn + second.end
    elif first.center is not None and second.center is not None:
        r2, r1 = abs(second.start - second.center), abs(first.start - first.center)
        apart = abs(second.center - first.center)
        cosine = (apart * apart + r2 * r2 - r1 * r1) / 2.0 / r2 / apart
        turn = complex(cosine, (1.0 - min(cosine * cosine, 1.0)) ** 0.5)
        meet = turn * (first.center - second.center) / apart * r2 + second.center
    else:
        if abs(second.start - first.end) < NEAR:
            return
        meet = _line_and_arc(first, second)
    first.end = second.start = meet


def _line_and_arc(first: Segment, second: Segment) -> complex:
    line, round_ = (first, second) if first.center is None else (second, first)
    assert round_.center is not None
    turn = (line.start - line.end).conjugate() / abs(line.start - line.end)
    on_arc = (round_.end - line.end) * turn
    center = (round_.center - line.end) * turn
    half = max(abs(center - on_arc) ** 2 - center.imag**2, 0.0) ** 0.5
    meets = [(center.real + sign * half) / turn + line.end for sign in (1.0, -1.0)]
    near: complex
    far: complex
    near, far = meets
    return near if abs(second.start - near) < abs(second.start - far) else far


def make_corner(corner: Segment, before: Segment, after: Segment) -> None:
    """Fillet (a segment with a centre) or chamfer of size ``finish`` between two segments."""
    p, n = copy(before), copy(after)
    size = corner.finish
    p.offset(size)
    n.offset(size)
    if (p.end - n.start).real > 1e-2:
        size = -size
        p, n = copy(before), copy(after)
        p.offset(size)
        n.offset(size)
    if (p.end - n.start).real > 1e-2:
        raise profile_error(f"no room for the corner at Z{before.end.real:g} X{before.end.imag:g}")
    join(p, n)
    center = (p.end + n.start) / 2.0
    p.offset(-size)
    n.offset(-size)
    corner.start = before.end = p.end
    corner.end = after.start = n.start
    if corner.center is not None:
        corner.center = center
        corner.ccw = (corner.start - center).imag > 0.0 or (corner.end - center).imag > 0.0
    corner.finish = 0.0
