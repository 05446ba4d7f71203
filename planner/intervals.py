"""Control polygon to interval arrays: per edge a straight line, per rounded vertex a parabola cut into some
intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from planner.polygon import PathRules, Polygon
from planner.types import F8, Index, Intervals

SHORTEST_LINE_MM = 1e-9
CUTS = (2, 4, 8)
"""intervals of a corner's parabola, even, so that each half belongs to one move. s'' is constant inside an interval;
what that loses matters only on dense files whose bends are limited by acceleration, so only those are cut finely."""
FINE_FROM = (0.2, 0.6)
"""share of the bend's acceleration limit at full feed from which 4 and 8 intervals are used."""
DENSE = 0.3
"""leg over edge from which a corner counts as part of a dense chain."""


def intervals_of(polygon: Polygon, rules: PathRules) -> tuple[Intervals, Index]:
    """The interval arrays of ``polygon``, and the node i8[M + 1] at or after each vertex.

    A vertex inside an arc is one interval, a corner several.
    """
    edge = np.diff(polygon.vertex, axis=0)
    length = np.linalg.norm(edge, axis=1)
    tangent = edge / length[:, None]
    straight = length - polygon.leg[:-1] - polygon.leg[1:]
    has_line = straight > SHORTEST_LINE_MM
    cuts = _cuts(polygon, rules, tangent, length)
    count = has_line + cuts[1:]
    first = np.cumsum(count) - count
    n = int(count.sum())
    bound = np.full(n, np.inf) if rules.tau_s > 0 else None
    a = edge.shape[1]
    out = Intervals(
        np.empty(n), np.empty((n, a)), np.empty((n, a)), np.empty((n, a)), np.empty(n),
        np.empty(n, dtype=np.int32), np.zeros(n + 1, dtype=np.bool_), bound,
    )  # fmt: skip
    at = first[has_line]
    out.length[at] = straight[has_line]
    out.start[at] = polygon.vertex[:-1][has_line] + tangent[has_line] * polygon.leg[:-1][has_line, None]
    out.tangent_in[at] = tangent[has_line]
    out.tangent_out[at] = tangent[has_line]
    out.feed_mm_s[at] = polygon.feed_mm_s[has_line]
    out.line[at] = polygon.line[has_line]
    for cut in (1, *CUTS):
        corners = np.flatnonzero(cuts == cut)
        if len(corners):
            _corners(out, polygon, corners, (first + has_line)[corners - 1], tangent, cut)
    node = np.append(first, n)
    out.stop[node[polygon.stop]] = True
    if polygon.corner_mm_s is not None:
        corner = np.full(n + 1, np.inf)
        at = np.flatnonzero(np.isfinite(polygon.corner_mm_s))
        corner[node[at]] = polygon.corner_mm_s[at]
        out = replace(out, corner_mm_s=corner)
    return out, node


def _cuts(polygon: Polygon, rules: PathRules, tangent: F8, length: F8) -> npt.NDArray[np.intp]:
    """Intervals of the parabola of each vertex, 0 where there is none."""
    out = np.where(polygon.leg > 0, np.where(polygon.inner, 1, CUTS[0]), 0)
    out[0] = out[-1] = 0
    share = np.zeros(len(out))
    share[1:] = polygon.leg[1:] / length
    share[:-1] = np.maximum(share[:-1], polygon.leg[:-1] / length)
    dense = np.flatnonzero((out == CUTS[0]) & (share > DENSE))
    if len(dense):
        dt = tangent[dense] - tangent[dense - 1]
        bend = np.abs(dt @ rules.rows.T) / rules.row_acceleration
        feed = np.minimum(np.minimum(polygon.feed_mm_s[dense - 1], polygon.feed_mm_s[dense]), 1e4)
        used = bend.max(axis=1) / (2 * polygon.leg[dense]) * feed**2
        out[dense[used > FINE_FROM[0]]] = CUTS[1]
        out[dense[used > FINE_FROM[1]]] = CUTS[2]
    return out


def _corners(out: Intervals, polygon: Polygon, corners: Index, first: Index, tangent: F8, cut: int) -> None:
    """Fill the parabolas of the vertices ``corners``, ``cut`` intervals each from index ``first`` on."""
    leg = polygon.leg[corners]
    t0, t1 = tangent[corners - 1], tangent[corners]
    begin = polygon.vertex[corners] - t0 * leg[:, None]
    bend = (t1 - t0) / (2 * leg)[:, None]
    feed0, feed1 = polygon.feed_mm_s[corners - 1], polygon.feed_mm_s[corners]
    for k in range(cut):
        at = first + k
        z0, z1 = 2 * leg * k / cut, 2 * leg * (k + 1) / cut
        out.length[at] = z1 - z0
        if out.bound_mm_s is not None:
            out.bound_mm_s[at] = polygon.cap_mm_s[corners]
        out.start[at] = begin + (t0 + bend * (z0 / 2)[:, None]) * z0[:, None]
        out.tangent_in[at] = t0 + bend * z0[:, None] if k else t0
        out.tangent_out[at] = t0 + bend * z1[:, None] if k + 1 < cut else t1
        if cut == 1:
            out.feed_mm_s[at] = np.minimum(feed0, feed1)
            out.line[at] = polygon.line[corners]
        else:
            out.feed_mm_s[at] = feed0 if 2 * k < cut else feed1
            out.line[at] = polygon.line[corners - 1] if 2 * k < cut else polygon.line[corners]
