"""One motion of a CY545, let out step by step as time passes; what happens on the way changes what is left of it."""

from __future__ import annotations

from collections.abc import Callable

from sim.cy545_ramp import ENDLESS, Ramp, Run, brake, endless, journey

FOREVER = 1 << 62  # ticks

Emit = Callable[[int, int, int, int], None]
"""``emit(first_tick, period, count, direction)``."""


class Motion:
    """Steps from ``start`` (tick of the first one) on. steps: None in continuous mode. All times in chip ticks.

    ``over_tick``: when the last step's period has passed, so that the chip is ready again; FOREVER while endless.
    """

    def __init__(self, ramp: Ramp, steps: int | None, direction: int, start: int) -> None:
        self.ramp = ramp
        self.direction = direction
        self.left = ENDLESS if steps is None else steps
        self.braking = False
        self._index = ramp.first
        self._tick = start
        self._runs = endless(ramp, ramp.first) if steps is None else journey(ramp, ramp.first, steps)

    @property
    def over_tick(self) -> int:
        """When the chip is ready again if nothing happens meanwhile."""
        if any(count >= ENDLESS // 2 for _, count in self._runs):
            return FOREVER
        return self._tick + sum(count * self.ramp.period[index] for index, count in self._runs)

    def advance(self, now: int, emit: Emit) -> None:
        """Let out every step that begins up to and including ``now``."""
        while self._runs and self._tick <= now:
            index, count = self._runs[0]
            period = self.ramp.period[index]
            due = min((now - self._tick) // period + 1, count)
            emit(self._tick, period, due, self.direction)
            self._index = index
            self._tick += due * period
            self.left -= due
            if due == count:
                self._runs.pop(0)
            else:
                self._runs[0] = (index, count - due)

    def abort(self, now: int) -> None:
        """INHIBIT_ABORT has fallen at ``now``: slow down and stop. ``advance`` must have been called up to ``now``."""
        self.braking = True
        self._runs = brake(self.ramp, self._index, max(self._tick - now, 0), self.left)

    def release(self, now: int) -> None:
        """INHIBIT_ABORT has risen before the motion stopped: go on from the rate reached (X-106)."""
        self.braking = False
        self._runs = self._onwards()

    def stop_after_step(self) -> None:
        """No further step."""
        self._runs = []

    def _onwards(self) -> list[Run]:
        if self.left >= ENDLESS // 2:
            return endless(self.ramp, self._index)
        return journey(self.ramp, self._index, self.left)
