"""Arcs and helices as tangent polygons: every vertex carries one parabola, and the chain is tangent to the circle.

The picture: a circle of radius r is surrounded by a polygon that touches it at the middle of each edge; the parabola
of a vertex begins and ends at two touching points, so its legs use up the edges. Over a half step phi it leaves the
circle by r phi^4 / 8 at most, always outwards. At an end with a sharp corner the arc gives up a short lead (an edge
that runs on to the end point itself), which makes room for the parabola of that corner.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gcode import canon
from planner.errors import PlanError
from planner.moves import KIND_ARC, Moves
from planner.types import F8, I4, Index

MAX_HALF_STEP = 0.05
"""rad: keeps the feed lost in the middle of a parabola (phi^2 / 3) under 0.1 %."""
MIN_STEPS = 4
"""vertices of the shortest arc: a run of one arc still needs nodes to accelerate and brake at."""
PLANE_AXES = {"XY": ("X", "Y"), "ZX": ("Z", "X"), "YZ": ("Y", "Z")}
RADIUS_MISMATCH_MM = 0.05
"""a centre whose distances to start and end differ by more than this is refused (the interpreter is stricter)."""


@dataclass(frozen=True, slots=True, eq=False)
class Arcs:
    """K arcs in columns, of the moves ``index``.

    index: i8[K]. columns: i8[K, 2], planned axes of the plane. center: f8[K, 2]. r0, r1: f8[K], radius at both ends (it
    changes in proportion to the angle). angle0: f8[K]; sweep: f8[K], signed, rad. other: f8[K, A], travel of the axes
    outside the plane (0 in it). start: f8[K, A]. per_rad: f8[K], path length per rad, all axes.
    """

    index: Index
    columns: Index
    center: F8
    r0: F8
    r1: F8
    angle0: F8
    sweep: F8
    other: F8
    start: F8
    per_rad: F8

    def __len__(self) -> int:
        return len(self.index)

    def length(self) -> F8:
        """Path length f8[K] over all axes."""
        return np.asarray(np.abs(self.sweep) * self.per_rad)

    def tangents(self) -> tuple[F8, F8]:
        """Unit tangents f8[K, A] at start and end."""
        return self._tangent(self.angle0, self.r0), self._tangent(self.angle0 + self.sweep, self.r1)

    def _tangent(self, angle: F8, r: F8) -> F8:
        sign = np.sign(self.sweep)
        t = self.other / np.abs(self.sweep)[:, None]
        rows = np.arange(len(self))
        radial = (self.r1 - self.r0) / np.abs(self.sweep)
        t[rows, self.columns[:, 0]] = -sign * r * np.sin(angle) + radial * np.cos(angle)
        t[rows, self.columns[:, 1]] = sign * r * np.cos(angle) + radial * np.sin(angle)
        return np.asarray(t / np.linalg.norm(t, axis=1)[:, None])


def arcs_of(moves: Moves, axes: tuple[str, ...], begin: F8) -> Arcs:
    """Geometry of all arcs of ``moves``; ``begin``: f8[N, A], where each move starts. Raises PlanError."""
    index = np.flatnonzero(moves.kind == KIND_ARC)
    columns = np.zeros((len(index), 2), dtype=np.intp)
    for k, name in enumerate(canon.PLANES):
        rows = moves.plane[index] == k
        if rows.any():
            columns[rows] = [_column(axes, a, moves.line[index[rows]]) for a in PLANE_AXES[name]]
    rows = np.arange(len(index))
    start, end, center = begin[index], moves.end[index], moves.center[index]
    p0 = np.stack([start[rows, columns[:, 0]], start[rows, columns[:, 1]]], axis=1) - center
    p1 = np.stack([end[rows, columns[:, 0]], end[rows, columns[:, 1]]], axis=1) - center
    r0, r1 = np.hypot(p0[:, 0], p0[:, 1]), np.hypot(p1[:, 0], p1[:, 1])
    _refuse_bad_radii(moves, index, r0, r1)
    angle0 = np.arctan2(p0[:, 1], p0[:, 0])
    turns = moves.turns[index]
    forward = np.sign(turns) * (np.arctan2(p1[:, 1], p1[:, 0]) - angle0) % (2 * np.pi)
    forward = np.where((forward < 1e-12) | (np.abs(p1 - p0).max(axis=1, initial=0) < 1e-12), 2 * np.pi, forward)
    sweep = np.sign(turns) * (forward + 2 * np.pi * (np.abs(turns) - 1))
    other = end - start
    other[rows, columns[:, 0]] = 0.0
    other[rows, columns[:, 1]] = 0.0
    pitch = np.linalg.norm(other, axis=1) / np.abs(sweep)
    per_rad = np.sqrt(np.maximum(r0, r1) ** 2 + pitch**2)
    return Arcs(index, columns, center, r0, r1, angle0, sweep, other, start, per_rad)


def _column(axes: tuple[str, ...], name: str, lines: I4) -> int:
    if name not in axes:
        raise PlanError(int(lines[0]), name, f"an arc moves axis {name}, but the machine has none")
    return axes.index(name)


def _refuse_bad_radii(moves: Moves, index: Index, r0: F8, r1: F8) -> None:
    bad = (np.abs(r1 - r0) > RADIUS_MISMATCH_MM) | (np.minimum(r0, r1) < 1e-6)
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        line = int(moves.line[index[k]])
        raise PlanError(line, "", f"arc centre at {r0[k]:.4f} mm from the start and {r1[k]:.4f} mm from the end")


def steps_of(arcs: Arcs, chord_mm: F8) -> Index:
    """How many vertices keep each arc within ``chord_mm`` f8[K]: i8[K]."""
    half = np.minimum((8 * chord_mm / np.maximum(arcs.r0, arcs.r1)) ** 0.25, MAX_HALF_STEP)
    return np.asarray(np.maximum(np.ceil(np.abs(arcs.sweep) / (2 * half)), MIN_STEPS).astype(np.intp))


def vertices(arcs: Arcs, steps: Index, lead_in: F8, lead_out: F8) -> F8:
    """All vertices f8[sum(steps), A] of the polygons, arc after arc, end points left out.

    lead_in, lead_out: f8[K], mm of path given up at the ends for the corners there.
    """
    sign = np.sign(arcs.sweep)
    first = lead_in / arcs.per_rad
    width = np.abs(arcs.sweep) - first - lead_out / arcs.per_rad
    half = width / (2 * steps)
    k = np.repeat(np.arange(len(arcs)), steps)
    number = np.arange(len(k)) - np.repeat(np.cumsum(steps) - steps, steps)
    along = first[k] + half[k] * (2 * number + 1)
    share = along / np.abs(arcs.sweep[k])
    radius = (arcs.r0[k] + (arcs.r1[k] - arcs.r0[k]) * share) / np.cos(half[k])
    angle = arcs.angle0[k] + sign[k] * along
    out = arcs.start[k] + arcs.other[k] * share[:, None]
    rows = np.arange(len(k))
    out[rows, arcs.columns[k, 0]] = arcs.center[k, 0] + radius * np.cos(angle)
    out[rows, arcs.columns[k, 1]] = arcs.center[k, 1] + radius * np.sin(angle)
    return np.asarray(out)


def legs(arcs: Arcs, steps: Index, lead_in: F8, lead_out: F8) -> F8:
    """Nominal leg f8[K] of the parabolas of each arc, mm of path."""
    half = (np.abs(arcs.sweep) - (lead_in + lead_out) / arcs.per_rad) / (2 * steps)
    r = np.maximum(arcs.r0, arcs.r1)
    pitch = np.linalg.norm(arcs.other, axis=1) / np.abs(arcs.sweep)
    return np.asarray(np.hypot(r * np.tan(half), pitch * half))


def points(arcs: Arcs, share: F8) -> F8:
    """Points f8[S, A] of the first arc at shares f8[S] of its sweep."""
    out = np.asarray(arcs.start[0] + arcs.other[0] * share[:, None])
    angle = arcs.angle0[0] + arcs.sweep[0] * share
    radius = arcs.r0[0] + (arcs.r1[0] - arcs.r0[0]) * share
    out[:, arcs.columns[0, 0]] = arcs.center[0, 0] + radius * np.cos(angle)
    out[:, arcs.columns[0, 1]] = arcs.center[0, 1] + radius * np.sin(angle)
    return out
