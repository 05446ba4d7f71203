"""A chip's own clock: a crystal that is a little wrong, started at a moment of its own.

Chip time is counted in whole base ticks, so a pulse train of constant period never accumulates rounding: only the
conversion of one instant to world nanoseconds rounds, by less than 1 ns.
"""

from __future__ import annotations

from dataclasses import dataclass

_PPB = 10**9


@dataclass(frozen=True, slots=True)
class ChipClock:
    """Maps ticks of a chip to world ns. tick_ns: nominal length of a tick; ppb > 0: the crystal runs fast.

    The nominal part and what the crystal adds to it are reckoned apart: so numbers stay below 2^62 for twelve hours.
    """

    tick_ns: int
    ppb: int
    phase_ns: int = 0

    def ns_of(self, tick: int) -> int:
        """World time at which tick number ``tick`` happens."""
        nominal_ns = tick * self.tick_ns
        return self.phase_ns + nominal_ns - (nominal_ns * self.ppb + _PPB + self.ppb - 1) // (_PPB + self.ppb)

    def tick_at(self, time_ns: int) -> int:
        """Number of the last tick that has happened at ``time_ns``."""
        since_ns = time_ns - self.phase_ns + 1
        extra = since_ns * self.ppb + since_ns % self.tick_ns * _PPB - 1
        return since_ns // self.tick_ns + extra // (self.tick_ns * _PPB)

    def span_ns(self, ticks: float) -> float:
        """Length of ``ticks`` ticks in world ns."""
        return ticks * self.tick_ns * _PPB / (_PPB + self.ppb)
