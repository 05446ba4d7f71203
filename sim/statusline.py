"""The line that all modules share to answer on: transmissions, collisions, and what the host has received.

A reply is put on the line at the moment it is decided, with the arrival time of every byte; until those times have
passed the bytes are only promised, and a host that talks meanwhile (PIC-SERVO data sheet section 4.1) or another module
that talks at the same time takes them back.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from sim.draws import Draws
from sim.uart import arrivals_ns, byte_ns, misread, readable


class StatusLine:
    """Bytes on their way to the host. ``sniff(time_ns, value)`` is told every byte that really arrives."""

    def __init__(self, draws: Draws, sniff: Callable[[int, int], None] | None) -> None:
        self.host_baud = 19200.0
        self.busy_until_ns = -1
        self.collisions = 0
        self.received = bytearray()
        self._promised: deque[tuple[int, int]] = deque()
        self._last_start_ns = -1
        self._last_byte_ns = 0.0
        self.draws = draws
        self.noise: Callable[[list[tuple[int, int]]], list[tuple[int, int]]] | None = None
        self._sniff = sniff

    def send(self, data: bytes, start_ns: int, baud: float, now_ns: int) -> None:
        """Let a module send ``data`` from ``start_ns`` on at its own ``baud``."""
        self.settle(now_ns)
        end_ns = int(start_ns + byte_ns(baud) * len(data))
        if readable(baud, self.host_baud):
            coming = list(zip(arrivals_ns(start_ns, len(data), baud), data, strict=True))
        else:
            coming = misread(data, start_ns, baud, self.host_baud)
        if self.noise is not None:
            coming = self.noise(coming)
        if self._promised and start_ns < self.busy_until_ns and end_ns > self._last_start_ns:
            self._collide(coming, start_ns, end_ns, byte_ns(baud))
        else:
            self._promised.extend(coming)
        self.busy_until_ns = max(self.busy_until_ns, end_ns)
        self._last_start_ns = start_ns
        self._last_byte_ns = byte_ns(baud)

    def _collide(self, coming: list[tuple[int, int]], start_ns: int, end_ns: int, width_ns: float) -> None:
        """Two drivers on one pair: where the transmissions overlap, the host sees noise, one byte for both."""
        self.collisions += 1
        garbled: list[tuple[int, int]] = []
        for arrival, value in self._promised:
            overlaps = arrival > start_ns and arrival - self._last_byte_ns < end_ns
            garbled.append((arrival, self._noise(value)) if overlaps else (arrival, value))
        old = [arrival for arrival, _ in self._promised]
        for arrival, value in coming:
            if not any(abs(arrival - other) < width_ns for other in old):
                garbled.append((arrival, value))
        garbled.sort()
        self._promised = deque(garbled)

    def _noise(self, value: int) -> int:
        """Some value that is not ``value``: a garbled byte that passes for a good one would prove nothing."""
        return value ^ (1 + int(self.draws.unit() * 255))

    def abort(self, at_ns: int) -> bool:
        """Every transmitter falls silent at ``at_ns``; returns whether one had been talking or about to."""
        self.settle(at_ns)
        cut = bool(self._promised) or self.busy_until_ns > at_ns
        self._promised.clear()
        self.busy_until_ns = min(self.busy_until_ns, at_ns)
        return cut

    def settle(self, now_ns: int) -> None:
        """Bytes whose time has come are received."""
        promised = self._promised
        while promised and promised[0][0] <= now_ns:
            arrival, value = promised.popleft()
            self.received.append(value)
            if self._sniff is not None:
                self._sniff(arrival, value)

    def due_ns(self, count: int) -> int | None:
        """When the host will have ``count`` unread bytes if nothing happens meanwhile; None: not foreseeable."""
        missing = count - len(self.received)
        if missing <= 0:
            return 0
        if missing > len(self._promised):
            return None
        return self._promised[missing - 1][0]

    def take(self, count: int, now_ns: int) -> bytes:
        """Up to ``count`` received bytes, removed from the host's buffer."""
        self.settle(now_ns)
        data = bytes(self.received[:count])
        del self.received[:count]
        return data
