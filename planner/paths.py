"""Cutting and joining interval arrays."""

from __future__ import annotations

import numpy as np

from planner.types import F8, Intervals


def resting(q: F8) -> Intervals:
    """The path of a program without motion: no intervals."""
    none = np.zeros((0, len(q)))
    return Intervals(np.zeros(0), none, none, none, np.zeros(0), np.zeros(0, np.int32), np.ones(1, dtype=np.bool_))


def cut(p: Intervals, first: int, end: int) -> Intervals:
    """Intervals first .. end - 1, as views."""
    s = slice(first, end)
    bound = None if p.bound_mm_s is None else p.bound_mm_s[s]
    stop = p.stop[first : end + 1]
    corner = None if p.corner_mm_s is None else p.corner_mm_s[first : end + 1]
    return Intervals(
        p.length[s], p.start[s], p.tangent_in[s], p.tangent_out[s], p.feed_mm_s[s], p.line[s], stop, bound, corner
    )


def join_intervals(parts: list[Intervals]) -> Intervals:
    """One path of consecutive parts; at a joint the later part knows whether the node is a stop."""
    if len(parts) == 1:
        return parts[0]
    bounds = [p.bound_mm_s for p in parts if p.bound_mm_s is not None]
    jumps = any(p.corner_mm_s is not None for p in parts)
    corners = [np.full(len(p) + 1, np.inf) if p.corner_mm_s is None else p.corner_mm_s for p in parts]
    bounded = [np.full(len(p), np.inf) if p.bound_mm_s is None else p.bound_mm_s for p in parts] if bounds else None
    return Intervals(
        np.concatenate([p.length for p in parts]),
        np.concatenate([p.start for p in parts]),
        np.concatenate([p.tangent_in for p in parts]),
        np.concatenate([p.tangent_out for p in parts]),
        np.concatenate([p.feed_mm_s for p in parts]),
        np.concatenate([p.line for p in parts]),
        np.concatenate([*(p.stop[:-1] for p in parts), parts[-1].stop[-1:]]),
        np.concatenate(bounded) if bounded else None,
        np.concatenate([*(c[:-1] for c in corners[:-1]), corners[-1]]) if jumps else None,
    )


def divide(p: Intervals, i: int, offset_mm: float) -> Intervals:
    """The same path with a node put into interval ``i`` at ``offset_mm`` of its length: one interval more."""
    one = cut(p, i, i + 1)
    share = offset_mm / one.length[0]
    middle = one.tangent_in + (one.tangent_out - one.tangent_in) * share
    point = one.start + (one.tangent_in + middle) * (offset_mm / 2)
    no, front, back, corner = np.zeros(1, dtype=np.bool_), one.stop[:1], one.stop[1:], one.corner_mm_s
    before = Intervals(
        np.array([offset_mm]), one.start, one.tangent_in, middle, one.feed_mm_s, one.line,
        np.concatenate([front, no]), one.bound_mm_s, None if corner is None else np.array([corner[0], np.inf]),
    )  # fmt: skip
    after = Intervals(
        one.length - offset_mm, point, middle, one.tangent_out, one.feed_mm_s, one.line,
        np.concatenate([no, back]), one.bound_mm_s, None if corner is None else np.array([np.inf, corner[1]]),
    )  # fmt: skip
    return join_intervals([cut(p, 0, i), before, after, cut(p, i + 1, len(p))])
