"""The line from the host to all modules: bytes leave one after another and reach every listener at the same moment.

The usual case, one whole packet that every module understands, costs one event: it is delivered at the instant of its
last byte. Whenever anything could tell the difference (other rates, half-received packets, replies still on the way,
injected faults, a module that wakes up meanwhile) the line goes byte by byte.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from sim.statusline import StatusLine
from sim.uart import BITS_PER_BYTE, arrivals_ns, misread, readable
from sim.world import World

HEADER = 0xAA


class Listener(Protocol):
    """A module as the line sees it."""

    alive: bool
    rx_baud: float
    epoch: int
    idle: bool

    def hear_byte(self, value: int, clean: bool) -> None:
        """One byte has arrived; ``clean`` False: with a framing error."""

    def hear_packet(self, address: int, command: int, data: bytes, good: bool) -> None:
        """A whole packet has arrived."""

    def matches(self, address: int, command: int) -> bool:
        """Whether a packet is for this module."""


@dataclass(slots=True)
class _Segment:
    """Bytes handed over by one write."""

    data: Sequence[int]
    arrivals: list[int]
    start_ns: int
    baud: float
    clean: Sequence[bool] | None
    garbled_for: list[Listener]
    next: int = 0
    announced: bool = False


class CommandLine:
    """The host's transmit pair. ``intrude(time_ns)`` is called when the host talks over a reply."""

    def __init__(
        self,
        world: World,
        listeners: Sequence[Listener],
        status: StatusLine,
        sniff: Callable[[Sequence[int], Sequence[int]], None] | None,
        intrude: Callable[[int], None],
    ) -> None:
        self.free_ns = 0
        self.hold_until_ns = -1  # a command is being digested; talking before this is a breach
        self._world = world
        self._listeners = listeners
        self._status = status
        self._sniff = sniff
        self._intrude = intrude
        self._queue: deque[_Segment] = deque()
        self._ticket = 0
        self._whole = False
        self._fits: dict[float, bool] = {}

    def transmit(self, data: Sequence[int], start_ns: int, baud: float, clean: Sequence[bool] | None = None) -> None:
        """Let ``data`` leave from ``start_ns`` on, or after what is already leaving.

        clean: per byte, whether it arrives without framing error (None: all do); a value of -1 is lost on the way.
        """
        start_ns = max(start_ns, self.free_ns)
        arrivals = arrivals_ns(start_ns, len(data), baud)
        self.free_ns = arrivals[-1]
        self._queue.append(_Segment(data, arrivals, start_ns, baud, clean, []))
        if len(self._queue) == 1:
            self._begin()

    def disturb(self) -> None:
        """A listener's rate or liveness is about to change: what is in flight must be looked at byte by byte."""
        self._fits.clear()
        if self._whole and self._queue:
            self._whole = False
            self._ticket += 1
            segment = self._queue[0]
            while segment.arrivals[segment.next] <= self._world.now_ns:
                self._hear(segment)  # nothing completes here: the packet ends with its last byte
            self._announce_next(segment)

    def _begin(self) -> None:
        segment = self._queue[0]
        self._whole = self._is_whole(segment)
        self._ticket += 1
        if self._whole:
            self._world.call_at(segment.arrivals[-1], partial(self._deliver, self._ticket))
        else:
            self._announce_next(segment)

    def _is_whole(self, segment: _Segment) -> bool:
        data = segment.data
        if segment.clean is not None or len(data) < 4 or data[0] != HEADER or len(data) != 4 + (data[2] >> 4):
            return False
        first_ns = segment.start_ns
        if self._status.busy_until_ns > first_ns or self.hold_until_ns > first_ns:
            return False
        fits = self._fits.get(segment.baud)
        if fits is None:
            fits = all(readable(segment.baud, m.rx_baud) for m in self._listeners if m.alive)
            self._fits[segment.baud] = fits
        return fits and all(m.idle for m in self._listeners)

    def _deliver(self, ticket: int) -> None:
        if ticket != self._ticket:
            return
        self._whole = False
        segment = self._queue.popleft()
        data = segment.data
        if self._sniff is not None:
            self._sniff(segment.arrivals, data)
        packet = data if isinstance(data, bytes) else bytes(data)
        good = (sum(packet) - packet[0] - packet[-1]) & 0xFF == packet[-1]
        address, command = packet[1], packet[2]
        payload = packet[3:-1]
        for module in [m for m in self._listeners if m.alive and m.matches(address, command)]:
            module.hear_packet(address, command, payload, good)
        if self._queue:
            self._begin()

    def _announce_next(self, segment: _Segment) -> None:
        if not segment.announced:
            segment.announced = True
            self._announce_garbage(segment)
        self._world.call_at(segment.arrivals[segment.next], partial(self._one, self._ticket))

    def _announce_garbage(self, segment: _Segment) -> None:
        """Listeners at another rate see bytes of their own making, at times of their own."""
        for module in self._listeners:
            if module.alive and not readable(segment.baud, module.rx_baud):
                segment.garbled_for.append(module)
                for at_ns, value in misread(
                    [v & 0xFF for v in segment.data], segment.start_ns, segment.baud, module.rx_baud
                ):
                    self._world.call_at(at_ns, partial(self._garbage, module, module.epoch, value))

    @staticmethod
    def _garbage(module: Listener, epoch: int, value: int) -> None:
        if module.alive and module.epoch == epoch:
            module.hear_byte(value, False)

    def _one(self, ticket: int) -> None:
        if ticket != self._ticket or not self._queue:
            return
        segment = self._queue[0]
        self._hear(segment)
        if segment.next == len(segment.data):
            self._queue.popleft()
            if self._queue:
                self._begin()
        else:
            self._announce_next(segment)

    def _hear(self, segment: _Segment) -> None:
        """Byte number ``segment.next`` reaches everyone."""
        index = segment.next
        segment.next = index + 1
        at_ns, value = segment.arrivals[index], segment.data[index]
        if value < 0:  # lost on the way
            return
        if self._sniff is not None:
            self._sniff((at_ns,), (value,))
        start_ns = int(at_ns - BITS_PER_BYTE * 1e9 / segment.baud)
        if self._status.busy_until_ns > start_ns or self.hold_until_ns > start_ns:
            self._intrude(at_ns)
        clean = segment.clean is None or segment.clean[index]
        for module in [m for m in self._listeners if m.alive]:
            if readable(segment.baud, module.rx_baud):
                module.hear_byte(value, clean)
            elif module not in segment.garbled_for:
                module.hear_byte(value, False)
