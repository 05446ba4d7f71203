"""Virtual time: integer nanoseconds and a queue of things that will happen.

Invariant: time never goes back, and two events at the same instant happen in the order in which they were announced,
so a run is a function of its inputs alone.
"""

from __future__ import annotations

from collections.abc import Callable
from heapq import heappop, heappush

NEVER = 1 << 62  # ns; 146 years


class World:
    """The clock of one simulation and its event queue. All times are ns since power-up."""

    __slots__ = ("_queue", "_serial", "now_ns")

    def __init__(self) -> None:
        self.now_ns = 0
        self._queue: list[tuple[int, int, Callable[[], None]]] = []
        self._serial = 0

    def call_at(self, time_ns: int, action: Callable[[], None]) -> None:
        """Let ``action`` happen at ``time_ns``; a time in the past means now."""
        self._serial += 1
        heappush(self._queue, (time_ns, self._serial, action))

    def next_event_ns(self) -> int:
        """Time of the next event; NEVER if there is none."""
        return self._queue[0][0] if self._queue else NEVER

    def step(self) -> None:
        """Advance to the next event and let it happen."""
        time_ns, _, action = heappop(self._queue)
        self.now_ns = max(self.now_ns, time_ns)
        action()

    def run_until(self, time_ns: int) -> None:
        """Let everything up to and including ``time_ns`` happen; the clock then stands there."""
        while self._queue and self._queue[0][0] <= time_ns:
            self.step()
        self.now_ns = max(self.now_ns, time_ns)
