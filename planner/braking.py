"""The hardest braking along a path, and the place where it meets a cap."""

from __future__ import annotations

import numpy as np

from planner import kernel
from planner.constraints import Constraints
from planner.paths import cut
from planner.types import F8, Intervals


def hardest(p: Intervals, c: Constraints, x: float) -> tuple[F8, int, float]:
    """x f8[N + 1] of the hardest braking from ``x`` at node 0, and interval and offset of the rest."""
    out = np.zeros(len(p) + 1)
    interval, offset = kernel.slowest(p.length, *c.tangents(p), c.acceleration, p.stop, 0, x, out)
    return out, int(interval), float(offset)


def where_met(p: Intervals, c: Constraints, slow: F8, cap: F8) -> tuple[int, float] | None:
    """The straight interval, and the offset in it, where braking ``slow`` f8[N + 1] gets down to ``cap`` f8[N].

    None where it never was above, or meets its cap on a parabola: that has one s'' and brakes to its end.
    """
    met = np.flatnonzero(slow[1:] < cap)
    i = int(met[0]) if len(met) else 0
    if not len(p) or slow[i] <= cap[i] * (1 + 1e-9) or not np.array_equal(p.tangent_in[i], p.tangent_out[i]):
        return None
    tangent = np.abs(c.tangents(cut(p, i, i + 1))[0][0])
    moving = tangent > kernel.TINY
    most = float((c.acceleration[moving] / tangent[moving]).min())
    return i, float((slow[i] - cap[i]) / (2 * most))
