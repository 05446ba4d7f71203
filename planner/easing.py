"""Time stretched for host or bus: speeds times ``bus``, accelerations times its square, as if the clock went slower.

What an axis misses between two loads is its acceleration times the square of the time between them (a chord, a
t^2 / 8); less feed alone would leave the accelerations of corners and reversals as they are.

Accelerations are scaled interval by interval, *ease* f8[N]: a motion that is too fast for the stretched limits is first
braked with the limits of the machine, as hard as it was planned to be, until it is inside them.

       x  |.
          |  `.   full braking, ease 1             The kernels know one acceleration for all intervals. A bound
          |     `.--------.   ease bus^2           |q' s''| <= ease a is the same as |q' / ease s''| <= a, so
          |                `-.                     they are given tangents that are so much longer.
          +------------------------ s
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner import kernel
from planner.braking import hardest
from planner.constraints import Constraints
from planner.timing import Rate, corner_caps, eased, speed_cap
from planner.types import F8, Intervals, nobody_asks

WITHIN = 1 + 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """N intervals that are to be timed at a rate. fixed: bool[N], those whose feed nobody may override; None: none.

    alive: called between stages.
    """

    path: Intervals
    constraints: Constraints
    rate: Rate
    fixed: npt.NDArray[np.bool_] | None
    alive: Callable[[], None] = nobody_asks

    def ease(self, x: float) -> F8 | None:
        """The share of the accelerations f8[N] for a motion with ``x`` at the first node; None: all, everywhere."""
        p, c = self.path, self.constraints
        if self.rate.bus == 1.0:
            return None
        ease = np.full(len(p), self.rate.bus**2)
        if x <= 0 or not len(p):
            return ease
        safe = np.empty(len(p) + 1)
        tangents = self.tangents(ease)
        self.alive()
        node_cap = self.caps(ease)[1]
        self.alive()
        kernel.backward(p.length, *tangents, c.acceleration, node_cap, 0.0, safe)
        self.alive()
        inside = np.flatnonzero(hardest(p, c, x)[0] <= safe * WITHIN)
        ease[: inside[0] if len(inside) else len(p)] = 1.0
        return ease

    def tangents(self, ease: F8 | None) -> tuple[F8, F8]:
        """What the kernels are given as q', f8[N, R]."""
        return eased(self.constraints.tangents(self.path), ease)

    def caps(self, ease: F8 | None) -> tuple[F8, F8]:
        """Caps on x of the intervals f8[N] and of the nodes f8[N + 1]."""
        p, c = self.path, self.constraints
        cap, node_cap = np.empty(len(p)), np.zeros(len(p) + 1)
        tangents, velocity = c.tangents(p), c.velocity
        speed, corner = speed_cap(p, tangents, velocity, self.rate, self.fixed), corner_caps(p)
        if ease is not None:
            most = np.maximum(np.abs(tangents[0]), np.abs(tangents[1]))
            fastest = (velocity / np.maximum(most, kernel.TINY)).min(axis=1, initial=np.inf)
            speed, corner = np.minimum(speed, self.rate.bus * fastest), corner * self.rate.bus
            velocity = np.full_like(velocity, np.inf)
        self.alive()
        longer, bound = eased(tangents, ease), c.acceleration
        kernel.node_caps(p.length, *longer, speed, p.stop, velocity, bound, corner, cap, node_cap)
        return cap, node_cap
