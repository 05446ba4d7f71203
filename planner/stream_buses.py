"""One trajectory for the motors of several buses: a stream a bus, all on one plan clock, timed anew together.

              t = 0 of the plan, the same link time for all
                |
    bus 0  ....[S]--[X]-[Y]--[X]---[Y]-...        each bus says what its own axes need, when they need it
    bus 1  ....[S]----[Z]------[Z]-----...
                          ^ hold: what is on its way on any bus counts as sent; after that, new times for all

The streams share nothing but the trajectory and its clock, so the buses are as far apart as each is from the plan.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from nmc.budget import BusTiming
from nmc.program import Evidence, Exchange
from planner.motors import Motor
from planner.quantize import NS_PER_S
from planner.stream import SENT_NS, Profile, Progress, StreamCounts, StreamSource, lead_in_ns, make_source
from planner.stream_axis import LOAD_POSITION, LOAD_TRAJECTORY, START_NOW
from planner.stream_base import NO_OPERATION, START_MOTION
from planner.stream_strain import Off
from planner.timing import Rate
from planner.types import Trajectory, nobody_asks

LONGEST_WAIT_NS = 20_000_000
"""An exchange that is due later than twice this is kept back; its bus is asked meanwhile how it is."""
TOGETHER_NS = 20_000_000
"""Departures of two buses that are wanted within this time of each other begin one motion."""


@dataclass(frozen=True, slots=True)
class StartSkew:
    """How far apart steppers of several buses set out that were to set out together, all of each bus from rest.

    motions: how many there were. worst_ns: the largest difference of lateness, by when their bytes were handed over.
    """

    motions: int
    worst_ns: int


class BusLane:
    """The ``nmc.program.ExchangeSource`` of one bus: its stream, with what is due late kept back here.

    So nothing that was decided long ago stands in the way when the times change.
    """

    def __init__(self, source: StreamSource, motor: Motor) -> None:
        self.source = source
        self.finished = False
        self.departures: list[tuple[int, int]] = []
        """When the resting steppers of this bus were to begin to move, and how late they were told to."""
        self._poll = Exchange(motor.address, NO_OPERATION, bus=motor.bus)
        self._kept: Exchange | None = None
        self._recalled = False
        self._out: Exchange | None = None
        self._now_ns = 0

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        """The stream's next exchange, or a No Operation while that is still far off."""
        self._now_ns = now_ns
        if evidence is not None:
            self._note(evidence)
        exchange = self._kept
        if exchange is not None and self._recalled:
            evidence, exchange = Evidence(exchange, now_ns, now_ns, None, sent=False), None
        self._recalled = False
        if exchange is None:
            exchange = self.source.next(now_ns, evidence)
        if exchange is None:
            self.finished = True
            self._kept = self._out = None
            return None
        late = exchange.send_at_ns - now_ns > 2 * LONGEST_WAIT_NS
        self._kept = exchange if late else None
        self._out = self._asked(now_ns, exchange.line) if late else exchange
        return self._out

    def _asked(self, now_ns: int, line: int) -> Exchange:
        poll = self._poll
        return Exchange(poll.address, poll.command, send_at_ns=now_ns + LONGEST_WAIT_NS, line=line, bus=poll.bus)

    def _note(self, evidence: Evidence) -> None:
        exchange = evidence.exchange
        if evidence.sent and exchange.send_at_ns and self.source.steppers_rest and _departs(exchange):
            self.departures.append((exchange.send_at_ns, evidence.sent_ns - exchange.send_at_ns))

    def recall(self) -> None:
        """A group Start that is kept back must not leave any more: the times have changed."""
        self._recalled = self._kept is not None and self._kept.command == START_MOTION

    def sent_ns(self) -> int:
        """Up to here everything that this bus will do has been said: it looks at new times after what it says now."""
        said_ns = 0 if self._out is None else self._out.send_at_ns
        return max(self._now_ns, said_ns) + SENT_NS


def _departs(exchange: Exchange) -> bool:
    """Whether an exchange lets resting steppers set out: a group Start, or a stop position started at once."""
    if exchange.command == LOAD_TRAJECTORY and exchange.data:
        return exchange.data[0] & (LOAD_POSITION | START_NOW) == LOAD_POSITION | START_NOW
    return exchange.command == START_MOTION


class BusStreams:
    """The streams of several buses as one: what there is to be known of them, and rate control for all at once.

    ``lanes``: by number of the bus, for ``nmc.executor.play_together``.
    """

    def __init__(self, trajectory: Trajectory, lanes: Mapping[int, BusLane], start_ns: int) -> None:
        self.trajectory = trajectory
        self.plan_start_ns = start_ns
        self.lanes = dict(lanes)

    @property
    def streams(self) -> list[StreamSource]:
        """The streams of the buses, in the order of their numbers."""
        return [lane.source for lane in self.lanes.values()]

    def hold(self) -> float:
        """Come to rest along the path on every bus; returns the time of the rest in s of the plan.

        Raises ValueError for a trajectory that cannot be timed anew, or a profile that cannot hold.
        """
        controls = [stream.rate_control() for stream in self.streams]
        rest_s = controls[0][1].hold(self._sent_s()).time_s
        rest_ns = self.plan_start_ns + round(rest_s * NS_PER_S)
        for schedule, _ in controls:
            schedule.retime(self.trajectory, rest_ns)
        self.recall()
        return rest_s

    def resume(self) -> None:
        """Go on after a hold, from where the axes were read to be."""
        controls = [stream.rate_control() for stream in self.streams]
        departure_ns = max(schedule.departure_ns() for schedule, _ in controls)
        controls[0][1].resume(self._sent_s() + departure_ns / NS_PER_S)
        for schedule, _ in controls:
            schedule.retime(self.trajectory, None)
        self.recall()

    def override(self, rate: Rate) -> None:
        """Feed and rapid override of everything that has not been sent; while held it counts from the resume on.

        Raises ValueError as ``hold`` does, PlanError for a rate outside its range.
        """
        controls = [stream.rate_control() for stream in self.streams]
        controls[0][1].override(self._sent_s(), rate)
        if not self.held:
            for schedule, _ in controls:
                schedule.retime(self.trajectory, None)
            self.recall()

    def assume(self, jitter_max_ns: int) -> None:
        """From now on the host is believed to need up to this long before the first byte of a packet, on any bus."""
        for stream in self.streams:
            stream.assume(jitter_max_ns)

    def offs(self) -> list[Off]:
        """How far behind its plan each motor is believed to be."""
        return [off for stream in self.streams for off in stream.offs()]

    def recall(self) -> None:
        """Take back what waits to be sent and was decided for times that hold no more."""
        for lane in self.lanes.values():
            lane.recall()

    def _sent_s(self) -> float:
        return (max(lane.sent_ns() for lane in self.lanes.values()) - self.plan_start_ns) / NS_PER_S

    @property
    def held(self) -> bool:
        """A hold has been asked for and not been resumed from."""
        return any(stream.held for stream in self.streams)

    @property
    def holding(self) -> bool:
        """A hold is on and every axis has come to rest and been read; a bus that is done rests anyway."""
        return self.held and all(lane.finished or lane.source.holding for lane in self.lanes.values())

    def progress(self) -> Progress:
        """Where the plan stands at the last exchange of any bus."""
        return max((stream.progress() for stream in self.streams), key=lambda each: each.time_s)

    def counts(self) -> StreamCounts:
        """Slices and late slices of all buses, and the longest of their mean slices."""
        found = [stream.counts() for stream in self.streams]
        return StreamCounts(
            sum(each.slices for each in found),
            sum(each.late_slices for each in found),
            max(each.slice_ms for each in found),
        )

    def start_skew(self) -> StartSkew:
        """What is known so far of motions that began on several buses together."""
        told = sorted((at_ns, late_ns, bus) for bus, lane in self.lanes.items() for at_ns, late_ns in lane.departures)
        motions, worst_ns = 0, 0
        while told:
            first_ns = told[0][0]
            mates = [each for each in told if each[0] - first_ns <= TOGETHER_NS]
            del told[: len(mates)]
            if len({bus for _, _, bus in mates}) > 1:
                motions += 1
                late = [late_ns for _, late_ns, _ in mates]
                worst_ns = max(worst_ns, max(late) - min(late))
        return StartSkew(motions, worst_ns)


def buses_of(motors: Sequence[Motor]) -> dict[int, list[Motor]]:
    """The motors of each bus, by its number in ascending order."""
    return {bus: [motor for motor in motors if motor.bus == bus] for bus in sorted({motor.bus for motor in motors})}


def lead_in_of_buses_ns(motors: Sequence[Motor], timings: Mapping[int, BusTiming]) -> int:
    """Time between the first exchanges and t = 0 of the plan: what the slowest of the buses needs."""
    return max(lead_in_ns(mine, timings[bus]) for bus, mine in buses_of(motors).items())


def make_sources(
    trajectory: Trajectory,
    motors: Sequence[Motor],
    *,
    timings: Mapping[int, BusTiming],
    start_ns: int,
    profiles: Mapping[int, Profile],
    alive: Callable[[], None] = nobody_asks,
) -> BusStreams:
    """Streams of ``trajectory`` for the motors of several buses; timings and profiles by bus, and alive, as of
    ``make_source``.

    Leave ``lead_in_of_buses_ns`` before ``start_ns``. Raises what ``make_source`` raises.
    """
    lanes = {}
    for bus, mine in buses_of(motors).items():
        source = make_source(
            trajectory, mine, timing=timings[bus], start_ns=start_ns, profile=profiles[bus], alive=alive
        )
        lanes[bus] = BusLane(source, mine[0])
    return BusStreams(trajectory, lanes, start_ns)
