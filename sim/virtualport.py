"""The simulated machine in real time on a pseudo-terminal, for any NMC client of this computer.

Virtual time follows a clock that is handed in; bytes from the client are put on the wire at the moment they are read,
at the rate that the client has set on its end of the terminal; answers are given when their stop bits have ended.
``unpaced`` gives answers at once: time then runs ahead of the clock by at most ``AHEAD_NS`` while a client waits for an
answer, and motion still follows the clock.
"""

from __future__ import annotations

import contextlib
import os
import select
import termios
import tty
from collections.abc import Callable
from typing import Protocol

from sim.build import Simulation

AHEAD_NS = 20_000_000
_LONGEST_WAIT_S = 0.05
_BREATH_NS = 200_000  # how much to gain before going on when time is as far ahead as it may be
_CHUNK = 4096
_RATES = {getattr(termios, f"B{rate}"): rate for rate in (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400)}


class Clock(Protocol):
    """The wall clock, from outside."""

    def now_ns(self) -> int:
        """Monotonic time."""


class VirtualPort:
    """One bus of a simulation behind a pseudo-terminal. ``device``: the path that clients open."""

    def __init__(self, simulation: Simulation, clock: Clock, bus: int = 0, unpaced: bool = False) -> None:
        self.simulation = simulation
        self.clock = clock
        self.unpaced = unpaced
        self.answered = 0  # bytes given to the client so far
        self._bus = simulation.buses[bus]
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.device = os.ttyname(self._slave)
        self._origin_ns = clock.now_ns() - simulation.world.now_ns
        self._set_rate(19200)

    def _set_rate(self, baud: int) -> None:
        speeds = {rate: code for code, rate in _RATES.items()}
        attributes = termios.tcgetattr(self._slave)
        attributes[4] = attributes[5] = speeds[baud]
        termios.tcsetattr(self._slave, termios.TCSANOW, attributes)

    def client_baud(self) -> float:
        """The rate that the client has set; a rate without a name of its own is taken for the chips' own."""
        rate = _RATES.get(termios.tcgetattr(self._slave)[5])
        if rate is not None:
            return float(rate)
        alive = [m.rx_baud for m in self._bus.modules if m.alive]
        return alive[0] if alive else 19200.0

    def close(self) -> None:
        """Give the terminal back."""
        for handle in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(handle)

    def serve(self, stopped: Callable[[], bool]) -> None:
        """Serve clients until ``stopped()`` says so; it is asked at least every 50 ms."""
        while not stopped():
            ready, _, _ = select.select([self._master], [], [], self._patience_s())
            self.turn(bool(ready))

    @property
    def master(self) -> int:
        """Descriptor of our end of the terminal, to wait on."""
        return self._master

    def patience_s(self) -> float:
        """How long to wait for the client before something of our own is due."""
        return self._patience_s()

    def turn(self, readable: bool) -> None:
        """One turn of the loop: let time pass, hear the client, answer."""
        world = self.simulation.world
        world.run_until(max(world.now_ns, self._wall_ns()))
        if readable:
            self._hear()
        if self.unpaced:
            self._hurry()
        self._answer()

    def _wall_ns(self) -> int:
        return self.clock.now_ns() - self._origin_ns

    def _patience_s(self) -> float:
        """How long to wait for the client before something of our own is due."""
        wall_ns, world = self._wall_ns(), self.simulation.world
        due_ns = self._bus.status.due_ns(len(self._bus.status.received) + 1)
        if self.unpaced and self._answered_ns() > world.now_ns:
            return max(0.0, (world.now_ns + _BREATH_NS - AHEAD_NS - wall_ns) * 1e-9)
        next_ns = world.next_event_ns() if due_ns is None else min(due_ns, world.next_event_ns())
        return min(_LONGEST_WAIT_S, max(0.0, (next_ns - wall_ns) * 1e-9))

    def _hear(self) -> None:
        try:
            data = os.read(self._master, _CHUNK)
        except (BlockingIOError, OSError):
            return
        if not data:
            return
        world, command = self.simulation.world, self._bus.command
        baud = self.client_baud()
        self._bus.status.settle(world.now_ns)
        self._bus.status.host_baud = baud
        command.transmit(data, world.now_ns, baud)

    def _answered_ns(self) -> int:
        """When the answer to what has been heard will be in, as far as can be foreseen."""
        command, status = self._bus.command, self._bus.status
        return max(command.free_ns, command.hold_until_ns, status.busy_until_ns)

    def _hurry(self) -> None:
        """Let time run ahead of the clock, but not far: a long burst still takes its time on the wire."""
        world = self.simulation.world
        ahead_ns = self._wall_ns() + AHEAD_NS
        while world.now_ns < min(self._answered_ns(), ahead_ns):
            world.run_until(min(self._answered_ns(), ahead_ns))

    def _answer(self) -> None:
        status = self._bus.status
        data = status.take(_CHUNK, self.simulation.world.now_ns)
        if data:
            self.answered += len(data)
            # a client that does not read loses bytes, as on a wire
            with contextlib.suppress(BlockingIOError, OSError):
                os.write(self._master, data)
