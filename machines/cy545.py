"""CY545 axes of a machine: what planner, simulator and driver are told of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from machines.cy545rates import read_rates
from machines.schema import Cy545Axis, MachineConfig, SimMotor
from nmc.chips.cy545 import BITS_PER_CHAR
from planner.cy545 import Indexer
from sim.cy545_spec import Cy545Port
from sim.spec import Switch

NS_PER_MS = 1_000_000
NS_PER_S = 1_000_000_000
COMMANDS_BEFORE, CHARACTERS_BEFORE = 6, 42
"""F, R, S, N, + and G with their longest arguments."""
CHARACTERS_AFTER = 14
"""?P and its answer."""
MARGIN_NS = 30_000_000
REAL_PORT_JITTER_MS = 2.0


def cy545_tables(config: MachineConfig) -> dict[str, Cy545Axis]:
    """Axes on CY545s by name, in the order of their lines."""
    mine = [(name, table) for name, table in config.axis.items() if isinstance(table, Cy545Axis)]
    order = list(config.bus)
    return dict(sorted(mine, key=lambda item: order.index(item[1].bus)))


def line_names(config: MachineConfig) -> frozenset[str]:
    """Names of the buses that are lines of CY545s."""
    return frozenset(table.bus for table in cy545_tables(config).values())


def stand_ins(config: MachineConfig) -> list[str]:
    """What must be said whenever a rate table is used that is not the manual's."""
    return [
        f"axis {axis}: {rates.source} is a stand-in for the CY545's rate table; a real chip's times and speeds differ"
        for axis, table in cy545_tables(config).items()
        if (rates := read_rates(table.rate_table)).stand_in
    ]


def indexer_of(config: MachineConfig, axis: str, table: Cy545Axis, lead_in_ns: int) -> Indexer:
    """An axis as planner lowers to it; lead_in_ns: what the stream of the other axes needs to begin after a move."""
    bus = config.bus[table.bus]
    jitter_ms = bus.host_jitter_ms
    if jitter_ms is None:
        jitter_ms = config.sim.host_jitter_ms if bus.port == "sim" else REAL_PORT_JITTER_MS
    pause_ns = (table.command_gap_ms + jitter_ms) * NS_PER_MS
    char_ns = BITS_PER_CHAR * NS_PER_S / bus.baud
    before_ns = CHARACTERS_BEFORE * char_ns + COMMANDS_BEFORE * pause_ns + MARGIN_NS
    after_ns = CHARACTERS_AFTER * char_ns + 2 * pause_ns + MARGIN_NS + lead_in_ns
    return Indexer(
        axis=axis,
        bus=list(config.bus).index(table.bus),
        steps_per_unit=table.steps_per_unit,
        rates=read_rates(table.rate_table),
        velocity=table.max_velocity,
        acceleration=table.max_acceleration,
        pull_in_velocity=table.pull_in_velocity,
        crystal_mhz=table.crystal_mhz,
        before_s=before_ns / NS_PER_S,
        after_s=after_ns / NS_PER_S,
    )


def line_specs(config: MachineConfig, switches: Mapping[str, Sequence[Switch]]) -> list[Cy545Port]:
    """The simulated chips, each on its line. switches: of the axes' mechanics; of them the home switch counts."""
    sim = config.sim
    specs = []
    for axis, table in cy545_tables(config).items():
        twin = sim.axis.get(axis, SimMotor())
        specs.append(
            Cy545Port(
                name=axis,
                port=table.bus,
                rates=read_rates(table.rate_table),
                baud=config.bus[table.bus].baud,
                crystal_mhz=table.crystal_mhz,
                crystal_ppm=twin.crystal_ppm or 0.0,
                crystal_ppm_max=sim.crystal_ppm if twin.crystal_ppm is None else 0.0,
                start_delay_max_ns=round(sim.start_delay_ms * NS_PER_MS),
                switch=next((switch for switch in switches[axis] if switch.pin == "home"), None),
                start_steps=round(twin.start_at * table.steps_per_unit),
                host_jitter_max_ns=round(sim.host_jitter_ms * NS_PER_MS),
            )
        )
    return specs
