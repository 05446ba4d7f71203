"""Compiled sampling of a trajectory: a forward walk over the pieces for ascending times, else a binary search."""

# numba carries no types:
# mypy: disable-error-code="untyped-decorator"
from __future__ import annotations

import numpy as np
from numba import njit

from planner.types import F8, I4


@njit(cache=True)
def sample_q(
    t: F8, begin_s: F8, duration_s: F8, interval: I4, offset: F8, speed: F8, accel: F8, length: F8, start: F8,
    tangent_in: F8, tangent_out: F8,
) -> F8:  # fmt: skip
    """Positions f8[len(t), A] at times ``t``; see planner.trajectory for the arrays."""
    axes = start.shape[1]
    last = len(begin_s) - 1
    out = np.empty((len(t), axes))
    m = 0
    for j in range(len(t)):
        if t[j] < begin_s[m] or (m < last and t[j] >= begin_s[min(m + 16, last)]):
            m = max(np.searchsorted(begin_s, t[j], side="right") - 1, 0)
        while m < last and t[j] >= begin_s[m + 1]:
            m += 1
        tau = min(max(t[j] - begin_s[m], 0.0), duration_s[m])
        i = interval[m]
        sigma = min(offset[m] + (speed[m] + accel[m] * (tau / 2)) * tau, length[i])
        share = sigma / (2 * length[i])
        for k in range(axes):
            bend = (tangent_out[i, k] - tangent_in[i, k]) * share
            out[j, k] = start[i, k] + (tangent_in[i, k] + bend) * sigma
    return out
