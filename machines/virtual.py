"""The simulated machine as a serial port of this computer, for any program that speaks NMC."""

from __future__ import annotations

from collections.abc import Callable

from machines.schema import MachineConfig
from machines.wiring import bus_specs
from nmc.serial_link import DescriptorLink
from sim.build import Simulation, build
from sim.virtualport import VirtualPort
from sim.virtualports import serve_all

_NO_DESCRIPTOR = -1


def serve_on_pty(
    config: MachineConfig,
    announce: Callable[[str], None],
    stopped: Callable[[], bool],
    *,
    seed: int | None = None,
    unpaced: bool = False,
) -> Simulation:
    """Serve the machine's buses until ``stopped()``; ``announce`` is told each device path once clients may open it.

    Several buses are announced in the order of ``bus_specs``: those of NMC modules first, then the lines of CY545s.
    Motion follows the wall clock; with ``unpaced`` only answers come at once. Returns the simulation as it was left.
    Raises OSError where there are no pseudo-terminals.
    """
    simulation = build(bus_specs(config), config.sim.seed if seed is None else seed)
    clock = DescriptorLink(_NO_DESCRIPTOR, "clock")
    ports: list[VirtualPort] = []
    try:
        for bus in range(len(simulation.buses)):
            ports.append(VirtualPort(simulation, clock, bus, unpaced))
        for port in ports:
            announce(port.device)
        serve_all(ports, stopped)
    finally:
        for port in ports:
            port.close()
    return simulation
