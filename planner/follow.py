"""Compiled search of samples along a polyline; see planner.measure."""

from __future__ import annotations

import numpy as np

from nmc.native import native
from planner.types import F8, Index


@native()
def _distance(points: F8, j: int, line: F8, i: int) -> float:
    """Of point ``j`` from segment ``i``."""
    along, d2, p2 = 0.0, 0.0, 0.0
    for k in range(points.shape[1]):
        p, d = points[j, k] - line[i, k], line[i + 1, k] - line[i, k]
        along += p * d
        d2 += d * d
    share = min(max(along / d2, 0.0), 1.0) if d2 > 0.0 else 0.0
    for k in range(points.shape[1]):
        p2 += (points[j, k] - line[i, k] - share * (line[i + 1, k] - line[i, k])) ** 2
    return float(np.sqrt(p2))


LOST_SEGMENTS = 20_000
"""how many segments ahead a lost sample is looked for."""


@native("Tuple((i8, f8[::1]))(f8[:, ::1], f8[:, ::1], f8[::1], i8, f8[::1], f8, f8, f8[::1], i8[::1])")
def _advance(
    q: F8, polyline: F8, length: F8, first: int, cost: F8, reach_mm: float, keep_mm: float, worst: F8, match: Index
) -> tuple[int, F8]:
    last = len(length) - 1
    following = np.empty(len(cost) + 16)
    for j in range(len(q)):
        kept, least, best, best_at, ahead, i = len(cost), np.inf, np.inf, first, 0.0, 0
        while first + i <= last:
            if i < kept:
                least = min(least, cost[i])
            else:
                ahead += length[first + i - 1] if i > kept else 0.0
                if ahead > reach_mm and (best <= keep_mm or i > LOST_SEGMENTS):
                    break
            if i == len(following):
                following = np.append(following, np.empty(len(following)))
            off = _distance(q, j, polyline, first + i)
            following[i] = max(least, off)
            if following[i] < best - 1e-9:
                best, best_at = following[i], first + i
            i += 1
        bound = max(best, keep_mm) + 1e-9
        low, high = 0, i - 1
        while following[low] > bound:
            low += 1
        while following[high] > bound:
            high -= 1
        cost = following[low : high + 1].copy()
        first += low
        worst[j], match[j] = best, best_at
    return first, cost


class Follower:
    """Matches samples, taken in any number of portions, to a polyline: never backwards, and as well as can be.

    All places at which a sample may be on the polyline are kept, each with the largest distance on the best way
    there (the Frechet distance, computed forwards). So neither a path that crosses or repeats itself nor a narrow
    spike misleads it.
    """

    def __init__(self, polyline: F8, reach_mm: float, keep_mm: float, segment: int = 0) -> None:
        """Follow ``polyline`` f8[P, A] from ``segment`` on.

        reach_mm: how far ahead on the polyline the next sample may be, at least what it can travel in a step.
        keep_mm: a distance that is usual; only where all are farther does a worse one remain, and then the sample is
        looked for on all that follows.
        """
        self._polyline, self._reach_mm, self._keep_mm = polyline, reach_mm, keep_mm
        self._length = np.sqrt(((polyline[1:] - polyline[:-1]) ** 2).sum(axis=1))
        self._first, self._cost = segment, np.zeros(1)

    def take(self, q: F8) -> tuple[F8, Index]:
        """Largest distance so far f8[N] and the likeliest segment i8[N] of each of the next samples f8[N, A]."""
        worst, match = np.empty(len(q)), np.empty(len(q), dtype=np.intp)
        self._first, self._cost = _advance(
            q, self._polyline, self._length, self._first, self._cost, self._reach_mm, self._keep_mm, worst, match
        )
        return worst, match


def follow(q: F8, polyline: F8, segment: int, reach_mm: float, keep_mm: float) -> tuple[F8, Index]:
    """What a ``Follower`` says of all samples ``q`` f8[N, A] at once."""
    return Follower(polyline, reach_mm, keep_mm, segment).take(q)


@native("i8(f8[:, ::1], f8[:, ::1], i8, f8[::1], b1, f8[::1])")
def passes(q: F8, target: F8, at: int, near_mm: F8, last: bool, miss: F8) -> int:
    """Walk the samples past the vertices ``target`` f8[V, A] in order, from vertex ``at`` on.

    Lowers ``miss`` f8[V] to each vertex's distance from the samples' own polyline. A vertex counts as passed when the
    distance has been below near_mm f8[V] and rises again, or the samples are the last. Returns the first vertex not yet
    passed.
    """
    j, best_j = 0, 0
    while at < len(target) and j < len(q) - 1:
        d = _distance(target, at, q, j)
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
