"""Rotary table: the work turns with a rotary axis, and the program is written in the work's own coordinates.

A point p of the work at table angle theta is at centre + R(theta) (p - centre) of the machine. A straight move of the
program with a turning table is therefore a curve of the linear joints: it is cut into short pieces whose control
points follow the curve (as splines are), and its feed becomes a time, so that the tool moves over the work at F. With
the table at rest, lines stay lines and arcs about the table's axis stay arcs. The planner then works in joints, with
the joints' own limits.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from planner import arcs as arc
from planner.errors import PlanError
from planner.moves import COLUMNS, KIND_ARC, KIND_FEED, MODE_CURVE, Mark, Moves, join
from planner.nurbs import chain_of
from planner.types import F8

CHORD_MM = 2e-4
"""spacing: a chord leaves the curve by at most this; the control points then follow it far more closely."""
MOST_PIECES = 5000
_TURNS_ABOUT = {"A": ("Y", "Z"), "B": ("Z", "X"), "C": ("X", "Y")}


@dataclass(frozen=True, slots=True)
class RotaryTable:
    """axis: "A", "B" or "C" that turns the work. center: where its axis stands, machine mm, in the two axes that it
    turns (A: Y Z, B: Z X, C: X Y). direction: +1 if a positive angle turns the work counter-clockwise, else -1.
    """

    axis: str
    center: tuple[float, float]
    direction: int = 1

    def columns(self, axes: tuple[str, ...]) -> tuple[int, int, int]:
        """Columns of the two turned axes and of the rotary axis. Raises PlanError where the machine lacks one."""
        names = (*_TURNS_ABOUT[self.axis], self.axis)
        missing = next((a for a in names if a not in axes), None)
        if missing:
            raise PlanError(0, missing, f"a rotary table {self.axis} needs axis {missing}")
        return axes.index(names[0]), axes.index(names[1]), axes.index(names[2])

    def joints(self, q: F8, axes: tuple[str, ...]) -> F8:
        """Machine positions f8[N, A] of program positions f8[N, A]."""
        return self._turned(q, axes, 1)

    def axes_of(self, joints: F8, axes: tuple[str, ...]) -> F8:
        """Program positions f8[N, A] of machine positions f8[N, A]."""
        return self._turned(joints, axes, -1)

    def _turned(self, q: F8, axes: tuple[str, ...], sign: int) -> F8:
        i, j, k = self.columns(axes)
        angle = np.radians(q[:, k]) * self.direction * sign
        x, y = q[:, i] - self.center[0], q[:, j] - self.center[1]
        out = q.copy()
        out[:, i] = self.center[0] + np.cos(angle) * x - np.sin(angle) * y
        out[:, j] = self.center[1] + np.sin(angle) * x + np.cos(angle) * y
        return out


def to_joints(table: RotaryTable, moves: Moves, marks: list[Mark], axes: tuple[str, ...]) -> tuple[Moves, list[Mark]]:
    """The same motion in machine positions, and the marks at their new places. Raises PlanError."""
    _, _, k = table.columns(axes)
    if not len(moves):
        return replace(moves, start=table.joints(moves.start[None, :], axes)[0]), marks
    begin = moves.begin()
    turns = begin[:, k] != moves.end[:, k]
    angle = np.radians(begin[:, k]) * table.direction
    flat = (moves.kind == KIND_ARC) & ~turns & (moves.plane == "CBA".index(table.axis))
    tilted = (moves.kind == KIND_ARC) & ~flat & ((angle != 0) | turns)
    parts: list[Moves] = []
    count = np.zeros(len(moves) + 1, dtype=np.intp)
    at = 0
    for m in np.flatnonzero(turns | tilted):
        if m > at:
            parts.append(_rigid(table, moves.part(at, int(m)), axes, angle[at:m], flat[at:m]))
            count[at + 1 : m + 1] = 1
        parts.append(_curve(table, moves, int(m), axes))
        count[m + 1] = len(parts[-1])
        at = int(m) + 1
    if at < len(moves):
        parts.append(_rigid(table, moves.part(at, len(moves)), axes, angle[at:], flat[at:]))
        count[at + 1 :] = 1
    place = np.cumsum(count)
    parts[0] = replace(parts[0], rest_first=moves.rest_first)
    out = join([parts[0], *(replace(p, rest_first=False) for p in parts[1:])])
    return out, [replace(m, moves=int(place[m.moves])) for m in marks]


def _rigid(table: RotaryTable, moves: Moves, axes: tuple[str, ...], angle: F8, flat: npt.NDArray[np.bool_]) -> Moves:
    """Moves with the table at rest: turned as a whole."""
    start = table.joints(moves.start[None, :], axes)[0]
    center = moves.center.copy()
    x, y = center[flat, 0] - table.center[0], center[flat, 1] - table.center[1]
    center[flat, 0] = table.center[0] + np.cos(angle[flat]) * x - np.sin(angle[flat]) * y
    center[flat, 1] = table.center[1] + np.sin(angle[flat]) * x + np.cos(angle[flat]) * y
    return replace(moves, start=start, end=table.joints(moves.end, axes), center=center)


def _curve(table: RotaryTable, moves: Moves, m: int, axes: tuple[str, ...]) -> Moves:
    """One move with the table turning, or an arc in a plane that the table has tilted: short pieces of one curve."""
    one = moves.part(m, m + 1)
    i, j, k = table.columns(axes)
    begin, end = one.start, one.end[0]
    arcs = arc.arcs_of(one, axes, begin[None, :])
    sweep = np.radians(abs(end[k] - begin[k]))
    bend = sweep + (float(np.abs(arcs.sweep[0])) if len(arcs) else 0.0)
    reach = max(float(np.hypot(p[i] - table.center[0], p[j] - table.center[1])) for p in (begin, end))
    length = float(arcs.length()[0]) if len(arcs) else float(np.linalg.norm((end - begin)[[i, j]]))
    reach += length if len(arcs) else 0.0
    curved = reach * bend**2 + 2 * length * bend
    n = int(np.clip(np.ceil(np.sqrt(curved / (8 * CHORD_MM))), 8, MOST_PIECES))
    share = np.linspace(0.0, 1.0, n + 1)
    program = arc.points(arcs, share) if len(arcs) else begin + (end - begin) * share[:, None]
    control = chain_of(table.joints(program, axes))
    columns = {name: np.repeat(getattr(one, name), n, axis=0) for name in COLUMNS}
    columns["kind"][:] = KIND_FEED
    columns["end"] = control[1:]
    columns["mode"][:-1] = MODE_CURVE
    columns["stop"][:-1] = False
    columns["feed_mm_s"] = _feeds(one, control, program, axes)
    return Moves(control[0], False, **columns)


def _feeds(one: Moves, control: F8, program: F8, axes: tuple[str, ...]) -> F8:
    """Feed of each piece in machine coordinates so that the program's own feed holds over the work."""
    feed = float(one.feed_mm_s[0])
    if not np.isfinite(feed):
        return np.full(len(control) - 1, np.inf)
    groups = [[c for c, a in enumerate(axes) if a in names] for names in ("XYZ", "UVW", "ABC")]

    def measure(points: F8) -> F8:
        parts = [np.linalg.norm(np.diff(points[:, g], axis=0), axis=1) for g in groups]
        return np.asarray(np.where(parts[0] > 0, parts[0], np.where(parts[1] > 0, parts[1], parts[2])))

    over_work, in_machine = measure(program), measure(control)  # where only the table turns, F is that of its axis
    return np.asarray(feed * in_machine / over_work)
