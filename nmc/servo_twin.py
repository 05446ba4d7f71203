"""Host twin of a PIC-SERVO's velocity profiler, to the last bit, and of its servo clock.

Each servo tick (PIC-SERVO data sheet, sections 4.3 and 4.4) the command velocity moves towards the goal velocity by the
acceleration and is then added to the command position: 16 fractional bits each, position 48 bits wide. A command is
executed at the end of the tick in which it was complete, and answered then, so every answer tells when a tick ended.
"""

from __future__ import annotations

from dataclasses import dataclass

TICK_NS = 512_000
"""Servo cycle of a 20 MHz chip (section 3.1: 1953.12 Hz)."""
FRACTION_BITS = 16


@dataclass(slots=True)
class Profiler:
    """Command position (counts x 65536), command and goal velocity (counts/tick x 65536, signed), acceleration >= 0."""

    position: int = 0
    velocity: int = 0
    goal: int = 0
    acceleration: int = 0

    def run(self, ticks: int) -> None:
        """Advance by ``ticks`` in closed form."""
        if ticks <= 0:
            return
        gap = self.goal - self.velocity
        if gap and self.acceleration:
            step = self.acceleration if gap > 0 else -self.acceleration
            ramp = min(ticks, (abs(gap) - 1) // self.acceleration)
            self.position += ramp * self.velocity + step * (ramp * (ramp + 1) // 2)
            self.velocity += ramp * step
            ticks -= ramp
            if ticks and ramp == (abs(gap) - 1) // self.acceleration:
                self.velocity = self.goal
                self.position += self.goal
                ticks -= 1
        self.position += ticks * self.velocity

    def after(self, ticks: int) -> Profiler:
        """A copy, advanced."""
        copy = Profiler(self.position, self.velocity, self.goal, self.acceleration)
        copy.run(ticks)
        return copy


class TickClock:
    """When the ticks of one chip end, tracked from the times at which its answers began.

    A second-order loop: phase and period follow the observations; before motion ``observe`` is fed a dozen answers.
    An observation is an upper bound plus port delay, so an outlier of more than half a tick is not believed. fast_ppb:
    by how much the chip's crystal is known to run fast; None: not known, the first observations then set the period.
    """

    __slots__ = ("_known", "_last_tick", "origin_ns", "period_ns", "seen")

    PHASE_GAIN = 0.25
    PERIOD_GAIN = 0.1

    def __init__(self, fast_ppb: int | None = None) -> None:
        self.origin_ns = 0.0
        self.period_ns = TICK_NS / (1 + (fast_ppb or 0) / 1e9)
        self._known = fast_ppb is not None
        self.seen = 0
        self._last_tick = 0

    def observe(self, tick_end_ns: int) -> int:
        """An answer began at ``tick_end_ns``: returns the number of the tick that ended."""
        if not self.seen:
            self.origin_ns = float(tick_end_ns)
            self.seen = 1
            return 0
        tick = round((tick_end_ns - self.origin_ns) / self.period_ns)
        late_ns = tick_end_ns - self.end_ns(tick)
        span = max(tick - self._last_tick, 1)
        gain = max(1.0 / (self.seen + 1), self.PHASE_GAIN)
        follow = self._known or self.seen > 2
        self.period_ns += self.PERIOD_GAIN * gain * late_ns / span if follow else late_ns / max(tick, 1)
        self.origin_ns = tick_end_ns - (1.0 - gain) * late_ns - tick * self.period_ns
        self.seen += 1
        self._last_tick = tick
        return tick

    def end_ns(self, tick: int) -> float:
        """Predicted end of a tick."""
        return self.origin_ns + tick * self.period_ns

    def next_after(self, time_ns: float) -> int:
        """The first tick that ends at or after ``time_ns``."""
        return -int((self.origin_ns - time_ns) // self.period_ns)
