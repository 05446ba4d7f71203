"""Compiled: runs of pulses laid out pulse by pulse, and where that leaves the motors."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nmc.native import native

F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]


@native("Tuple((f8[::1], i4[::1]))(i8[::1], f8[::1], i4[::1])")
def laid_out(first_ns: I8, period_ns: F8, count: npt.NDArray[np.int32]) -> tuple[F8, npt.NDArray[np.int32]]:
    """Time f8[K] of every pulse of the runs, run after run, and number i4[K] of its run."""
    total = 0
    for r in range(len(count)):
        total += count[r]
    time_ns, run = np.empty(total), np.empty(total, np.int32)
    at = 0
    for r in range(len(count)):
        for k in range(count[r]):
            time_ns[at] = first_ns[r] + k * period_ns[r]
            run[at] = r
            at += 1
    return time_ns, run


@native("i8[:, ::1](u1[::1], i1[::1], i8[::1])")
def positions(motor: npt.NDArray[np.uint8], direction: npt.NDArray[np.int8], start_steps: I8) -> I8:
    """Counters i8[K, A] after each pulse, made by ``motor`` in ``direction``."""
    steps = np.empty((len(motor), len(start_steps)), np.int64)
    now = start_steps.copy()
    for k in range(len(motor)):
        now[motor[k]] += direction[k]
        for a in range(len(now)):
            steps[k, a] = now[a]
    return steps
