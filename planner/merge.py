"""Compiled greedy merge of near-collinear moves; see planner.fold."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nmc.native import native
from planner.types import F8

Flags = npt.NDArray[np.bool_]


@native()
def _worst(
    anchor: F8, end: F8, index: npt.NDArray[np.intp], first: int, last: int, target: int, tolerance: F8
) -> float:
    """Largest distance of the vertices index[first..last] from anchor-target; -1 if one is too far or out of order."""
    axes = len(anchor)
    d2 = 0.0
    for k in range(axes):
        d2 += (end[target, k] - anchor[k]) ** 2
    if d2 <= 0.0:
        return -1.0
    worst, before = 0.0, 0.0
    for j in range(first, last + 1):
        v = index[j]
        along = 0.0
        for k in range(axes):
            along += (end[v, k] - anchor[k]) * (end[target, k] - anchor[k])
        along /= d2
        if along <= before or along >= 1.0:
            return -1.0
        before = along
        off2 = 0.0
        for k in range(axes):
            off2 += (end[v, k] - anchor[k] - along * (end[target, k] - anchor[k])) ** 2
        off = np.sqrt(off2)
        if off > tolerance[v]:
            return -1.0
        worst = max(worst, off)
    return worst


@native("void(f8[::1], f8[:, ::1], b1[::1], f8, b1[::1])")
def drop_tiny(start: F8, end: F8, arc: Flags, shortest_mm: float, keep: Flags) -> None:
    """Clear ``keep`` of moves that end nearer than shortest_mm to the last kept end; arcs are kept."""
    axes = len(start)
    held = start
    for m in range(len(end)):
        far2 = 0.0
        for k in range(axes):
            far2 += (end[m, k] - held[k]) ** 2
        if arc[m] or far2 >= shortest_mm * shortest_mm:
            held = end[m]
        else:
            keep[m] = False


@native("f8(f8[::1], f8[:, ::1], f8[::1], b1[::1], i8, b1[::1])")
def merge(start: F8, end: F8, tolerance: F8, joint: Flags, longest: int, keep: Flags) -> float:
    """Clear ``keep`` of moves whose end may go; returns the largest distance of a dropped vertex, mm.

    end: f8[N, A]. tolerance: f8[N], mm. joint: bool[N], the end of the move may be dropped. longest: moves in a chain.
    """
    index = np.flatnonzero(keep)
    anchor = start
    first, greatest, chain_worst = 0, 0.0, 0.0
    for j in range(len(index) - 1):
        worst = -1.0
        if joint[index[j]] and j - first + 1 < longest:
            worst = _worst(anchor, end, index, first, j, index[j + 1], tolerance)
        if worst >= 0.0:
            keep[index[j]] = False
            chain_worst = worst
        else:
            anchor = end[index[j]]
            first = j + 1
            greatest = max(greatest, chain_worst)
            chain_worst = 0.0
    return max(greatest, chain_worst)
