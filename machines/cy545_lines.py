"""The drivers of a machine's CY545s on their lines, simulated or real."""

from __future__ import annotations

from machines.cy545 import NS_PER_MS, cy545_tables
from machines.schema import Cy545Axis, MachineConfig
from nmc.cy545 import ChipLines, Cy545
from nmc.link import Link
from nmc.recording_link import RecordingLink
from sim.build import Simulation
from sim.cy545_line import Cy545Link


def simulated_indexers(config: MachineConfig, simulation: Simulation) -> dict[str, Cy545]:
    """Drivers on the twin's lines, by axis."""
    links = {link.chip.name: link for link in simulation.links if isinstance(link, Cy545Link)}
    return {
        axis: _driver(config, axis, table, links[axis], links[axis]) for axis, table in cy545_tables(config).items()
    }


def open_ports(config: MachineConfig) -> dict[str, Cy545]:
    """Drivers on real ports, by axis. Raises NmcError; nothing stays open then."""
    tables = cy545_tables(config)
    if not tables:
        return {}
    from nmc.cy545_serial import Cy545SerialLink

    found: dict[str, Cy545] = {}
    try:
        for axis, table in tables.items():
            bus = config.bus[table.bus]
            port = Cy545SerialLink(bus.port, bus.baud, table.abort_line, table.home_line, table.cts)
            found[axis] = _driver(config, axis, table, RecordingLink(port), port)
    except Exception:
        for indexer in found.values():
            indexer.link.close()
        raise
    return found


def _driver(config: MachineConfig, axis: str, table: Cy545Axis, link: Link, lines: ChipLines) -> Cy545:
    return Cy545(
        link,
        lines,
        name=f"axis {axis} (CY545)",
        baud=config.bus[table.bus].baud,
        gap_ns=round(table.command_gap_ms * NS_PER_MS),
        can_abort=table.abort_line != "none",
        use_cts=table.cts,
    )
