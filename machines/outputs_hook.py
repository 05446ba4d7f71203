"""Where spindle, coolant and outputs meet the session: made ready, wrapped around a stream, switched off."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from machines.outputs_events import Rig, rig_of
from machines.outputs_source import OutputsSource
from machines.parts import Part
from machines.schema import MachineConfig
from nmc.bus import Bus
from nmc.errors import NmcError, RemoteFault
from nmc.program import Evidence, Exchange, ExchangeSource
from nmc.watchdog import Switch
from nmc.wire import pack
from planner.retime import RetimablePlan
from planner.stream_buses import BusStreams
from planner.types import Trajectory


def ready_rig(config: MachineConfig, buses: Sequence[Bus], simulated: bool) -> Rig | None:
    """The rig of a machine with everything off, None where there is none. Raises NmcError."""
    rig = rig_of(config, simulated)
    if not rig.anything:
        return None
    for exchange in [*(rig.drive.prepare() if rig.drive is not None else ()), *rig.panel.start()]:
        buses[exchange.bus].exchange(exchange)
    return rig


def off_exchanges(rig: Rig) -> list[Exchange]:
    """What takes power from the spindle at once, and switches off what a stop does not leave as it is."""
    return [*(rig.drive.off() if rig.drive is not None else ()), *rig.panel.off(stopping=True)]


def switch_off(rig: Rig, buses: Sequence[Bus]) -> None:
    """Everything off after a stop. Raises NmcError, when all has been tried, if something may still be on."""
    failed: list[str] = []
    for exchange in off_exchanges(rig):
        try:
            buses[exchange.bus].exchange(exchange)
        except RemoteFault as fault:
            if not fault.executed:  # a module that has lost its supply carries this out and says so
                failed.append(str(fault))
        except NmcError as error:
            failed.append(str(error))
    rig.wanted = dict(rig.panel.levels)
    if failed:
        raise NmcError(f"SPINDLE OR OUTPUTS MAY STILL BE ON: {'; '.join(failed)}")


def switches_of(rig: Rig | None, bus: int) -> list[Switch]:
    """What a watchdog says to the modules of a bus. It knows no words but these: a pin that a stop keeps goes off too
    where it shares its module with one that has to.
    """
    found: dict[tuple[int, int], Switch] = {}
    for exchange in off_exchanges(rig) if rig is not None else ():
        if exchange.bus == bus:
            packet = pack(exchange.address, exchange.command, exchange.data)
            found[exchange.address, exchange.command] = Switch(exchange.address, packet)
    return list(found.values())


class Planned(ExchangeSource, Protocol):
    """A stream that tells what it streams, and when that begins."""

    trajectory: Trajectory
    plan_start_ns: int


class NoMotion:
    """The stream of a bus on which nothing moves."""

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        """Never anything."""
        return None


def with_outputs(inner: ExchangeSource, rig: Rig | None, planned: Planned | BusStreams, poll: Exchange) -> Wrapped:
    """The stream of a machine with one of its own, with what the machine does beside moving.

    planned: whose times count. poll: an exchange that asks a module how it is.
    """
    return _wrapped(inner, rig, planned, poll, only=False)


def lanes_with_outputs(
    streams: BusStreams, rig: Rig | None, polls: Mapping[int, Exchange]
) -> tuple[dict[int, ExchangeSource], Callable[[], None]]:
    """The streams of several buses, each with the outputs of its own bus; and what takes back a Start that waits.

    polls: of every bus, an exchange that asks a module how it is.
    """
    if rig is None:
        return dict(streams.lanes), streams.recall
    buses = sorted({*streams.lanes, *rig.buses})
    found = {bus: _wrapped(streams.lanes.get(bus, NoMotion()), rig, streams, polls[bus], only=True) for bus in buses}

    def recall() -> None:
        streams.recall()
        for source in found.values():
            source.recall()

    return {bus: source.source for bus, source in found.items()}, recall


@dataclass(frozen=True, slots=True)
class Wrapped:
    """A stream, and what takes back a Start that waits in it to be sent."""

    source: ExchangeSource
    recall: Callable[[], None]


def _wrapped(
    inner: ExchangeSource, rig: Rig | None, planned: Planned | BusStreams, poll: Exchange, *, only: bool
) -> Wrapped:
    if rig is None:
        return Wrapped(inner, lambda: None)
    if begins_program(planned.trajectory):
        rig.said.clear()

    def start_ns() -> int:
        return planned.plan_start_ns + int(getattr(planned, "shift_ns", 0))

    closes = ends_program(planned.trajectory)
    source = OutputsSource(inner, planned.trajectory, rig, start_ns, poll=poll, only=only, closes=closes)
    return Wrapped(source, source.recall)


def ends_program(trajectory: Trajectory) -> bool:
    """Whether the program ends with this trajectory: it is no part, or the last one."""
    part = _part(trajectory)
    return part is None or part.is_last


def begins_program(trajectory: Trajectory) -> bool:
    """Whether the program begins with this trajectory."""
    part = _part(trajectory)
    return part is None or (part.begin_s == 0 and not (part.own or (0, 0))[0])


def _part(trajectory: Trajectory) -> Part | None:
    """The part of a program that this trajectory is, if it is one."""
    inner = trajectory.undisturbed if isinstance(trajectory, RetimablePlan) else trajectory
    return inner if isinstance(inner, Part) else None
