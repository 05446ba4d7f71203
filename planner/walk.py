"""Compiled sampling of a trajectory: a forward walk over the pieces for ascending times, else a binary search.

The arrays are those of planner.trajectory: per piece duration, interval, offset, speed, s''; per interval length,
start, q' at both ends.
"""

from __future__ import annotations

import numpy as np

from nmc.native import native
from planner.types import F8, I4


@native()
def _seek(begin_s: F8, m: int, t: float) -> int:
    """The piece that runs at ``t``, searched from piece ``m`` on."""
    last = len(begin_s) - 1
    if t < begin_s[m] or (m < last and t >= begin_s[min(m + 16, last)]):
        m = max(int(np.searchsorted(begin_s, t, side="right")) - 1, 0)
    while m < last and t >= begin_s[m + 1]:
        m += 1
    return m


@native(
    "f8[:, ::1]("
    "f8[::1], f8[::1], f8[::1], i4[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])"
)
def sample_q(
    t: F8, begin_s: F8, duration_s: F8, interval: I4, offset: F8, speed: F8, accel: F8, length: F8, start: F8,
    tangent_in: F8, tangent_out: F8,
) -> F8:  # fmt: skip
    """Positions f8[len(t), A] at times ``t``."""
    axes = start.shape[1]
    out = np.empty((len(t), axes))
    m = 0
    for j in range(len(t)):
        m = _seek(begin_s, m, t[j])
        tau = min(max(t[j] - begin_s[m], 0.0), duration_s[m])
        i = interval[m]
        sigma = min(offset[m] + (speed[m] + accel[m] * (tau / 2)) * tau, length[i])
        share = sigma / (2 * length[i])
        for k in range(axes):
            bend = (tangent_out[i, k] - tangent_in[i, k]) * share
            out[j, k] = start[i, k] + (tangent_in[i, k] + bend) * sigma
    return out


@native()
def _moments(o: float, v: float, u: float, tau: float) -> tuple[float, float]:
    """Integrals over [0, tau] of sigma and sigma^2, with sigma = o + v t + u t^2 / 2."""
    t2 = tau * tau
    t3 = t2 * tau
    first = o * tau + v * t2 / 2 + u * t3 / 6
    second = o * o * tau + o * v * t2 + (v * v + o * u) * t3 / 3 + v * u * t2 * t2 / 4 + u * u * t2 * t3 / 20
    return first, second


@native("f8[:, ::1](f8[::1], i4[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:, ::1], f8[:, ::1], f8[:, ::1])")
def piece_integrals(
    duration_s: F8, interval: I4, offset: F8, speed: F8, accel: F8, length: F8, start: F8, tangent_in: F8,
    tangent_out: F8,
) -> F8:  # fmt: skip
    """Integral of q from the first piece to the beginning of each, f8[M, A]."""
    axes = start.shape[1]
    out = np.zeros((len(duration_s), axes))
    for m in range(len(duration_s) - 1):
        i, tau = interval[m], duration_s[m]
        first, second = _moments(offset[m], speed[m], accel[m], tau)
        for k in range(axes):
            half = (tangent_out[i, k] - tangent_in[i, k]) / (2 * length[i])
            out[m + 1, k] = out[m, k] + start[i, k] * tau + tangent_in[i, k] * first + half * second
    return out


@native(
    "f8[:, ::1](f8[::1], f8[::1], f8[:, ::1], f8[::1], i4[::1], f8[::1], f8[::1], f8[::1], f8[::1], "
    "f8[:, ::1], f8[:, ::1], f8[:, ::1])"
)
def sample_integral(
    t: F8, begin_s: F8, sums: F8, duration_s: F8, interval: I4, offset: F8, speed: F8, accel: F8, length: F8, start: F8,
    tangent_in: F8, tangent_out: F8,
) -> F8:  # fmt: skip
    """Integral of q from 0 to ``t``, f8[len(t), A]; the first and the last position go on outside."""
    axes = start.shape[1]
    out = np.empty((len(t), axes))
    m, last = 0, len(begin_s) - 1
    for j in range(len(t)):
        m = _seek(begin_s, m, t[j])
        i = interval[m]
        tau = min(max(t[j] - begin_s[m], 0.0), duration_s[m])
        first, second = _moments(offset[m], speed[m], accel[m], tau)
        beyond = t[j] - begin_s[m] - tau
        sigma = 0.0
        if m == last and beyond > 0.0:
            sigma = min(offset[m] + (speed[m] + accel[m] * (tau / 2)) * tau, length[i])
        elif m == 0 and beyond < 0.0:
            sigma = offset[m]
        for k in range(axes):
            half = (tangent_out[i, k] - tangent_in[i, k]) / (2 * length[i])
            out[j, k] = sums[m, k] + start[i, k] * tau + tangent_in[i, k] * first + half * second
            if beyond != 0.0:
                out[j, k] += beyond * (start[i, k] + (tangent_in[i, k] + half * sigma) * sigma)
    return out
