"""Compiled thinning of a sampled path: which samples a picture needs."""

# numba carries no types:
# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from numba import njit

F8 = npt.NDArray[np.float64]
WINDOW = 96
"""samples that one kept stretch may replace in one pass"""


@njit(cache=True)
def _fits(t: F8, q: F8, speed: F8, first: int, last: int, tolerance_mm: float, tolerance_mm_s: float) -> bool:
    """Whether the samples between ``first`` and ``last`` lie on the straight stretch between them."""
    axes = q.shape[1]
    length2 = 0.0
    for a in range(axes):
        edge = q[last, a] - q[first, a]
        length2 += edge * edge
    span_s = t[last] - t[first]
    for k in range(first + 1, last):
        along = 0.0
        for a in range(axes):
            along += (q[k, a] - q[first, a]) * (q[last, a] - q[first, a])
        u = 0.0 if length2 == 0.0 else min(max(along / length2, 0.0), 1.0)
        off2 = 0.0
        for a in range(axes):
            gap = q[k, a] - q[first, a] - u * (q[last, a] - q[first, a])
            off2 += gap * gap
        if math.sqrt(off2) > tolerance_mm:
            return False
        share = 0.0 if span_s <= 0.0 else (t[k] - t[first]) / span_s
        if abs(speed[k] - speed[first] - share * (speed[last] - speed[first])) > tolerance_mm_s:
            return False
    return True


@njit(cache=True)
def thin(
    t: F8, q: F8, speed: F8, key: npt.NDArray[np.int64], tolerance_mm: float, tolerance_mm_s: float
) -> npt.NDArray[np.int64]:
    """Indices of the samples to keep, first and last included.

    t f8[N], q f8[N, A], speed f8[N]; key i8[N - 1] of each stretch: stretches of unlike keys are never joined. What
    is left out lies within ``tolerance_mm`` of the chords and its speed within ``tolerance_mm_s`` of a straight line.
    """
    count = len(t)
    kept = np.empty(count, np.int64)
    kept[0] = 0
    size, anchor = 1, 0
    while anchor < count - 1:
        last = anchor + 1
        while last < count - 1 and last - anchor < WINDOW and key[last] == key[anchor]:
            if not _fits(t, q, speed, anchor, last + 1, tolerance_mm, tolerance_mm_s):
                break
            last += 1
        kept[size] = last
        size += 1
        anchor = last
    return kept[:size].copy()
