"""The drivers of a machine's CY545s on their lines, simulated or real."""

from __future__ import annotations

from collections.abc import Sequence

from machines.cy545 import NS_PER_MS, cy545_tables
from machines.schema import Cy545Axis, MachineConfig
from nmc.cy545 import ChipLines, Cy545
from nmc.link import Link
from nmc.recording_link import RecordingLink
from sim.build import Simulation
from sim.cy545_line import Cy545Link

SLICE_NS = 5_000_000
"""How long the other links may be left alone."""


def simulated_indexers(config: MachineConfig, simulation: Simulation) -> dict[str, Cy545]:
    """Drivers on the twin's lines, by axis."""
    links = {link.chip.name: link for link in simulation.links if isinstance(link, Cy545Link)}
    return {
        axis: _driver(config, axis, table, links[axis], links[axis]) for axis, table in cy545_tables(config).items()
    }


class LivingLink:
    """A port on which waiting also shows the watchdogs of the machine's other ports that the host is alive."""

    def __init__(self, inner: Link, others: Sequence[Link]) -> None:
        self.inner = inner
        self._others = others

    def now_ns(self) -> int:
        """Present time."""
        return self.inner.now_ns()

    def write(self, data: bytes) -> None:
        """Hand bytes to the port."""
        self._live()
        self.inner.write(data)

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Wait for bytes, in slices."""
        data = b""
        while True:
            self._live()
            slice_ns = min(deadline_ns, self.inner.now_ns() + SLICE_NS)
            data += self.inner.read(count - len(data), slice_ns)
            if len(data) >= count or self.inner.now_ns() >= deadline_ns:
                return data

    def sleep_until(self, time_ns: int) -> None:
        """Wait, in slices."""
        while (now_ns := self.inner.now_ns()) < time_ns:
            self._live()
            self.inner.sleep_until(min(time_ns, now_ns + SLICE_NS))

    def set_baud(self, baud: int) -> None:
        """Change the host's rate."""
        self.inner.set_baud(baud)

    def flush_input(self) -> None:
        """Drop what nobody has read."""
        self.inner.flush_input()

    def close(self) -> None:
        """Give the port back."""
        self.inner.close()

    def _live(self) -> None:
        for link in self._others:
            link.sleep_until(link.now_ns() + 1)  # a moment's sleep on a watched port is a heartbeat


def open_ports(config: MachineConfig, others: Sequence[Link]) -> dict[str, Cy545]:
    """Drivers on real ports, by axis. others: the machine's other links. Raises NmcError; nothing stays open then."""
    tables = cy545_tables(config)
    if not tables:
        return {}
    from nmc.cy545_serial import Cy545SerialLink

    found: dict[str, Cy545] = {}
    try:
        for axis, table in tables.items():
            bus = config.bus[table.bus]
            port = Cy545SerialLink(bus.port, bus.baud, table.abort_line, table.home_line, table.cts)
            found[axis] = _driver(config, axis, table, RecordingLink(LivingLink(port, others)), port)
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
