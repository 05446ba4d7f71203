"""The line of a CY545: transmit and receive pairs of its own, and the few wires that a serial port has beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sim.bus import Bus
from sim.commandline import CommandLine
from sim.cy545 import Cy545
from sim.cy545_spec import Cy545Port
from sim.draws import Draws
from sim.link import SimLink
from sim.trace import BusLog
from sim.violations import Log
from sim.world import World

if TYPE_CHECKING:
    from sim.build import Simulation


class Cy545Bus(Bus):
    """Point to point and both ways at once: the host may talk while the chip answers."""

    def __init__(
        self, spec: Cy545Port, world: World, log: Log, draws: tuple[Draws, Draws], bytes_log: BusLog | None
    ) -> None:
        super().__init__(spec.port, world, log, draws[0], bytes_log)
        ppm = spec.crystal_ppm + (2 * draws[1].unit() - 1) * spec.crystal_ppm_max
        self.chip = Cy545(spec, self, round(ppm * 1000), draws[1])
        sniff = bytes_log.host if bytes_log is not None else None
        self.command = CommandLine(world, [self.chip], self.status, sniff, self._intrude)

    def rewire(self) -> None:
        """There is no chain."""

    def _intrude(self, at_ns: int) -> None:
        """Talking during an answer disturbs nobody."""


class Cy545Link(SimLink):
    """The host's port: bytes, INHIBIT_ABORT on an output, the switch and CTS on inputs."""

    def __init__(self, bus: Cy545Bus, draws: Draws, jitter_max_ns: int) -> None:
        super().__init__(bus, draws, jitter_max_ns)
        self.chip = bus.chip

    def pull_abort(self, low: bool) -> None:
        """Drive INHIBIT_ABORT."""
        if not self.fenced:
            self.chip.set_abort(low)

    def switch_closed(self) -> bool:
        """The home switch."""
        return self.chip.switch_closed

    def clear_to_send(self) -> bool:
        """CTS."""
        return self.chip.clear_to_send


def add_cy545(simulation: Simulation, spec: Cy545Port, draws: Sequence[Draws], bytes_log: BusLog | None) -> None:
    """Put a CY545 on a line of its own into a simulation, behind the lines that it has. draws: line, host, chip."""
    bus = Cy545Bus(spec, simulation.world, simulation.log, (draws[0], draws[2]), bytes_log)
    simulation.buses.append(bus)
    simulation.links.append(Cy545Link(bus, draws[1], spec.host_jitter_max_ns))
    simulation.indexers[spec.name] = bus.chip
