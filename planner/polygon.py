"""The control polygon: all primitives as vertices, each with the leg of the parabola that rounds it.

The picture: a vertex of leg l is cut off by a parabola that starts l before it and ends l after it; the path misses
the vertex by l |dt| / 4, where dt is the difference of the unit tangents. Vertices inside an arc have legs that use
up their edges; a corner between two moves has the leg that its tolerance allows, at most half of a straight
neighbour. A corner that must not be rounded has leg 0 and is a stop.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from planner import arcs as arc
from planner.moves import KIND_RAPID, MODE_CONTINUOUS, MODE_EXACT_STOP, Moves
from planner.types import F8, I4, Index

SHORTEST_MM = 1e-6
"""moves shorter than this are folded into their neighbour."""
SMOOTH = 1e-8
"""|dt| below which two tangents count as equal."""
SHARP = 2 * np.sin(np.radians(150.0) / 2)
"""|dt| of a turn of 150 degrees: beyond it a parabola would cut the tip off, so the corner is a stop."""
EXACT_PATH_MM = 1e-4
"""G61: what rounding of coordinates leaves between tangent arcs may be rounded off within this."""


@dataclass(frozen=True, slots=True, eq=False)
class Budget:
    """Shares of the path tolerance, as fractions of G64 P; the rest is reserve.

    merge: naive-CAM merge. blend: corners. chord: arcs by parabolas. filter: jerk filter.
    """

    merge: float = 0.0
    blend: float = 0.97
    chord: float = 0.01
    filter: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Polygon:
    """M edges between M + 1 vertices.

    vertex: f8[M + 1, A]. leg: f8[M + 1], mm; 0 where the path keeps the vertex. stop: bool[M + 1]. inner: bool[M +
    1], vertex inside an arc or curve. feed_mm_s: f8[M], cap on s'. line: i4[M]. rapid: bool[M]. vertex_of: i8[moves +
    1], the vertex reached after so many moves.
    """

    vertex: F8
    leg: F8
    stop: npt.NDArray[np.bool_]
    inner: npt.NDArray[np.bool_]
    feed_mm_s: F8
    line: I4
    rapid: npt.NDArray[np.bool_]
    vertex_of: Index

    def __len__(self) -> int:
        return len(self.line)


@dataclass(frozen=True, slots=True, eq=False)
class _Ends:
    """What the corner rule needs of each move: tangents f8[N, A], length f8[N], curvature f8[N] (0 of lines)."""

    first: F8
    last: F8
    length: F8
    curvature: F8


def polygon_of(moves: Moves, axes: tuple[str, ...], budget: Budget) -> Polygon:
    """Vertices and legs of ``moves`` (which start and end at rest). Raises PlanError."""
    begin = np.concatenate([moves.start[None, :], moves.end[:-1]]) if len(moves) else moves.end
    arcs = arc.arcs_of(moves, axes, begin)
    keep = _keep(moves, begin, arcs)
    if not keep.all():
        folded = polygon_of(_only(moves, keep), axes, budget)
        kept = np.concatenate([[0], np.cumsum(keep)])
        return replace(folded, vertex_of=folded.vertex_of[kept])
    ends = _ends(moves, begin, arcs)
    tolerance = _corner_tolerance(moves)
    turn = np.linalg.norm(ends.first[1:] - ends.last[:-1], axis=1)
    lead_in, lead_out = _leads(moves, arcs, ends, turn, tolerance * budget.blend)
    chord = float(tolerance[tolerance > 0].min(initial=0.01)) * budget.chord if len(moves) else 1e-4
    return _assemble(moves, axes, begin, arcs, (lead_in, lead_out), tolerance * budget.blend, min(chord, 1e-4))


def _only(moves: Moves, keep: npt.NDArray[np.bool_]) -> Moves:
    """The moves to keep; a dropped stop and a dropped end point move to the move before (or after)."""
    kept = np.flatnonzero(keep)
    stop = np.logical_or.reduceat(moves.stop, kept) if len(kept) else moves.stop[:0]
    end = moves.end[kept].copy()
    if len(kept):
        end[-1] = moves.end[-1]
    nurbs = {int(np.searchsorted(kept, k)): v for k, v in moves.nurbs.items()}
    return Moves(
        moves.start, moves.kind[kept], moves.line[kept], end, moves.feed_mm_s[kept], moves.plane[kept],
        moves.center[kept], moves.turns[kept], moves.mode[kept], moves.tolerance_mm[kept], moves.merge_mm[kept],
        stop, nurbs, moves.rest_first,
    )  # fmt: skip


def _keep(moves: Moves, begin: F8, arcs: arc.Arcs) -> npt.NDArray[np.bool_]:
    """Moves long enough to be edges; a chain of tiny ones is walked so that it cannot vanish as a whole."""
    length = np.linalg.norm(moves.end - begin, axis=1)
    length[arcs.index] = arcs.length()
    keep = np.asarray(length >= SHORTEST_MM)
    if keep.all():
        return keep
    held = moves.start
    for k in range(len(moves)):
        if not keep[k] and float(np.linalg.norm(moves.end[k] - held)) >= SHORTEST_MM:
            keep[k] = True
        if keep[k]:
            held = moves.end[k]
    return keep


def _ends(moves: Moves, begin: F8, arcs: arc.Arcs) -> _Ends:
    chord = moves.end - begin
    length = np.linalg.norm(chord, axis=1)
    length[arcs.index] = 1.0
    tangent = chord / length[:, None]
    first, last = tangent, tangent
    curvature = np.zeros(len(moves))
    if len(arcs):
        first, last = tangent.copy(), tangent.copy()
        first[arcs.index], last[arcs.index] = arcs.tangents()
        length[arcs.index] = arcs.length()
        curvature[arcs.index] = np.maximum(arcs.r0, arcs.r1) / arcs.per_rad**2
    return _Ends(first, last, length, curvature)


def _corner_tolerance(moves: Moves) -> F8:
    """mm by which the corner after each move but the last may be missed; 0: not at all."""
    tolerance = np.where(moves.mode == MODE_CONTINUOUS, moves.tolerance_mm, EXACT_PATH_MM)
    tolerance = np.where(moves.stop | (moves.mode == MODE_EXACT_STOP), 0.0, tolerance)
    return np.asarray(tolerance[:-1])


def _leads(moves: Moves, arcs: arc.Arcs, ends: _Ends, turn: F8, blend_mm: F8) -> tuple[F8, F8]:
    """What each arc gives up at both ends for the corners there: f8[K] each, mm of path.

    The corner of two curves of curvature k turns by |dt| + k L over legs L and is missed by L (|dt| + k L) / 4. Where
    the corner is only rounding of a tangent joint, a lead of a few |dt| / k is enough.
    """
    lead = np.zeros((2, len(moves)))
    k = ends.curvature[:-1] + ends.curvature[1:]
    corner = (turn > SMOOTH) & (turn < SHARP) & (blend_mm > 0) & (k > 0)
    corner &= ~((moves.mode[:-1] != MODE_CONTINUOUS) & (turn > 0.01))
    with np.errstate(divide="ignore", invalid="ignore"):
        room = 8 * blend_mm / (turn + np.sqrt(turn**2 + 16 * k * blend_mm))
        legs = np.where(corner, np.minimum(room, 10 * turn / k), 0.0)
    lead[1, :-1] = np.minimum(legs, 0.25 * ends.length[:-1])
    lead[0, 1:] = np.minimum(legs, 0.25 * ends.length[1:])
    return lead[0, arcs.index], lead[1, arcs.index]


def _assemble(
    moves: Moves, axes: tuple[str, ...], begin: F8, arcs: arc.Arcs, leads: tuple[F8, F8], blend_mm: F8, chord_mm: float
) -> Polygon:
    n = len(moves)
    edges = np.ones(n, dtype=np.intp)
    steps = arc.steps_of(arcs, chord_mm)
    edges[arcs.index] = steps + 1
    move = np.repeat(np.arange(n, dtype=np.int32), edges)
    last = np.cumsum(edges)
    vertex = np.empty((len(move) + 1, len(axes)))
    inner = np.ones(len(move) + 1, dtype=np.bool_)
    inner[0] = False
    inner[last] = False
    vertex[0] = moves.start
    vertex[last] = moves.end
    fixed = np.zeros(len(move) + 1)
    if len(arcs):
        vertex[inner] = arc.vertices(arcs, steps, *leads)
        fixed[inner] = np.repeat(arc.legs(arcs, steps, *leads), steps)
    edge = np.diff(vertex, axis=0)
    length = np.linalg.norm(edge, axis=1)
    tangent = edge / length[:, None]
    stop = np.zeros(len(move) + 1, dtype=np.bool_)
    stop[last] = moves.stop
    stop[0] = stop[-1] = True
    allowed = np.zeros(len(move) + 1)
    allowed[last[:-1]] = blend_mm
    exact = np.zeros(len(move) + 1, dtype=np.bool_)
    exact[last] = moves.mode != MODE_CONTINUOUS
    leg, sharp = _legs(tangent, length, fixed, inner, allowed, stop, exact)
    rapid = moves.kind[move] == KIND_RAPID
    feed = moves.feed_mm_s[move] * _feed_scale(moves, axes, begin, arcs)[move]
    vertex_of = np.concatenate([[0], last])
    return Polygon(vertex, leg, stop | sharp, inner, feed, moves.line[move], rapid, vertex_of)


def _legs(
    tangent: F8,
    length: F8,
    fixed: F8,
    inner: npt.NDArray[np.bool_],
    allowed: F8,
    stop: npt.NDArray[np.bool_],
    exact: npt.NDArray[np.bool_],
) -> tuple[F8, npt.NDArray[np.bool_]]:
    """Leg of every vertex, and the corners that have to be stops."""
    turn = np.zeros(len(length) + 1)
    turn[1:-1] = np.linalg.norm(tangent[1:] - tangent[:-1], axis=1)
    before, after = np.zeros_like(turn), np.zeros_like(turn)
    # an edge is shared by halves, except that a vertex inside an arc may use all that a lead leaves of its end edge
    inner_leg = np.where(inner, fixed, 0.0)
    end_edge = inner[:-1] != inner[1:]
    half = length / 2
    other = np.where(inner[:-1], inner_leg[:-1], inner_leg[1:])
    for_corner = np.where(end_edge, np.maximum(length - other, 0.0), half)
    for_inner = np.where(end_edge, length, half)
    before[1:] = np.where(inner[1:], for_inner, for_corner)
    after[:-1] = np.where(inner[:-1], for_inner, for_corner)
    room = np.minimum(before, after)
    free = ~inner & ~stop & (turn > SMOOTH)
    sharp = free & ((turn > SHARP) | (allowed <= 0) | (exact & (turn > 0.01)))
    with np.errstate(divide="ignore"):
        wanted = np.where(free & ~sharp, 4 * allowed / np.maximum(turn, SMOOTH), 0.0)
    leg = np.where(inner, np.minimum(fixed, room), np.minimum(wanted, room))
    sharp |= free & (leg < 1e-7 * SHORTEST_MM)
    leg[sharp | stop] = 0.0
    return leg, sharp


def _feed_scale(moves: Moves, axes: tuple[str, ...], begin: F8, arcs: arc.Arcs) -> F8:
    """s per mm of the length that F speaks of: XYZ if one of them moves, else UVW, else the rotary axes."""
    groups = [[k for k, a in enumerate(axes) if a in names] for names in ("XYZ", "UVW", "ABC")]
    if len(groups[0]) == len(axes):
        return np.ones(len(moves))
    delta = moves.end - begin
    total = np.linalg.norm(delta, axis=1)
    parts = [np.linalg.norm(delta[:, g], axis=1) for g in groups]
    if len(arcs):
        total[arcs.index] = arcs.length()
        plane = np.maximum(arcs.r0, arcs.r1) * np.abs(arcs.sweep)
        parts[0][arcs.index] = np.hypot(plane, np.linalg.norm(arcs.other[:, groups[0]], axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(parts[0] > 0, total / parts[0], np.where(parts[1] > 0, total / parts[1], total / parts[2]))
    return np.asarray(scale)
