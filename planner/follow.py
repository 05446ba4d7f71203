"""Compiled search of samples along a polyline; see planner.measure."""

# numba carries no types:
# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

import numpy as np
from numba import njit

from planner.types import F8, Index


@njit(cache=True)
def _distance(p: F8, a: F8, b: F8) -> float:
    along, d2 = 0.0, 0.0
    for k in range(len(p)):
        along += (p[k] - a[k]) * (b[k] - a[k])
        d2 += (b[k] - a[k]) ** 2
    share = min(max(along / d2, 0.0), 1.0) if d2 > 0.0 else 0.0
    out = 0.0
    for k in range(len(p)):
        out += (p[k] - a[k] - share * (b[k] - a[k])) ** 2
    return float(np.sqrt(out))


LOST_SEGMENTS = 20_000
"""how many segments ahead a lost sample is looked for."""


@njit(cache=True)
def follow(q: F8, polyline: F8, segment: int, reach_mm: float, lost_mm: float) -> tuple[F8, Index]:
    """Distance f8[N] of each sample to the polyline and its segment i8[N], never searched backwards.

    segment: where the first sample is looked for. reach_mm: how far ahead on the polyline each is looked for. Of
    equally near segments the first counts, so a sample before a reversal is not taken for one after it. Where the
    polyline goes over itself a match can stay behind; a sample farther than lost_mm from its reach is looked for on
    all that follows.
    """
    last = len(polyline) - 2
    distance, match = np.empty(len(q)), np.empty(len(q), dtype=np.int64)
    for j in range(len(q)):
        best, best_at, travelled, i = np.inf, segment, 0.0, segment
        while i <= last:
            d = _distance(q[j], polyline[i], polyline[i + 1])
            if d < best - 1e-9:
                best, best_at = d, i
            if i > segment:
                travelled += np.sqrt(((polyline[i + 1] - polyline[i]) ** 2).sum())
            if travelled > reach_mm and i > segment + 1 and (best <= lost_mm or i > segment + LOST_SEGMENTS):
                break
            i += 1
        distance[j], match[j] = best, best_at
        segment = best_at
    return distance, match


@njit(cache=True)
def passes(q: F8, target: F8, at: int, near_mm: F8, last: bool, miss: F8) -> int:
    """Walk the samples past the vertices ``target`` f8[V, A] in order, from vertex ``at`` on.

    Lowers ``miss`` f8[V] to each vertex's distance from the samples' own polyline. A vertex counts as passed when the
    distance has been below near_mm f8[V] and rises again, or the samples are the last. Returns the first vertex not yet
    passed.
    """
    j, best_j = 0, 0
    while at < len(target) and j < len(q) - 1:
        d = _distance(target[at], q[j], q[j + 1])
        if d < miss[at]:
            miss[at], best_j = d, j
        elif miss[at] < near_mm[at] and d > miss[at] + 1e-6:
            at += 1
            j = best_j
            continue
        j += 1
        if last and j == len(q) - 1 and miss[at] < near_mm[at]:
            at += 1
            j = best_j
    return at
