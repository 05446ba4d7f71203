"""The control polygon: all primitives as vertices, each with the leg of the parabola that rounds it.

The picture: a vertex of leg l is cut off by a parabola that starts l before it and ends l after it; the path misses
the vertex by l |dt| / 4, where dt is the difference of the unit tangents, and bends by |q''| = |dt| / (2 l). Vertices
inside an arc have legs that use up their edges; a corner between two moves has the leg that its tolerance allows, at
most half of a straight neighbour. A corner that must not be rounded has leg 0 and is a stop.

A jerk filter of width tau cuts every bend by another |q''| s'^2 tau^2 / 24. Both share the tolerance: the corner
takes what the filter cannot need (acceleration is bounded), or half, and where that is not enough the vertex gets a
cap on s'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner import arcs as arc
from planner.moves import MODE_CONTINUOUS, MODE_CURVE, MODE_EXACT_STOP, Moves
from planner.rotary_table import RotaryTable
from planner.types import F8, I4, Index

SMOOTH = 1e-8
"""|dt| below which two tangents count as equal."""
SHARP = 2 * np.sin(np.radians(150.0) / 2)
"""|dt| of a turn of 150 degrees: beyond it a parabola would cut the tip off, so the corner is a stop."""
EXACT_PATH_MM = 1e-4
"""G61: what rounding of coordinates leaves between tangent arcs may be rounded off within this."""
EXACT_PATH_TURN = 0.01
"""G61: a sharper turn is a stop."""
CHORD_SHARE, CHORD_MOST_MM = 0.01, 1e-4
"""arcs by parabolas: this share of the tolerance, never more than 0.1 um."""
RESERVE, FILTER_RESERVE = 0.02, 0.03
"""shares of the tolerance that nothing plans to use; the second more with a filter, whose a tau^2 / 24 is a near
bound."""


@dataclass(frozen=True, slots=True, eq=False)
class PathRules:
    """What the path stage must know beyond the moves.

    axes: planned axes. rows: f8[R, A] and row_acceleration: f8[R], acceleration limits |rows a| <= row_acceleration.
    tolerance_mm: machine default. tau_s: width of the jerk filter, 0: none. merge_share: of the tolerance, for G64 Q.
    velocity_jump: f8[A] or None, allowed at corners. table: where the program is written on a rotary table.
    """

    axes: tuple[str, ...]
    rows: F8
    row_acceleration: F8
    tolerance_mm: float
    tau_s: float = 0.0
    merge_share: float = 0.3
    velocity_jump: F8 | None = None
    table: RotaryTable | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Polygon:
    """M edges between M + 1 vertices.

    vertex: f8[M + 1, A]. leg: f8[M + 1], mm; 0 where the path keeps the vertex. turn: f8[M + 1], |dt|. stop: bool[M +
    1]. inner: bool[M + 1], vertex inside an arc. cap_mm_s: f8[M + 1], cap on s' in the parabola. feed_mm_s: f8[M],
    cap on s'. line: i4[M]. vertex_of: i8[moves + 1], the vertex after so many moves. miss_mm: f8[M + 1], deviation at
    the vertex. corner_mm_s: f8[M + 1] or None, cap on s' at vertices passed with a jump of velocity, inf elsewhere.
    """

    vertex: F8
    leg: F8
    turn: F8
    stop: npt.NDArray[np.bool_]
    inner: npt.NDArray[np.bool_]
    cap_mm_s: F8
    feed_mm_s: F8
    line: I4
    vertex_of: Index
    miss_mm: F8
    corner_mm_s: F8 | None = None

    def __len__(self) -> int:
        return len(self.line)


@dataclass(frozen=True, slots=True, eq=False)
class _Ends:
    """What the corner rule needs of each move: tangents f8[N, A], length f8[N], curvature f8[N] (0 of lines)."""

    first: F8
    last: F8
    length: F8
    curvature: F8


def polygon_of(moves: Moves, rules: PathRules) -> Polygon:
    """Vertices and legs of ``moves``, with a stop at both ends. Raises PlanError."""
    arcs = arc.arcs_of(moves, rules.axes, moves.begin())
    ends = _ends(moves, arcs)
    net_mm = _net_tolerance(moves, rules)
    corner_mm = np.where(moves.stop | (moves.mode == MODE_EXACT_STOP), 0.0, net_mm)
    lead_in, lead_out = _leads(moves, arcs, ends, _blend_share(ends.first[1:] - ends.last[:-1], corner_mm[:-1], rules))
    chord_mm = np.minimum(moves.tolerance_mm[arcs.index] * CHORD_SHARE, CHORD_MOST_MM)
    steps = arc.steps_of(arcs, np.maximum(chord_mm, 1e-6))
    edges = np.ones(len(moves), dtype=np.intp)
    edges[arcs.index] = steps + 1
    last = np.cumsum(edges)
    count = int(last[-1]) + 1
    vertex = np.empty((count, len(rules.axes)))
    inner, fixed = np.ones(count, dtype=np.bool_), np.zeros(count)
    inner[0] = inner[last] = False
    vertex[0], vertex[last] = moves.start, moves.end
    if len(arcs):
        vertex[inner] = arc.vertices(arcs, steps, lead_in, lead_out)
        fixed[inner] = np.repeat(arc.legs(arcs, steps, lead_in, lead_out), steps)
    return _with_legs(moves, rules, arcs, (vertex, inner, fixed), last, (net_mm, corner_mm))


def _ends(moves: Moves, arcs: arc.Arcs) -> _Ends:
    chord = moves.end - moves.begin()
    length = np.linalg.norm(chord, axis=1)
    curvature = np.zeros(len(moves))
    if not len(arcs):
        tangent = chord / length[:, None]
        return _Ends(tangent, tangent, length, curvature)
    length[arcs.index] = arcs.length()
    first = chord / length[:, None]
    last = first.copy()
    first[arcs.index], last[arcs.index] = arcs.tangents()
    curvature[arcs.index] = np.maximum(arcs.r0, arcs.r1) / arcs.per_rad**2
    return _Ends(first, last, length, curvature)


def _net_tolerance(moves: Moves, rules: PathRules) -> F8:
    """mm f8[N] left to the corner after each move and to the filter, when reserve, chord and merge have theirs."""
    net = moves.tolerance_mm * _usable(rules)
    net = net - np.minimum(net * CHORD_SHARE, CHORD_MOST_MM)
    merge = np.minimum(moves.merge_mm, moves.tolerance_mm * rules.merge_share)
    merge[:-1] = np.maximum(merge[:-1], merge[1:])
    net = np.where(moves.mode == MODE_CONTINUOUS, net - merge, net)
    return np.asarray(np.where(moves.mode < MODE_CONTINUOUS, EXACT_PATH_MM, net))


def _usable(rules: PathRules) -> float:
    return 1 - RESERVE - (FILTER_RESERVE if rules.tau_s > 0 else 0.0)


def _blend_share(dt: F8, net_mm: F8, rules: PathRules) -> F8:
    """mm of ``net_mm`` f8[K] that corners of tangent difference ``dt`` f8[K, A] may take, the filter having its
    part."""
    if rules.tau_s <= 0:
        return net_mm
    return np.asarray(np.maximum(net_mm / 2, net_mm - _most_push(dt, rules) * rules.tau_s**2 / 24))


def _most_push(dt: F8, rules: PathRules) -> F8:
    """Largest component f8[K] in the directions ``dt`` f8[K, A] of any acceleration within the limits.

    More than the limits allow in that direction alone: whoever brakes along an oblique path may bend it harder. The
    corner of the box |a| <= A that is farthest in this direction; and of that of the joints, where there are some.
    """
    axes = dt.shape[1]
    normal = dt / np.maximum(np.linalg.norm(dt, axis=1), SMOOTH)[:, None]
    out = np.abs(normal) @ rules.row_acceleration[:axes]
    joints = rules.rows[axes:]
    if len(joints) and np.linalg.matrix_rank(joints) == axes:
        out = np.minimum(out, np.abs(normal @ np.linalg.pinv(joints)) @ rules.row_acceleration[axes:])
    return np.asarray(out)


def _most_acceleration(dt: F8, rules: PathRules) -> F8:
    """Largest acceleration f8[K] that the limits allow in the directions ``dt`` f8[K, A]."""
    turn = np.maximum(np.linalg.norm(dt, axis=1), SMOOTH)
    along = np.abs(dt @ rules.rows.T) / turn[:, None]
    return np.asarray((rules.row_acceleration / np.maximum(along, 1e-9)).min(axis=1))


def _leads(moves: Moves, arcs: arc.Arcs, ends: _Ends, blend_mm: F8) -> tuple[F8, F8]:
    """What each arc gives up at both ends for the corners there: f8[K] each, mm of path.

    The corner of two curves of curvature k turns by |dt| + k L over legs L and is missed by L (|dt| + k L) / 4. Where
    the corner is only rounding of a tangent joint, a lead of a few |dt| / k is enough.
    """
    lead = np.zeros((2, len(moves)))
    if len(arcs):
        turn = np.linalg.norm(ends.first[1:] - ends.last[:-1], axis=1)
        k = ends.curvature[:-1] + ends.curvature[1:]
        corner = (turn > SMOOTH) & (turn < SHARP) & (blend_mm > 0) & (k > 0)
        corner &= (moves.mode[:-1] >= MODE_CONTINUOUS) | (turn <= EXACT_PATH_TURN)
        with np.errstate(divide="ignore", invalid="ignore"):
            room = 8 * blend_mm / (turn + np.sqrt(turn**2 + 16 * k * blend_mm))
            legs = np.where(corner, np.minimum(room, 10 * turn / k), 0.0)
        lead[1, :-1] = np.minimum(legs, 0.25 * ends.length[:-1])
        lead[0, 1:] = np.minimum(legs, 0.25 * ends.length[1:])
    return lead[0, arcs.index], lead[1, arcs.index]


def _with_legs(
    moves: Moves,
    rules: PathRules,
    arcs: arc.Arcs,
    shape: tuple[F8, npt.NDArray[np.bool_], F8],
    last: Index,
    tolerance: tuple[F8, F8],
) -> Polygon:
    vertex, inner, fixed = shape
    net_mm, corner_mm = tolerance
    edge = np.diff(vertex, axis=0)
    length = np.linalg.norm(edge, axis=1)
    tangent = edge / length[:, None]
    stop = np.zeros(len(vertex), dtype=np.bool_)
    stop[last] = moves.stop
    stop[0] = stop[-1] = True
    allowed = np.zeros(len(vertex))
    allowed[last] = corner_mm
    sharpest = np.full(len(vertex), SHARP)
    sharpest[last[moves.mode < MODE_CONTINUOUS]] = EXACT_PATH_TURN
    sharpest[last[moves.mode == MODE_CURVE]] = np.inf
    dt = np.zeros_like(vertex)
    dt[1:-1] = tangent[1:] - tangent[:-1]
    turn = np.linalg.norm(dt, axis=1)
    allowed = _blend_share(dt, allowed, rules)
    allowed[last[moves.mode == MODE_CURVE]] = np.inf
    leg, sharp = _legs(turn, length, fixed, inner, allowed, stop, sharpest)
    jumps = _jumps(dt, leg, turn, ~inner & ~stop & (turn > SMOOTH) & (turn < SHARP), rules)
    if jumps is not None:
        leg[np.isfinite(jumps)], sharp = 0.0, sharp & np.isinf(jumps)
    move = np.repeat(np.arange(len(moves), dtype=np.int32), np.diff(last, prepend=0))
    miss = np.where(inner | np.isinf(allowed), 0.0, leg * turn / 4)
    cap = _filter_cap(moves, rules, net_mm, move, (leg, dt, miss))
    feed = moves.feed_mm_s[move] * _feed_scale(moves, rules.axes, arcs)[move]
    vertex_of = np.concatenate([[0], last])
    return Polygon(vertex, leg, turn, stop | sharp, inner, cap, feed, moves.line[move], vertex_of, miss, jumps)


def _jumps(dt: F8, leg: F8, turn: F8, corner: npt.NDArray[np.bool_], rules: PathRules) -> F8 | None:
    """Speed f8[M + 1] of the corners that are passed faster with a jump of velocity than with a blend; inf
    elsewhere."""
    if rules.velocity_jump is None or rules.tau_s > 0 or not (rules.velocity_jump > 0).any():
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        jump = np.where(np.abs(dt) < 1e-9, np.inf, rules.velocity_jump / np.abs(dt)).min(axis=1)
        blended = np.sqrt(_most_acceleration(dt, rules) * 2 * leg / np.maximum(turn, SMOOTH))
    return np.where(corner & (jump > np.where(leg > 0, blended, 0.0)), jump, np.inf)


def _legs(
    turn: F8,
    length: F8,
    fixed: F8,
    inner: npt.NDArray[np.bool_],
    allowed: F8,
    stop: npt.NDArray[np.bool_],
    sharpest: F8,
) -> tuple[F8, npt.NDArray[np.bool_]]:
    """Leg of every vertex, and the corners that have to be stops.

    An edge is shared by halves, except that a vertex inside an arc may use all that a lead leaves of its end edge.
    """
    half = length / 2
    end_edge = inner[:-1] != inner[1:]
    other = np.where(inner[:-1], fixed[:-1], fixed[1:])
    for_corner = np.where(end_edge, np.maximum(length - other, 0.0), half)
    for_inner = np.where(end_edge, length, half)
    room = np.full(len(turn), np.inf)
    room[1:] = np.where(inner[1:], for_inner, for_corner)
    room[:-1] = np.minimum(room[:-1], np.where(inner[:-1], for_inner, for_corner))
    free = ~inner & ~stop & (turn > SMOOTH)
    sharp = free & ((turn > sharpest) | (allowed <= 0))
    wanted = np.where(free & ~sharp, 4 * allowed / np.maximum(turn, SMOOTH), 0.0)
    leg = np.minimum(np.where(inner, fixed, wanted), room)
    sharp |= free & (leg < 1e-12)
    leg[sharp | stop] = 0.0
    return leg, sharp


def _filter_cap(moves: Moves, rules: PathRules, net_mm: F8, move: I4, bend: tuple[F8, F8, F8]) -> F8:
    """Cap on s' f8[M + 1] that keeps the jerk filter inside what the blend leaves of the tolerance.

    The filter cuts the vertex by the acceleration in the direction of dt, weighted by (tau / 2 - |t|)^2 / (2 tau):
    the bend's while it lasts, that of the neighbours in the rest of the window, which is unknown but bounded. Where
    even the bound everywhere is within the tolerance there is no cap; elsewhere the cap is found by halving.
    """
    leg, dt, miss = bend
    cap = np.full(len(leg), np.inf)
    tau = rules.tau_s
    if tau <= 0:
        return cap
    share = np.where(moves.mode < MODE_CONTINUOUS, rules.tolerance_mm * _usable(rules), net_mm)
    # a corner has the tolerance of the move that ends there, as its blend has
    left = np.append(share[:1], share[move])
    left = np.maximum(left - miss, 0.01 * left)
    turn = np.linalg.norm(dt, axis=1)
    most = _most_push(dt, rules)
    k = np.flatnonzero((leg > 0) & (turn > SMOOTH) & (most * tau**2 / 24 > left))
    leg, turn, most, left = leg[k], turn[k], most[k], left[k]
    high = np.sqrt(24 * left * 2 * leg / turn) / tau
    low = np.zeros(len(k))
    for _ in range(24):
        v = (low + high) / 2
        outside = np.maximum(1 - 2 * leg / np.maximum(v * tau, 1e-12), 0.0) ** 3
        bent = np.minimum(turn / (2 * leg) * v**2, most)
        good = (bent * (1 - outside) + most * outside) * tau**2 / 24 <= left
        low, high = np.where(good, v, low), np.where(good, high, v)
    cap[k] = low
    return cap


def _feed_scale(moves: Moves, axes: tuple[str, ...], arcs: arc.Arcs) -> F8:
    """s per mm of the length that F speaks of: XYZ if one of them moves, else UVW, else the rotary axes."""
    groups = [[k for k, a in enumerate(axes) if a in names] for names in ("XYZ", "UVW", "ABC")]
    if len(groups[0]) == len(axes):
        return np.ones(len(moves))
    delta = moves.end - moves.begin()
    total = np.linalg.norm(delta, axis=1)
    parts = [np.linalg.norm(delta[:, g], axis=1) for g in groups]
    if len(arcs):
        total[arcs.index] = arcs.length()
        plane = np.maximum(arcs.r0, arcs.r1) * np.abs(arcs.sweep)
        parts[0][arcs.index] = np.hypot(plane, np.linalg.norm(arcs.other[:, groups[0]], axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(parts[0] > 0, total / parts[0], np.where(parts[1] > 0, total / parts[1], total / parts[2]))
    return np.asarray(scale)
