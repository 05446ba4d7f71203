"""Compiled search: the distance of every pin position from a polyline within a window of time."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nmc.native import native

F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]

BLOCK = 8
"""Segments that share one bounding box, and blocks that share one around theirs."""


@native("i8[::1](f8[::1], f8[::1])")
def places(knots_s: F8, time_s: F8) -> npt.NDArray[np.int64]:
    """Before which of ``knots_s`` each of the times would be put, both ascending: a walk instead of a search each."""
    found = np.empty(len(time_s), np.int64)
    at = 0
    for k in range(len(time_s)):
        while at > 0 and knots_s[at - 1] >= time_s[k]:
            at -= 1
        while at < len(knots_s) and knots_s[at] < time_s[k]:
            at += 1
        found[k] = at
    return found


@native()
def boxes(knots: F8, size: int) -> tuple[F8, F8]:
    """Bounding boxes of runs of ``size`` segments: least and greatest corner, f8[blocks, A] each."""
    segments, axes = len(knots) - 1, knots.shape[1]
    count = (segments + size - 1) // size
    low, high = np.empty((count, axes)), np.empty((count, axes))
    for block in range(count):
        first, last = block * size, min((block + 1) * size, segments)
        for a in range(axes):
            least, greatest = knots[first, a], knots[first, a]
            for i in range(first, last + 1):
                least, greatest = min(least, knots[i, a]), max(greatest, knots[i, a])
            low[block, a], high[block, a] = least, greatest
    return low, high


@native()
def _beyond(low: F8, high: F8, block: int, pins: F8, k: int, bound: float) -> bool:
    """Whether a pin position is further from a box than the root of ``bound``."""
    far = 0.0
    for a in range(pins.shape[1]):
        gap = max(low[block, a] - pins[k, a], pins[k, a] - high[block, a], 0.0)
        far += gap * gap
        if far > bound:
            return True
    return False


@native()
def _segment(pins: F8, k: int, knots: F8, i: int) -> tuple[float, float]:
    """Distance squared of a pin position from a segment, and where on it the nearest point is, 0..1."""
    along, length2 = 0.0, 0.0
    for a in range(pins.shape[1]):
        edge = knots[i + 1, a] - knots[i, a]
        along += (pins[k, a] - knots[i, a]) * edge
        length2 += edge * edge
    u = 0.0 if length2 == 0.0 else min(max(along / length2, 0.0), 1.0)
    d2 = 0.0
    for a in range(pins.shape[1]):
        gap = pins[k, a] - knots[i, a] - u * (knots[i + 1, a] - knots[i, a])
        d2 += gap * gap
    return d2, u


@native()
def _aside(pins: F8, k: int, knots: F8, i: int, bound: float) -> bool:
    """Whether a pin position is further from a segment's own box than the root of ``bound``."""
    far = 0.0
    for a in range(pins.shape[1]):
        one, other = knots[i, a], knots[i + 1, a]
        gap = max(min(one, other) - pins[k, a], pins[k, a] - max(one, other), 0.0)
        far += gap * gap
        if far > bound:
            return True
    return False


@native()
def _nearest(
    k: int,
    time_s: F8,
    pins: F8,
    knots_s: F8,
    knots: F8,
    low: F8,
    high: F8,
    wide_low: F8,
    wide_high: F8,
    first: int,
    last: int,
    near: int,
) -> tuple[float, float, int]:
    """(distance squared, time, segment) of the point between two segments that is nearest to pins[k].

    ``near``: the segment to begin with. Its distance is a bound, and what lies in boxes beyond it is passed over.
    Rounding may put even that segment's own box beyond it.
    """
    best, u = _segment(pins, k, knots, near)
    best_s, bound = knots_s[near] + u * (knots_s[near + 1] - knots_s[near]), best
    blocks_from, blocks_to = first // BLOCK, (last - 1) // BLOCK
    at, near_block, ahead = near, near // BLOCK, blocks_from - 1
    while ahead <= blocks_to:
        block = near_block if ahead < blocks_from else ahead
        ahead += 1
        if ahead > blocks_from:
            if block % BLOCK == 0 and _beyond(wide_low, wide_high, block // BLOCK, pins, k, bound):
                ahead = block + BLOCK
                continue
            if block == near_block or _beyond(low, high, block, pins, k, bound):
                continue
        for i in range(max(block * BLOCK, first), min((block + 1) * BLOCK, last)):
            if _aside(pins, k, knots, i, bound):
                continue
            d2, u = _segment(pins, k, knots, i)
            at_s = knots_s[i] + u * (knots_s[i + 1] - knots_s[i])
            if d2 < best or (d2 == best and abs(at_s - time_s[k]) < abs(best_s - time_s[k])):
                best, best_s, at = d2, at_s, i
                bound = min(bound, best)
    return best, best_s, at


@native("UniTuple(f8[::1], 2)(f8[::1], f8[:, ::1], i8[::1], i8[::1], f8[::1], f8[:, ::1])")
def distances(time_s: F8, pins: F8, first: I8, last: I8, knots_s: F8, knots: F8) -> tuple[F8, F8]:
    """Least distance of pins[k] from the polyline ``knots`` between segments first[k] and last[k].

    time_s f8[K], pins f8[K, A], knots_s f8[N], knots f8[N, A]; returns distance f8[K] in the units of the coordinates
    and the time f8[K] of the nearest point (the nearest in time among equals). The search begins where the last pin
    was nearest.
    """
    count = len(pins)
    low, high = boxes(knots, BLOCK)
    wide_low, wide_high = boxes(knots, BLOCK * BLOCK)
    distance, nearest_s = np.empty(count), np.empty(count)
    near = 0
    for k in range(count):
        near = min(max(near, first[k]), last[k] - 1)
        best, nearest_s[k], near = _nearest(
            k, time_s, pins, knots_s, knots, low, high, wide_low, wide_high, first[k], last[k], near
        )
        distance[k] = math.sqrt(best)
    return distance, nearest_s


@native("f8(f8[::1], f8[:, ::1], i8[::1], i8[::1], f8[::1], f8[:, ::1])")
def greatest_distance(time_s: F8, pins: F8, first: I8, last: I8, knots_s: F8, knots: F8) -> float:
    """The greatest of ``distances``; a pin that is no further from one segment than the greatest so far is not it."""
    low, high = boxes(knots, BLOCK)
    wide_low, wide_high = boxes(knots, BLOCK * BLOCK)
    greatest = 0.0
    near = 0
    for k in range(len(pins)):
        near = min(max(near, first[k]), last[k] - 1)
        if _segment(pins, k, knots, near)[0] > greatest:
            best, _, near = _nearest(
                k, time_s, pins, knots_s, knots, low, high, wide_low, wide_high, first[k], last[k], near
            )
            greatest = max(greatest, best)
    return math.sqrt(greatest)


@native("i8[::1](f8[:, ::1], f8[:, ::1], f8, f8)")
def follow(points: F8, polyline: F8, ahead_mm: float, lost_mm: float) -> npt.NDArray[np.int64]:
    """Segment of ``polyline`` (f8[M, A]) that each of ``points`` (f8[N, A], in order along it) belongs to.

    The pointer only moves forward: for each point it looks at most as far ahead as the point has moved since the last
    one plus ``ahead_mm``, so a path that crosses itself is not mixed up. A point further than ``lost_mm`` from all of
    that is looked for all the way ahead.
    """
    count, axes = points.shape
    segments = len(polyline) - 1
    index = np.zeros(count, np.int64)
    pointer = 0
    for k in range(count):
        moved = 0.0
        if k > 0:
            for a in range(axes):
                moved += (points[k, a] - points[k - 1, a]) ** 2
        reach = math.sqrt(moved) * 1.5 + ahead_mm
        best, at, travelled = math.inf, pointer, 0.0
        for i in range(pointer, segments):
            along, length2 = 0.0, 0.0
            for a in range(axes):
                edge = polyline[i + 1, a] - polyline[i, a]
                along += (points[k, a] - polyline[i, a]) * edge
                length2 += edge * edge
            u = 0.0 if length2 == 0.0 else min(max(along / length2, 0.0), 1.0)
            d2 = 0.0
            for a in range(axes):
                gap = points[k, a] - polyline[i, a] - u * (polyline[i + 1, a] - polyline[i, a])
                d2 += gap * gap
            if d2 < best - 1e-18:
                best, at = d2, i
            if i > pointer:
                travelled += math.sqrt(length2)
            if travelled > reach and best < lost_mm * lost_mm:
                break
        pointer = at
        index[k] = at
    return index
