"""One serial bus: command line, status line, the ADDR chain, and the modules on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from sim.commandline import CommandLine
from sim.draws import Draws
from sim.statusline import StatusLine
from sim.trace import BusLog
from sim.violations import Log
from sim.world import World

if TYPE_CHECKING:
    from sim.module import NmcModule

SILENT_WAIT_NS = 500_000  # sheets section 3.3 / 4.1: after a command that nobody answers


class Bus:
    """The wires. modules: in chain order, first = farthest from the host, whose ADDR_IN is grounded."""

    def __init__(self, name: str, world: World, log: Log, draws: Draws, bytes_log: BusLog | None) -> None:
        self.name = name
        self.world = world
        self.log = log
        self.modules: list[NmcModule] = []
        self.noise: Callable[[bytes], tuple[list[int], list[bool]]] | None = None  # on the command line
        self.status = StatusLine(draws, bytes_log.status if bytes_log is not None else None)
        self.command = CommandLine(
            world, self.modules, self.status, bytes_log.host if bytes_log is not None else None, self._intrude
        )
        self._silent = False
        self._silent_from_ns = -1
        self._hold_before_ns = -1
        self._answered_at_ns = -1

    def rewire(self) -> None:
        """Follow the ADDR chain: a module hears the bus while its neighbour's ADDR_OUT is LOW (level, X-42)."""
        low = True
        for module in self.modules:
            module.set_alive(low and not module.broken)
            low = module.addr_out_low

    def reply(self, data: bytes, start_ns: int, baud: float) -> None:
        """A module answers from ``start_ns`` on."""
        self.status.send(data, start_ns, baud, self.world.now_ns)
        self._answered()

    def _answered(self) -> None:
        """A group's leader answers, whether it hears the command before or after its members."""
        if self._silent and self._silent_from_ns == self.world.now_ns:
            self.command.hold_until_ns = self._hold_before_ns
        self._silent = False
        self._answered_at_ns = self.world.now_ns

    def expect_reply(self, until_ns: int) -> None:
        """A module has a command to answer at ``until_ns``."""
        self._answered()
        self.command.hold_until_ns = max(self.command.hold_until_ns, until_ns)

    def expect_silence(self) -> None:
        """A command was taken that nobody answers: the host should wait before it goes on."""
        now_ns = self.world.now_ns
        if self._answered_at_ns == now_ns or (self._silent and self._silent_from_ns == now_ns):
            return
        self._silent = True
        self._silent_from_ns = now_ns
        self._hold_before_ns = self.command.hold_until_ns
        self.command.hold_until_ns = max(self._hold_before_ns, now_ns + SILENT_WAIT_NS)

    def _intrude(self, at_ns: int) -> None:
        """The host talks although a command is still being digested: all transmitters are dropped (X-52)."""
        self.command.hold_until_ns = -1
        cut = self.status.abort(at_ns)
        for module in self.modules:
            cut = module.drop_reply() or cut
        if cut or not self._silent:
            self.log.violation(at_ns, self.name, "N-022", "host talked before the reply was in: the reply is lost")
        else:
            self.log.violation(at_ns, self.name, "N-023", "host talked less than 0.5 ms after a command without reply")
        self._silent = False
