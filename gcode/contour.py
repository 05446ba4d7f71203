"""The programmed contour under cutter compensation as plane curves: distances to it, offsets of it, where they cross.

Everything is in the plane's two coordinates, in program units. A contour is a list of ``Curve``s; the tool's centre may
be nowhere nearer to any of them than its radius.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gcode.arcgeometry import Point

F8 = npt.NDArray[np.float64]
TAU = 2.0 * math.pi


@dataclass(frozen=True, slots=True)
class Curve:
    """A straight line (``radius`` 0) or an arc about ``center`` from angle ``begin`` through ``sweep`` rad (signed)."""

    start: Point
    end: Point
    center: Point = (0.0, 0.0)
    radius: float = 0.0
    begin: float = 0.0
    sweep: float = 0.0

    @property
    def is_arc(self) -> bool:
        """Whether it is an arc."""
        return self.radius > 0.0

    @property
    def length(self) -> float:
        """Its length."""
        if self.is_arc:
            return self.radius * abs(self.sweep)
        return math.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1])

    def at(self, part: float) -> Point:
        """The point at ``part`` of its length, 0 to 1; the ends are exact."""
        if part == 0.0:
            return self.start
        if part == 1.0:
            return self.end
        if self.is_arc:
            angle = self.begin + part * self.sweep
            return self.center[0] + self.radius * math.cos(angle), self.center[1] + self.radius * math.sin(angle)
        x, y = self.start
        return x + part * (self.end[0] - x), y + part * (self.end[1] - y)

    def heading(self, part: float) -> Point:
        """The unit vector along which it runs at ``part``: only 0 and 1 are asked for."""
        if self.is_arc:
            angle = self.begin + part * self.sweep + math.copysign(math.pi / 2.0, self.sweep)
            return math.cos(angle), math.sin(angle)
        return (self.end[0] - self.start[0]) / self.length, (self.end[1] - self.start[1]) / self.length


def line(start: Point, end: Point) -> Curve:
    """A straight line of some length."""
    return Curve(start, end)


def arc(start: Point, end: Point, center: Point, sweep: float) -> Curve:
    """An arc; ``sweep`` rad, positive counter-clockwise, more than 2 pi for further turns."""
    center = _centered(start, end, center, sweep)
    begin = math.atan2(start[1] - center[1], start[0] - center[0])
    return Curve(start, end, center, math.hypot(start[0] - center[0], start[1] - center[1]), begin, sweep)


def _centered(start: Point, end: Point, center: Point, sweep: float) -> Point:
    """The centre moved along the chord so that both ends lie on one circle: rounded programs are a little off."""
    x, y = end[0] - start[0], end[1] - start[1]
    chord = math.hypot(x, y)
    if chord == 0.0 or abs(sweep) > math.pi:
        return center
    shift = ((start[0] + end[0]) / 2.0 - center[0]) * x / chord + ((start[1] + end[1]) / 2.0 - center[1]) * y / chord
    return center[0] + shift * x / chord, center[1] + shift * y / chord


def offset(curve: Curve, tool: float, side: int) -> Curve | None:
    """The curve at distance ``tool`` on ``side`` (+1 left, -1 right); None if the tool is too large for the arc."""
    (ax, ay), (bx, by) = curve.heading(0.0), curve.heading(1.0)
    start = (curve.start[0] - side * tool * ay, curve.start[1] + side * tool * ax)
    end = (curve.end[0] - side * tool * by, curve.end[1] + side * tool * bx)
    if not curve.is_arc:
        return Curve(start, end)
    radius = curve.radius - tool * side * math.copysign(1.0, curve.sweep)
    if radius <= 1e-9 * tool:
        return None
    return Curve(start, end, curve.center, radius, curve.begin, curve.sweep)


class Contour:
    """All curves of a contour as arrays, for questions about many of them at once."""

    def __init__(self, curves: list[Curve]) -> None:
        self.start = np.array([curve.start for curve in curves])
        self.end = np.array([curve.end for curve in curves])
        self.center = np.array([curve.center for curve in curves])
        self.radius = np.array([curve.radius for curve in curves])
        self.begin = np.array([curve.begin for curve in curves])
        self.sweep = np.array([curve.sweep for curve in curves])
        self.is_arc = self.radius > 0.0
        size = np.where(self.is_arc, self.radius, 0.0)[:, None]
        low, high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)
        self.low = np.where(self.is_arc[:, None], self.center - size, low)
        self.high = np.where(self.is_arc[:, None], self.center + size, high)

    def near(self, low: Point, high: Point, reach: float) -> npt.NDArray[np.intp]:
        """The curves whose box comes within ``reach`` of the box from ``low`` to ``high``."""
        inside = (self.low <= np.array(high) + reach) & (self.high >= np.array(low) - reach)
        return np.flatnonzero(inside.all(axis=1))

    def nearest(self, point: Point, without: int) -> int:
        """The index of the curve that is nearest to ``point``, one left out if there are others."""
        everyone = np.arange(len(self.radius))
        among = everyone[everyone != without] if len(everyone) > 1 else everyone
        at = np.array([point])
        return int(min(among, key=lambda index: float(self.distances(at, np.array([index]))[0])))

    def distances(self, points: F8, among: npt.NDArray[np.intp]) -> F8:
        """f8[k]: how far each of ``points`` f8[k, 2] is from the nearest of the curves ``among``."""
        if not len(among):
            return np.full(len(points), math.inf)
        start, end, p = self.start[among], self.end[among], points[:, None, :]
        along = end - start
        square = (along * along).sum(axis=1)
        part = np.clip(((p - start) * along).sum(axis=2) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        beside = p - start - part[:, :, None] * along
        straight = np.hypot(beside[:, :, 0], beside[:, :, 1])
        if not self.is_arc[among].any():
            return np.asarray(straight.min(axis=1))
        out, to_start, to_end = p - self.center[among], p - start, p - end
        angle = np.arctan2(out[:, :, 1], out[:, :, 0]) - self.begin[among]
        sweep = self.sweep[among]
        on = np.mod(angle * np.sign(sweep), TAU) <= np.abs(sweep)
        ends = np.minimum(np.hypot(to_start[:, :, 0], to_start[:, :, 1]), np.hypot(to_end[:, :, 0], to_end[:, :, 1]))
        round_ = np.where(on, np.abs(np.hypot(out[:, :, 0], out[:, :, 1]) - self.radius[among]), ends)
        return np.asarray(np.where(self.is_arc[among], round_, straight).min(axis=1))


def crossings(piece: Curve, contour: Contour, among: npt.NDArray[np.intp], tool: float, entry: Curve) -> F8:
    """The parts of ``piece`` (0 to 1, unsorted) at which its distance from one of ``among`` can pass ``tool``.

    These are its crossings with the two lines or circles beside each curve and with the circles about its ends, taken
    whole: some of them mean nothing, which costs only a cut where none was needed. ``entry`` is no offset of anything,
    so what crosses it is cut there too.
    """
    arcs = among[contour.is_arc[among]]
    lines = among[~contour.is_arc[among]]
    along = contour.end[lines] - contour.start[lines]
    normal = np.column_stack((-along[:, 1], along[:, 0])) / np.hypot(along[:, 0], along[:, 1])[:, None]
    level = (normal * contour.start[lines]).sum(axis=1)
    normals, levels = np.vstack((normal, normal)), np.concatenate((level - tool, level + tool))
    centers = np.vstack((contour.center[arcs], contour.center[arcs], contour.start[among], contour.end[among]))
    if entry.is_arc:
        centers = np.vstack((centers, entry.center))
    else:
        (x, y), (a, b) = entry.heading(0.0), entry.start
        normals, levels = np.vstack((normals, (-y, x))), np.append(levels, x * b - y * a)
    ends = np.full(2 * len(among), tool)
    radii = np.concatenate((np.abs(contour.radius[arcs] - tool), contour.radius[arcs] + tool, ends))
    radii = np.append(radii, entry.radius) if entry.is_arc else radii
    if piece.is_arc:
        return _of_arc(piece, normals, levels, centers, radii)
    return _of_line(piece, normals, levels, centers, radii)


def _of_line(piece: Curve, normals: F8, levels: F8, centers: F8, radii: F8) -> F8:
    p = np.array(piece.start)
    d = np.array(piece.end) - p
    with np.errstate(divide="ignore", invalid="ignore"):
        straight = (levels - normals @ p) / (normals @ d)
    square = float(d @ d)
    foot = ((centers - p) @ d) / square
    away = p + foot[:, None] * d - centers
    half = np.sqrt(np.maximum(radii * radii - (away * away).sum(axis=1), 0.0) / square)
    parts = np.concatenate((straight, foot - half, foot + half))
    return parts[(parts > 0.0) & (parts < 1.0)]


def _of_arc(piece: Curve, normals: F8, levels: F8, centers: F8, radii: F8) -> F8:
    c, r = np.array(piece.center), piece.radius
    facing = np.arctan2(normals[:, 1], normals[:, 0])
    half = np.arccos(np.clip((levels - normals @ c) / r, -1.0, 1.0))
    out = centers - c
    apart = np.hypot(out[:, 0], out[:, 1])
    apart_or_one = np.where(apart > 0.0, apart, 1.0)
    towards = np.arctan2(out[:, 1], out[:, 0])
    wide = np.arccos(np.clip((r * r + apart * apart - radii * radii) / (2.0 * r * apart_or_one), -1.0, 1.0))
    angles = np.concatenate((facing - half, facing + half, towards - wide, towards + wide))
    turned = np.mod((angles - piece.begin) * math.copysign(1.0, piece.sweep), TAU)
    turns = np.arange(math.ceil(abs(piece.sweep) / TAU)) * TAU
    parts: F8 = ((turned[:, None] + turns) / abs(piece.sweep)).ravel()
    return parts[(parts > 0.0) & (parts < 1.0)]
