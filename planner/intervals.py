"""Control polygon to interval arrays: per edge a straight line, per rounded vertex a parabola cut into a few
intervals."""

from __future__ import annotations

import numpy as np

from planner.polygon import Polygon
from planner.types import F8, Index, Intervals

PARABOLA_PARTS = 4
"""intervals of a corner's parabola (even, so that each half belongs to one move): 4 leave 0.2 % of time on dense
files."""
SHORTEST_LINE_MM = 1e-9


def intervals_of(polygon: Polygon, parts: int = PARABOLA_PARTS) -> tuple[Intervals, Index]:
    """The interval arrays of ``polygon``, and the node i8[M + 1] at or after each vertex.

    parts: even number of intervals of a corner (an arc's vertex is one interval).
    """
    m = len(polygon)
    edge = np.diff(polygon.vertex, axis=0)
    length = np.linalg.norm(edge, axis=1)
    tangent = edge / length[:, None]
    leg = polygon.leg
    straight = length - leg[:-1] - leg[1:]
    pieces = np.where(leg > 0, np.where(polygon.inner, 1, parts), 0)
    pieces[0] = 0
    has_line = straight > SHORTEST_LINE_MM
    count = has_line + pieces[1:]
    first = np.cumsum(count) - count
    n = int(count.sum())
    out = Intervals(
        np.empty(n), np.empty((n, edge.shape[1])), np.empty((n, edge.shape[1])), np.empty((n, edge.shape[1])),
        np.empty(n), np.empty(n, dtype=np.int32), np.zeros(n + 1, dtype=np.bool_),
    )  # fmt: skip
    at = first[has_line]
    out.length[at] = straight[has_line]
    out.start[at] = polygon.vertex[:-1][has_line] + tangent[has_line] * leg[:-1][has_line, None]
    out.tangent_in[at] = tangent[has_line]
    out.tangent_out[at] = tangent[has_line]
    out.feed_mm_s[at] = polygon.feed_mm_s[has_line]
    out.line[at] = polygon.line[has_line]
    for inner, cut in ((True, 1), (False, parts)):
        corners = np.flatnonzero((leg[1:-1] > 0) & (polygon.inner[1:-1] == inner)) + 1 if m > 1 else np.zeros(0, int)
        _corners(out, polygon, corners, (first + has_line)[corners - 1], tangent, cut)
    out.stop[first[polygon.stop[:-1]]] = True
    out.stop[n] = True
    return out, np.append(first, n)


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
        out.start[at] = begin + (t0 + bend * (z0 / 2)[:, None]) * z0[:, None]
        out.tangent_in[at] = t0 + bend * z0[:, None]
        out.tangent_out[at] = t0 + bend * z1[:, None]
        if cut == 1:
            out.feed_mm_s[at] = np.minimum(feed0, feed1)
            out.line[at] = polygon.line[corners]
        else:
            out.feed_mm_s[at] = feed0 if 2 * k < cut else feed1
            out.line[at] = polygon.line[corners - 1] if 2 * k < cut else polygon.line[corners]
