"""The loop of a run: exchanges out, evidence in, and between two of them everything that wants to look or to ask."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol

from machines.bringup import Connection
from machines.control import Control
from machines.governor import Governor
from machines.outcome import StreamStatistics
from machines.ratecontrol import Floor, HoldRecord, RateController
from machines.settling import LastCommands
from machines.several import governor_of, played, tell_starts
from machines.strain import Strain
from nmc.chips.common import LOAD_TRAJECTORY, STOP_MOTOR
from nmc.program import Evidence, Exchange, ExchangeSource
from planner.stream import Progress, StreamCounts
from planner.stream_buses import BusStreams
from planner.types import Trajectory

PROGRESS_EVERY_NS = 100_000_000


class RunSource(ExchangeSource, Protocol):
    """A stream that tells where it is."""

    plan_start_ns: int
    trajectory: Trajectory

    def progress(self) -> Progress:
        """Where the plan stands."""

    def counts(self) -> StreamCounts:
        """Slices so far."""


@dataclass(frozen=True, slots=True)
class Onlookers:
    """Who looks on: told of progress and of every exchange, asked whether to stop and for requests."""

    progress: Callable[[Progress], None]
    watch: Callable[[Evidence], None]
    stop_requested: Callable[[], bool]
    control: Control


@dataclass(frozen=True, slots=True)
class Streamed:
    """How a stream went. last: the exchange after which it was asked to stop, None if it came to its end.

    commanded: where each PIC-SERVO was told to stand last, counts.
    """

    last: Evidence | None
    statistics: StreamStatistics
    holds: tuple[HoldRecord, ...]
    retimed: bool
    commanded: dict[str, int]


def stream(
    source: RunSource | BusStreams, connection: Connection, floor: Floor, onlookers: Onlookers, strain: Strain
) -> Streamed:
    """Play a source to its end, or until it is asked to stop; stopping the motors is then the caller's business."""
    link, simulated = connection.links[0], connection.simulation is not None
    floor.note("run_begins", link.now_ns(), plan_start_ns=source.plan_start_ns)
    statistics = StreamStatistics()
    counters = [bus.counters for bus in connection.buses]
    packets = sum(each.packets for each in counters)
    wire_bytes = sum(each.bytes_out + each.bytes_in for each in counters)
    next_ns, line = link.now_ns(), 0
    governor = governor_of(connection)
    evidences, recall = played(source, connection)
    rates = RateController(source, onlookers.control, governor, floor, recall, strain)
    last: Evidence | None = None
    told = LastCommands(connection.config)
    busy_ns = dict.fromkeys(range(len(connection.buses)), 0)
    with closing(evidences):
        for evidence in evidences:
            busy_ns[evidence.exchange.bus] += evidence.replied_ns - evidence.sent_ns
            statistics.loads += _is_load(evidence.exchange)
            if told.needed:
                told.see(evidence)
            onlookers.watch(evidence)
            if evidence.exchange.line != line:
                line = evidence.exchange.line
                floor.note("line", evidence.sent_ns, line=line)
            if evidence.replied_ns >= next_ns:
                next_ns = evidence.replied_ns + PROGRESS_EVERY_NS
                onlookers.progress(rates.shown(source.progress()))
            rates.after(evidence)
            if rates.held and simulated:
                onlookers.control.pause()
            if onlookers.stop_requested() or rates.stop_asked:
                last = evidence
                break
    tell_starts(source, floor.note, link.now_ns())
    statistics.busy_ns = max(busy_ns.values())
    statistics.packets = sum(each.packets for each in counters) - packets
    statistics.bytes = sum(each.bytes_out + each.bytes_in for each in counters) - wire_bytes
    statistics.late_slices = source.counts().late_slices
    statistics.strain_steps = strain.greatest_steps
    _take_delays(statistics, governor, rates)
    onlookers.progress(rates.shown(source.progress()))
    return Streamed(last, statistics, tuple(rates.holds), rates.changes > 0, told.counts)


def _is_load(exchange: Exchange) -> bool:
    """Whether an exchange gives a motor something to do: Load Trajectory, or Stop Motor with a Stop Here position."""
    return exchange.command == LOAD_TRAJECTORY or (exchange.command == STOP_MOTOR and len(exchange.data) > 1)


def _take_delays(statistics: StreamStatistics, governor: Governor, rates: RateController) -> None:
    """What was measured of the host while it ran."""
    statistics.host_delay_p99_ms = governor.delays.quantile_ns(0.99) / 1e6
    statistics.host_delay_max_ms = governor.delays.greatest_ns / 1e6
    statistics.late_exchanges = governor.delays.late
    statistics.least_speed = rates.least_share
    statistics.unheeded = rates.unheeded
