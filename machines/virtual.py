"""The simulated machine as a serial port of this computer, for any program that speaks NMC."""

from __future__ import annotations

from collections.abc import Callable

from machines.schema import MachineConfig
from machines.wiring import bus_specs
from nmc.serial_link import DescriptorLink
from sim.build import Simulation, build
from sim.virtualport import VirtualPort

_NO_DESCRIPTOR = -1


def serve_on_pty(
    config: MachineConfig,
    announce: Callable[[str], None],
    stopped: Callable[[], bool],
    *,
    seed: int | None = None,
    unpaced: bool = False,
) -> Simulation:
    """Serve the machine's bus until ``stopped()``; ``announce`` is told the device path once clients may open it.

    Motion follows the wall clock; with ``unpaced`` only answers come at once. Returns the simulation as it was left.
    Raises ValueError for a machine with several buses, OSError where there are no pseudo-terminals.
    """
    if len(config.bus) != 1:
        raise ValueError(f"a virtual port is one bus, the machine has {len(config.bus)}")
    simulation = build(bus_specs(config), config.sim.seed if seed is None else seed)
    port = VirtualPort(simulation, DescriptorLink(_NO_DESCRIPTOR, "clock"), unpaced=unpaced)
    try:
        announce(port.device)
        port.serve(stopped)
    finally:
        port.close()
    return simulation
