"""How late a chip is behind its nominal twin, learned from the positions that it reports.

Two unknowns: the offset in ns (where in its window the start was executed, and what loads near a roll-over have added)
and the crystal's error, which outlives the legs. Both are taken as normally distributed together; time shears the
distribution, every load widens it, every position that is read cuts a box out of it:

    n steps seen at t       s(n) + offset <= t < s(n + 1) + offset, with t anywhere in a window

After each cut the distribution is replaced by the normal one of the same mean and variance (assumed density filtering).
The bounding twins, which keep the machine safe, do not depend on any of this.
"""

from __future__ import annotations

import math

import numpy as np

from nmc.budget import Window

PPM = 1e-6
UNIFORM = 1.0 / 12.0
"""Variance of a uniform distribution of width 1."""
WANDER_PPM2_S = 0.01
"""A crystal wanders with temperature: variance of its error a second."""
LEAST_OFFSET, LEAST_RATE = 1e3**2, (0.1 * PPM) ** 2
"""Nothing is known better than to a microsecond and a tenth of a ppm."""
SPREAD = np.linspace(-4.0, 4.0, 65)
BELL = np.exp(-0.5 * SPREAD * SPREAD)
LOST = 1e-4
"""An observation less likely than this shows that something unforeseen has happened to the offset."""


class Phase:
    """Offset (ns, positive: the chip is late; the nominal twin stands for its mean) and crystal error of one chip."""

    __slots__ = ("_at_ns", "_cross", "_offset", "_rate", "rate")

    def __init__(self, crystal_ppm: int) -> None:
        self.rate = 0.0
        """Crystal error: periods are longer by this share."""
        self._rate = max((2.0 * crystal_ppm * PPM) ** 2 * UNIFORM, LEAST_RATE)
        self._offset = LEAST_OFFSET
        self._cross = 0.0
        self._at_ns = 0

    def start(self, window: Window) -> None:
        """A leg begins somewhere in a window, whose middle the nominal twin takes."""
        self._at_ns = window.middle_ns
        self._offset = max((window.latest_ns - window.likely_ns) ** 2 * UNIFORM, LEAST_OFFSET)
        self._cross = 0.0

    def load(self, window: Window, next_ns: int, running_ns: int, period_ns: int) -> None:
        """A count was executed within a window; the running period would end at ``next_ns``.

        Every roll-over that chip and nominal twin do not take on the same side of the load moves the one against the
        other by the difference of the periods.
        """
        width_ns = window.latest_ns - window.likely_ns
        differ = float(running_ns - period_ns)
        if width_ns >= running_ns:
            self._offset += (differ * width_ns / running_ns) ** 2 * UNIFORM
            return
        ahead_ns = next_ns - window.middle_ns
        away_ns = max(min(ahead_ns, running_ns - ahead_ns), 0)
        reach_ns = 0.5 * width_ns + self.deviation_ns()
        if away_ns < reach_ns:
            other_side = 0.5 * (1.0 - away_ns / reach_ns)
            self._offset += other_side * (1.0 - other_side) * differ * differ

    def deviation_ns(self) -> float:
        """Standard deviation of the offset."""
        return math.sqrt(self._offset)

    def observe(self, window: Window, past_ns: int, next_ns: int) -> int:
        """Within the window the nominal twin's step of ``past_ns`` had been made and that of ``next_ns`` had not.

        Returns the shift that puts the nominal twin onto the best guess, and sets ``rate``.
        """
        self._predict(window.middle_ns)
        first_ns, last_ns = window.likely_ns, window.latest_ns + 1
        offset = self.deviation_ns() * SPREAD
        weight = BELL * np.maximum(np.minimum(last_ns, next_ns + offset) - np.maximum(first_ns, past_ns + offset), 0.0)
        total = float(weight.sum())
        if total <= LOST * (last_ns - first_ns):
            self._offset = float((last_ns - first_ns + next_ns - past_ns) ** 2) * UNIFORM
            self._cross = 0.0
            return (first_ns + last_ns - past_ns - next_ns) // 2
        shift = float(weight @ offset) / total
        self._narrow(shift, float(weight @ (offset - shift) ** 2) / total)
        return round(shift)

    def _narrow(self, shift: float, left: float) -> None:
        """The offset was found to be at ``shift`` with variance ``left``; the rate follows by their correlation."""
        before = self._offset
        left = min(max(left, LEAST_OFFSET), before)
        gain = self._cross / before
        self.rate += gain * shift
        self._rate = max(self._rate - gain * self._cross * (1.0 - left / before), LEAST_RATE)
        self._cross, self._offset = gain * left, left

    def _predict(self, at_ns: int) -> None:
        span_ns = max(at_ns - self._at_ns, 0)
        self._at_ns += span_ns
        spread = self._offset + 2.0 * self._cross * span_ns + self._rate * span_ns * span_ns
        self._offset = max(spread, LEAST_OFFSET)
        self._cross += self._rate * span_ns
        self._rate += WANDER_PPM2_S * PPM * PPM * span_ns * 1e-9
