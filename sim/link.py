"""The host's end of a simulated bus: an ``nmc.link.Link`` on which waiting is the passing of virtual time."""

from __future__ import annotations

from collections.abc import Sequence

from sim.bus import Bus
from sim.draws import Draws


class SimLink:
    """A port of the host. Every write waits U(0, jitter_max_ns) before its first bit leaves; bytes leave one by one."""

    def __init__(self, bus: Bus, draws: Draws, jitter_max_ns: int) -> None:
        self.bus = bus
        self.world = bus.world
        self.baud = 19200
        self.jitter_max_ns = jitter_max_ns
        self.fenced = False  # True: the host is dead or shut out, nothing it writes leaves any more
        self._draws = draws

    def now_ns(self) -> int:
        """Present virtual time."""
        return self.world.now_ns

    def write(self, data: bytes) -> None:
        """Hand bytes to the port; returns at once."""
        if not data or self.fenced:
            return
        start_ns = self.world.now_ns + self._draws.below_ns(self.jitter_max_ns)
        if self.bus.noise is None:
            self.bus.command.transmit(bytes(data), start_ns, float(self.baud))
        else:
            values, clean = self.bus.noise(data)
            if values:
                self.bus.command.transmit(values, start_ns, float(self.baud), clean)

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Let time pass until ``count`` bytes are in or ``deadline_ns`` has come."""
        world, status = self.world, self.bus.status
        while True:
            due = status.due_ns(count)
            limit = deadline_ns if due is None or due > deadline_ns else due
            if world.next_event_ns() > limit:
                world.run_until(limit)
                return status.take(count, world.now_ns)
            world.step()

    def receive(self, count: int) -> bytes:
        """What is in at the present time, at most ``count`` bytes."""
        return self.bus.status.take(count, self.world.now_ns)

    @property
    def root(self) -> SimLink:
        """A simulated port waits for itself."""
        return self

    @property
    def patience_ns(self) -> int:
        """Nobody is impatient."""
        return 0

    def wait_first(self, wanted: Sequence[tuple[SimLink, int]], until_ns: int) -> None:
        """Let time pass until one of the links, all of this world, has its bytes, at most until ``until_ns``."""
        world = self.world
        while True:
            limit = until_ns
            for link, count in wanted:
                due = link.bus.status.due_ns(count)
                if due is not None and due < limit:
                    limit = due
            if world.next_event_ns() > limit:
                world.run_until(limit)
                return
            world.step()

    def sleep_until(self, time_ns: int) -> None:
        """Let time pass until ``time_ns``."""
        self.world.run_until(time_ns)

    def set_baud(self, baud: int) -> None:
        """Change the host's rate; what has been handed over still leaves at the old one."""
        self.baud = baud
        self.bus.status.settle(self.world.now_ns)
        self.bus.status.host_baud = float(baud)

    def flush_input(self) -> None:
        """Drop what was received and not read."""
        self.bus.status.settle(self.world.now_ns)
        self.bus.status.received.clear()

    def close(self) -> None:
        """Nothing to give back."""
