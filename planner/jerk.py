"""The jerk filter: a moving average over time of q(t), of a trajectory that rests long enough at every stop.

q_f(t) = (Q(t) - Q(t - tau)) / tau with Q the integral of q, so v_f = (q(t) - q(t - tau)) / tau and so on: all exact,
no samples. Averages of bounded velocities and accelerations stay bounded, and the jerk is (a(t) - a(t - tau)) / tau
<= 2 a / tau. The base rests for tau after every stop (``Timed.drain_s``), so the filter has run empty before anything
waits or reverses there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from planner.trajectory import PathTrajectory
from planner.types import F8, I4, Event, Limits

WIDTHS = (1.0, 0.6, 0.4, 0.25, 0.15)
"""shares of the full width that a whole program is tried with."""


def filter_widths_s(limits: Limits) -> tuple[float, ...]:
    """Widths worth trying, the one for an unknown program first; nothing without jerk limits.

    The full width 2 a / J leaves the accelerations as they are but cuts bends by a tau^2 / 24; a narrower one needs a
    smaller acceleration J tau / 2 and cuts them by J tau^3 / 48. At the width where that is half the tolerance no bend
    needs a cap, which is never far from the best on dense files; on long straight lines the full width is.
    """
    if limits.jerk is None:
        return ()
    full = float((2 * limits.acceleration / limits.jerk).max())
    uncapped = float(np.cbrt(24 * limits.tolerance_mm / limits.jerk.max()))
    return (min(full, uncapped), *(full * share for share in WIDTHS))


def within_jerk(limits: Limits, tau_s: float) -> Limits:
    """The limits with which a filter of ``tau_s`` keeps the axes within their jerk: accelerations of at most J tau /
    2."""
    if limits.jerk is None or tau_s <= 0:
        return limits
    return replace(limits, acceleration=np.minimum(limits.acceleration, limits.jerk * tau_s / 2))


@dataclass(frozen=True, eq=False)
class FilteredTrajectory:
    """Moving average of ``base`` over ``tau_s``; implements ``planner.types.Trajectory``."""

    base: PathTrajectory
    tau_s: float
    _sums: F8 = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_sums", self.base.integrals())

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the planned axes."""
        return self.base.axes

    @property
    def duration_s(self) -> float:
        """Time of the end; the base ends with a rest of ``tau_s``."""
        return self.base.duration_s

    @property
    def events(self) -> Sequence[Event]:
        """The base's events: its rests begin when the filter has run empty."""
        return self.base.events

    def q(self, t_s: F8) -> F8:
        """Positions f8[len(t), A], mm or degrees, machine frame."""
        t = _clamped(t_s, self.duration_s)
        window = self.base.integral(t, self._sums) - self.base.integral(t - self.tau_s, self._sums)
        return np.asarray(window / self.tau_s)

    def coordinate(self, t_s: F8, column: int) -> F8:
        """Positions f8[len(t)] of one axis."""
        return self.q(t_s)[:, column]

    def v(self, t_s: F8) -> F8:
        """Velocities f8[len(t), A], mm/s."""
        t = _clamped(t_s, self.duration_s)
        return np.asarray((self.base.q(t) - self.base.q(t - self.tau_s)) / self.tau_s)

    def a(self, t_s: F8) -> F8:
        """Accelerations f8[len(t), A], mm/s2."""
        t = _clamped(t_s, self.duration_s)
        return np.asarray((self._base_v(t) - self._base_v(t - self.tau_s)) / self.tau_s)

    def j(self, t_s: F8) -> F8:
        """Jerk f8[len(t), A], mm/s3, one-sided from the right where it jumps."""
        t = _clamped(t_s, self.duration_s)
        return np.asarray((self._base_a(t) - self._base_a(t - self.tau_s)) / self.tau_s)

    def line(self, t_s: F8) -> I4:
        """Source line i4[len(t)] in the middle of the window."""
        return self.base.line(np.atleast_1d(np.asarray(t_s, dtype=np.float64)) - self.tau_s / 2)

    def junctions_s(self) -> F8:
        """Ascending times at which a piece of the base enters or leaves the window."""
        base = self.base.junctions_s()
        return np.union1d(base, np.minimum(base + self.tau_s, self.duration_s))

    def _base_v(self, t: F8) -> F8:
        return np.where(t[:, None] < 0, 0.0, self.base.v(t))

    def _base_a(self, t: F8) -> F8:
        return np.where((t < 0)[:, None] | (t >= self.duration_s)[:, None], 0.0, self.base.a(t))


def _clamped(t_s: F8, end_s: float) -> F8:
    return np.clip(np.atleast_1d(np.asarray(t_s, dtype=np.float64)), 0.0, end_s)
