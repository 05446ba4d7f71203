"""Timing: interval arrays and limits to x = s'^2 at the nodes, and from there to pieces of constant s''.

Two solvers share the arrays: toppra (the reference) and the compiled kernel of the same reachability pass. A straight
line is one interval to both; afterwards it is replaced analytically by accelerate, cruise, decelerate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from planner.types import F8, I4, Intervals, Limits

Solver = Literal["auto", "toppra", "kernel"]
TOPPRA_INTERVALS = 3000
"""``auto``: programs up to this many intervals go to the reference solver, longer ones to the kernel."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """M pieces of constant s'', ascending in time.

    duration_s: f8[M], > 0. interval: i4[M]. offset_mm: f8[M], distance from the interval's start. speed_mm_s: f8[M],
    s' at the piece's start. accel_mm_s2: f8[M], s''.
    """

    duration_s: F8
    interval: I4
    offset_mm: F8
    speed_mm_s: F8
    accel_mm_s2: F8

    def __len__(self) -> int:
        return len(self.duration_s)


@dataclass(frozen=True, slots=True, eq=False)
class Timing:
    """x: f8[N + 1], s'^2 at the nodes. cap: f8[N], largest x that feed and axis velocities allow. solver: who
    solved."""

    x: F8
    cap: F8
    solver: Literal["toppra", "kernel"]


def solve(p: Intervals, limits: Limits, solver: Solver = "auto") -> Timing:
    """Minimum-time x at all nodes of ``p``, at rest at every stop. Raises PlanError where toppra fails."""
    from planner import kernel

    chosen: Literal["toppra", "kernel"]
    if solver == "auto":
        chosen = "toppra" if len(p) <= TOPPRA_INTERVALS and _has_toppra() else "kernel"
    else:
        chosen = solver
    if chosen == "kernel":
        x, cap = kernel.solve(
            p.length, p.tangent_in, p.tangent_out, p.feed_mm_s, p.stop, limits.velocity, limits.acceleration
        )
        return Timing(x, cap, "kernel")
    cap, node_cap = np.empty(len(p)), np.empty(len(p) + 1)
    kernel.node_caps(
        p.length, p.tangent_in, p.tangent_out, p.feed_mm_s, p.stop, limits.velocity, limits.acceleration, cap, node_cap
    )
    from planner import reference

    return Timing(reference.solve(p, limits.acceleration, node_cap), cap, "toppra")


def _has_toppra() -> bool:
    from importlib.util import find_spec

    return find_spec("toppra") is not None


def straight_accel(tangent: F8, acceleration: F8) -> F8:
    """Largest |s''| f8[N] on straight lines of unit tangents f8[N, A]."""
    with np.errstate(divide="ignore"):
        return np.asarray((acceleration / np.maximum(np.abs(tangent), 1e-12)).min(axis=1))


def pieces_of(p: Intervals, timing: Timing, acceleration: F8) -> Pieces:
    """Pieces of constant s'': one on a parabola, up to three on a straight line. All vectorised."""
    x0, x1, d = timing.x[:-1], timing.x[1:], p.length
    straight = (p.tangent_in == p.tangent_out).all(axis=1)
    a = np.where(straight, straight_accel(p.tangent_in, acceleration), 1.0)
    peak = np.minimum(timing.cap, (x0 + x1) / 2 + a * d)
    peak = np.maximum(peak, np.maximum(x0, x1))
    up, down = (peak - x0) / (2 * a), (peak - x1) / (2 * a)
    cruise = d - up - down
    least = 1e-9 * d
    phases = (up > least).astype(int) + (cruise > least) + (down > least)
    refined = straight & ((phases >= 2) | ((x0 == 0) & (x1 == 0)))
    n = len(p)
    part_length, part_x0, part_x1 = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    part_length[:, 0], part_x0[:, 0], part_x1[:, 0] = d, x0, x1
    part_length[refined] = np.stack([up, np.maximum(cruise, 0.0), down], axis=1)[refined]
    part_x0[refined] = np.stack([x0, peak, peak], axis=1)[refined]
    part_x1[refined] = np.stack([peak, peak, x1], axis=1)[refined]
    used = part_length > least[:, None]
    v0, v1 = np.sqrt(part_x0), np.sqrt(part_x1)
    offset = np.cumsum(part_length, axis=1) - part_length
    interval = np.broadcast_to(np.arange(n, dtype=np.int32)[:, None], (n, 3))[used]
    length, v0, v1, offset = part_length[used], v0[used], v1[used], offset[used]
    duration = 2 * length / (v0 + v1)
    return Pieces(duration, interval, offset, v0, (v1 - v0) / duration)
