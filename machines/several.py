"""Motors on several buses: streams and governors for them, and how a run plays on one bus or on many."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping

from machines.bringup import Connection
from machines.crystals import calibrated
from machines.governor import Advice, Governor
from machines.outputs_hook import Planned, lanes_with_outputs, with_outputs
from machines.patience import PatientSource
from machines.profiles import choose_profile, profile_of_bus
from machines.schema import MachineConfig
from machines.wiring import bus_timing, motors, nmc_buses
from nmc.budget import BusTiming
from nmc.chips.common import NOP
from nmc.executor import play, play_together
from nmc.program import Evidence, Exchange
from planner.stream_buses import BusStreams, lead_in_of_buses_ns, make_sources
from planner.types import Trajectory


def moving_buses(config: MachineConfig) -> dict[int, str]:
    """Numbers and names of the buses that motors are on."""
    driven = {motor.bus for motor in motors(config)}
    return {number: name for number, name in enumerate(nmc_buses(config)) if number in driven}


def timings_of(connection: Connection) -> dict[int, BusTiming]:
    """What a stream assumes of each bus that motors are on."""
    simulated = connection.simulation is not None
    return {number: bus_timing(connection.config, number, simulated) for number in moving_buses(connection.config)}


def bus_streams(connection: Connection, trajectory: Trajectory, profile: str, note: Callable[..., None]) -> BusStreams:
    """A stream a bus, beginning when the slowest of them is ready. Raises ValueError for a profile not offered."""
    config, simulated = connection.config, connection.simulation is not None
    chosen = choose_profile(config, profile, simulated)
    now_ns, timings = connection.links[0].now_ns(), timings_of(connection)
    profiles = {bus: profile_of_bus(config, bus, chosen, simulated) for bus in timings}
    for bus, name in moving_buses(config).items():
        note("profile", now_ns, profile=profiles[bus], bus=name)
    driven = calibrated(config, connection.place)
    start_ns = now_ns + lead_in_of_buses_ns(driven, timings)
    return make_sources(
        trajectory, driven, timings=timings, start_ns=start_ns, profiles=profiles, alive=connection.alive
    )


def played(
    source: Planned | BusStreams, connection: Connection
) -> tuple[Generator[Evidence, None, None], Callable[[], None]]:
    """The evidence of a run as it comes, on one bus or on all; and what takes back a Start that waits to be sent.

    Close the iterator before the motors are stopped: until then commands may be in flight.
    """
    polls = {bus: Exchange(1, NOP, bus=bus) for bus in range(len(connection.buses))}
    if isinstance(source, BusStreams):
        lanes, recall = lanes_with_outputs(source, connection.rig, polls)
        return play_together(connection.buses, lanes), recall
    first = motors(connection.config)[0]
    patient = PatientSource(source, first.address)
    wrapped = with_outputs(patient, connection.rig, source, polls[first.bus])

    def recall_both() -> None:
        patient.recall()
        wrapped.recall()

    return play(connection.buses, wrapped.source), recall_both


class BusGovernors(Governor):
    """A governor a bus, and one advice for all: the longest host delay, the speed of the slowest bus."""

    def __init__(self, timings: Mapping[int, BusTiming]) -> None:
        super().__init__(max(timings.values(), key=lambda timing: timing.jitter_max_ns))
        self._each = {bus: Governor(timing) for bus, timing in timings.items()}
        for governor in self._each.values():
            governor.delays = self.delays

    def observe(self, evidence: Evidence) -> Advice | None:
        """Look at an exchange of any bus; advice only when something is to change."""
        governor = self._each.get(evidence.exchange.bus)  # of a bus with outputs alone there is none
        if governor is None or governor.observe(evidence) is None:
            return None
        self.share = min(each.share for each in self._each.values())
        jitter_ns = max(each.timing.jitter_max_ns + each.excess_ns for each in self._each.values())
        return Advice(jitter_ns, self.share)


def governor_of(connection: Connection) -> Governor:
    """Who watches the hosts' delays: one governor, or one a bus."""
    timings = timings_of(connection)
    return BusGovernors(timings) if len(timings) > 1 else Governor(next(iter(timings.values())))


def tell_starts(source: object, note: Callable[..., None], time_ns: int) -> None:
    """Tell the journal how far apart the buses set out, if there are several."""
    if isinstance(source, BusStreams):
        skew = source.start_skew()
        note("bus_starts", time_ns, motions=skew.motions, skew_ms=round(skew.worst_ns / 1e6, 3))
