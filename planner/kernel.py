"""Compiled TOPP-RA: backward controllable sets and forward greedy pass over the interval arrays.

In interval i the path acceleration u = s'' is constant, x = s'^2 changes by 2 D u, and axis acceleration is linear in
s, so its bounds at both interval ends are exact: |a u + b x| <= A with a = q'(in) and a = q'(out) + 2 D q'', b = q''
(both at x of the interval's start). The controllable set of a node is [0, K]: zero is always inside, for the bounds
contain zero.

Backward: K_i is the largest x for which some u keeps all rows and lands in [0, K_{i+1}]; the gap between the largest
lower and the smallest upper bound on u is convex and piecewise linear in x, so Newton from the right ends in a few
steps. Forward: the largest u of every interval. Source: H. Pham, Q.-C. Pham, "A New Approach to Time-Optimal Path
Parameterization Based on Reachability Analysis", IEEE T-RO 2018.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nmc.native import native
from planner.types import F8

Flags = npt.NDArray[np.bool_]
TINY = 1e-12
"""components of q' below this give no row in u (their row in x is in the cap)."""
SHORT_MM = 1e-4
"""length below which rounding of x may show in s'': 1e-16 x / length, at 1 m/s still 1e-6 mm/s2 at this length."""


@native("void(f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], b1[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def node_caps(
    length: F8, tangent_in: F8, tangent_out: F8, feed_mm_s: F8, stop: Flags, velocity: F8, acceleration: F8,
    corner_mm_s: F8, interval_cap: F8, node_cap: F8,
) -> None:  # fmt: skip
    """Caps on x = s'^2 of intervals f8[N] and nodes f8[N + 1], from feed, axis velocity and curvature; in place.

    corner_mm_s: f8[N + 1], caps on s' at the nodes, or f8[0].
    """
    n, axes = tangent_in.shape
    node_cap[0] = np.inf
    for i in range(n):
        cap = feed_mm_s[i]
        curve = np.inf
        for k in range(axes):
            t0, t1 = tangent_in[i, k], tangent_out[i, k]
            most = max(abs(t0), abs(t1))
            if most * cap > velocity[k]:
                cap = velocity[k] / most
            bend = abs(t1 - t0)
            if bend > 0.0 and min(abs(t0), abs(t1)) < TINY:
                curve = min(curve, acceleration[k] * length[i] / bend)
        interval_cap[i] = min(cap * cap, curve)
        node_cap[i] = min(node_cap[i], interval_cap[i])
        node_cap[i + 1] = interval_cap[i]
        if stop[i]:
            node_cap[i] = 0.0
    if stop[n]:
        node_cap[n] = 0.0
    for i in range(len(corner_mm_s)):
        node_cap[i] = min(node_cap[i], corner_mm_s[i] ** 2)


@native()
def _bounds(t0: F8, t1: F8, acceleration: F8, length: float, x: float, axes: int) -> tuple[float, float, float, float]:
    """Largest lower and smallest upper bound on u at x, with their slopes in x."""
    lo, lo_slope, hi, hi_slope = -np.inf, 0.0, np.inf, 0.0
    for k in range(axes):
        b = (t1[k] - t0[k]) / length
        bx = b * x
        limit = acceleration[k]
        for end in range(2):
            a = t0[k] if end == 0 else t1[k] + 2.0 * (t1[k] - t0[k])
            if abs(a) < TINY:
                continue
            r = 1.0 / abs(a)
            s = r if a > 0 else -r
            up, down, slope = limit * r - bx * s, -limit * r - bx * s, -b * s
            if up < hi:
                hi, hi_slope = up, slope
            if down > lo:
                lo, lo_slope = down, slope
    return lo, lo_slope, hi, hi_slope


@native()
def _straight_bound(t0: F8, acceleration: F8, axes: int) -> float:
    """Largest |u| on a straight line."""
    bound = np.inf
    for k in range(axes):
        if abs(t0[k]) >= TINY and acceleration[k] < bound * abs(t0[k]):
            bound = acceleration[k] / abs(t0[k])
    return bound


@native()
def _is_straight(t0: F8, t1: F8, axes: int) -> bool:
    for k in range(axes):  # noqa: SIM110 (numba compiles no generator expressions)
        if t0[k] != t1[k]:
            return False
    return True


@native("void(f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8, f8[::1])")
def backward(
    length: F8, tangent_in: F8, tangent_out: F8, acceleration: F8, node_cap: F8, last: float, controllable: F8
) -> None:
    """Upper ends K f8[N + 1] of the controllable sets, K_N = ``last``; in place."""
    n, axes = tangent_in.shape
    controllable[n] = last
    for i in range(n - 1, -1, -1):
        t0, t1, d2 = tangent_in[i], tangent_out[i], 2.0 * length[i]
        k_next, x = controllable[i + 1], node_cap[i]
        if _is_straight(t0, t1, axes):
            controllable[i] = min(x, k_next + d2 * _straight_bound(t0, acceleration, axes))
            continue
        for _ in range(60):
            lo, lo_slope, hi, hi_slope = _bounds(t0, t1, acceleration, length[i], x, axes)
            if -x / d2 > lo:
                lo, lo_slope = -x / d2, -1.0 / d2
            if (k_next - x) / d2 < hi:
                hi, hi_slope = (k_next - x) / d2, -1.0 / d2
            gap = lo - hi
            if gap <= 1e-13 * (abs(lo) + abs(hi)) or x <= 0.0:
                break
            slope = lo_slope - hi_slope
            if slope <= 0.0:
                break
            step = gap / slope
            if x - step == x:
                break
            x = max(x - step, 0.0)
        controllable[i] = x


@native("void(f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8, f8[::1])")
def forward(
    length: F8, tangent_in: F8, tangent_out: F8, acceleration: F8, controllable: F8, x_start: float, x: F8
) -> None:
    """Largest x f8[N + 1] reachable inside the controllable sets from ``x_start``; in place."""
    n, axes = tangent_in.shape
    x[0] = min(x_start, controllable[0])
    for i in range(n):
        t0, t1, d2 = tangent_in[i], tangent_out[i], 2.0 * length[i]
        if _is_straight(t0, t1, axes):
            u = _straight_bound(t0, acceleration, axes)
        else:
            _, _, u, _ = _bounds(t0, t1, acceleration, length[i], x[i], axes)
        x[i + 1] = min(max(x[i] + d2 * u, 0.0), controllable[i + 1])


@native("i8(f8[::1], f8[::1])")
def commit_point(controllable: F8, optimistic: F8) -> int:
    """The last node at which the two agree, so that nothing after the horizon can matter; 0 if only the first or
    none."""
    for i in range(len(controllable) - 1, -1, -1):
        if controllable[i] == optimistic[i]:
            return i
    return 0


@native("UniTuple(f8[::1], 2)(f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], b1[::1], f8[::1], f8[::1], f8[::1])")
def solve(
    length: F8, tangent_in: F8, tangent_out: F8, feed_mm_s: F8, stop: Flags, velocity: F8, acceleration: F8,
    corner_mm_s: F8,
) -> tuple[F8, F8]:  # fmt: skip
    """x = s'^2 at all nodes f8[N + 1] and the intervals' caps f8[N]: minimum time from rest to rest."""
    n = len(length)
    interval_cap, node_cap = np.empty(n), np.empty(n + 1)
    controllable, x = np.empty(n + 1), np.empty(n + 1)
    node_caps(
        length, tangent_in, tangent_out, feed_mm_s, stop, velocity, acceleration, corner_mm_s, interval_cap, node_cap
    )
    backward(length, tangent_in, tangent_out, acceleration, node_cap, node_cap[n], controllable)
    forward(length, tangent_in, tangent_out, acceleration, controllable, 0.0, x)
    return x, interval_cap


@native(
    "Tuple((f8[::1], i4[::1], f8[::1], f8[::1], f8[::1]))(f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[::1], f8[::1])"
)
def fill_pieces(
    length: F8, tangent_in: F8, tangent_out: F8, acceleration: F8, x: F8, cap: F8
) -> tuple[F8, npt.NDArray[np.int32], F8, F8, F8]:
    """Pieces of constant s'': duration, interval, offset, speed, s''; one on a parabola, up to three on a line.

    s'' is a difference of two x over a length. Where the length is tiny, rounding is all that is left of it, so it is
    held inside the bounds that x was made with.
    """
    n, axes = tangent_in.shape
    duration, interval, offset = np.empty(3 * n), np.empty(3 * n, dtype=np.int32), np.empty(3 * n)
    speed, accel = np.empty(3 * n), np.empty(3 * n)
    part_length, part_x = np.empty(3), np.empty(4)
    m = 0
    for i in range(n):
        t0, t1 = tangent_in[i], tangent_out[i]
        d, x0, x1 = length[i], x[i], x[i + 1]
        part_length[0], part_length[1], part_length[2] = d, 0.0, 0.0
        part_x[0], part_x[1], part_x[2], part_x[3] = x0, x1, x1, x1
        least, most = -np.inf, np.inf
        if _is_straight(t0, t1, axes):
            a = _straight_bound(t0, acceleration, axes)
            least, most = -a, a
            peak = max(min(cap[i], (x0 + x1) / 2 + a * d), x0, x1)
            up, down = (peak - x0) / (2 * a), (peak - x1) / (2 * a)
            if up + down < d * (1 - 1e-9) or (up > 1e-9 * d and down > 1e-9 * d):
                part_length[0], part_length[1], part_length[2] = up, max(d - up - down, 0.0), down
                part_x[1], part_x[2] = peak, peak
        elif d < SHORT_MM:
            least, _, most, _ = _bounds(t0, t1, acceleration, d, x0, axes)
        at = 0.0
        for k in range(3):
            if part_length[k] > 1e-9 * d:
                v0, v1 = np.sqrt(part_x[k]), np.sqrt(part_x[k + 1])
                duration[m] = 2 * part_length[k] / (v0 + v1)
                interval[m], offset[m], speed[m] = i, at, v0
                accel[m] = min(max((v1 - v0) / duration[m], least), most)
                m += 1
            at += part_length[k]
    return duration[:m].copy(), interval[:m].copy(), offset[:m].copy(), speed[:m].copy(), accel[:m].copy()


@native("Tuple((i8, f8))(f8[::1], f8[:, ::1], f8[:, ::1], f8[::1], b1[::1], i8, f8, f8[::1])")
def slowest(
    length: F8, tangent_in: F8, tangent_out: F8, acceleration: F8, stop: Flags, first: int, x_start: float, x: F8
) -> tuple[int, float]:
    """Brake as hard as the axes allow from node ``first`` at ``x_start``; fills x f8[N + 1] from there up to the rest.

    Returns the interval of the rest and its distance from the interval's start. The start must be inside the
    controllable set (it is, on any plan), so a stop of the path is never overrun.
    """
    n, axes = tangent_in.shape
    x[first] = x_start
    for i in range(first, n):
        t0, t1, d2 = tangent_in[i], tangent_out[i], 2.0 * length[i]
        if x[i] <= 0.0:
            return i, 0.0
        if _is_straight(t0, t1, axes):
            u = -_straight_bound(t0, acceleration, axes)
        else:
            u, _, _, _ = _bounds(t0, t1, acceleration, length[i], x[i], axes)
        x[i + 1] = x[i] + d2 * u
        if x[i + 1] <= 0.0:
            x[i + 1] = 0.0
            return i, min(-x[i] / (2.0 * u), length[i])
        if stop[i + 1]:
            x[i + 1] = 0.0
            return i, length[i]
    return n - 1, length[n - 1]
