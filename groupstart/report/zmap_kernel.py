"""Compiled height map: the lowest place that the flat end of a tool has reached over each cell."""

# numba carries no types:
# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

import math

import numpy.typing as npt
from numba import njit
from numpy import float64

F8 = npt.NDArray[float64]


@njit(cache=True)
def cut(height: F8, q: F8, low_x: float, low_y: float, cell: float, radius: float) -> None:
    """Lower ``height`` f8[rows, columns] by a flat tool along the polyline q f8[N, 3]; cell centres are judged.

    Over each stretch the tool's lowest place above a cell is found exactly: the part of the stretch within the radius
    is an interval, and height is linear in it.
    """
    rows, columns = height.shape
    for k in range(len(q) - 1):
        x0, y0, z0 = q[k, 0], q[k, 1], q[k, 2]
        dx, dy, dz = q[k + 1, 0] - x0, q[k + 1, 1] - y0, q[k + 1, 2] - z0
        first_c = max(math.ceil((min(x0, x0 + dx) - radius - low_x) / cell - 0.5), 0)
        last_c = min(math.floor((max(x0, x0 + dx) + radius - low_x) / cell - 0.5), columns - 1)
        first_r = max(math.ceil((min(y0, y0 + dy) - radius - low_y) / cell - 0.5), 0)
        last_r = min(math.floor((max(y0, y0 + dy) + radius - low_y) / cell - 0.5), rows - 1)
        length2 = dx * dx + dy * dy
        lowest = min(z0, z0 + dz)
        for r in range(first_r, last_r + 1):
            py = low_y + (r + 0.5) * cell - y0
            for c in range(first_c, last_c + 1):
                if height[r, c] <= lowest:
                    continue
                px = low_x + (c + 0.5) * cell - x0
                if length2 < 1e-18:
                    if px * px + py * py <= radius * radius:
                        height[r, c] = min(height[r, c], lowest)
                    continue
                along = (px * dx + py * dy) / length2
                off2 = px * px + py * py - along * along * length2
                if off2 > radius * radius:
                    continue
                half = math.sqrt(max(radius * radius - off2, 0.0) / length2)
                begin, end = max(along - half, 0.0), min(along + half, 1.0)
                if begin <= end:
                    height[r, c] = min(height[r, c], z0 + dz * (end if dz < 0 else begin))
