"""The bench of the streaming figures for several buses: like ``benchmarks.rig``, one port a group of axes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from benchmarks.pwm import pwm_changes
from benchmarks.rig import Conditions, Outcome, contours, module_of, start_bus, timing_of
from nmc.bus import Bus
from nmc.executor import play_together
from planner.motors import Motor
from planner.stream import Profile
from planner.stream_buses import BusStreams, StartSkew, lead_in_of_buses_ns, make_sources
from planner.timing import Rate
from planner.types import Trajectory
from sim.build import Simulation, build
from sim.spec import BusSpec


@dataclass(frozen=True)
class SharedOutcome(Outcome):
    """An outcome whose ``bus_share`` is the mean of its buses; and how much of the time two of them were busy."""

    skew: StartSkew | None = None
    overlap: float = 0.0
    """Of the time in which a bus had a command in flight, the share in which another had one too."""


@dataclass
class Several:
    """Buses of one simulation, started up; motors in the order of the trace."""

    simulation: Simulation
    buses: list[Bus]
    motors: list[Motor] = field(default_factory=list)


def bring_up_buses(groups: Sequence[Sequence[str]], conditions: Conditions) -> Several:
    """A bus a group of axes."""
    jitter_ns = round(conditions.jitter_ms * 1e6)
    specs = [
        BusSpec(f"bus{number}", tuple(module_of(name, conditions) for name in names), jitter_ns)
        for number, names in enumerate(groups)
    ]
    found = Several(build(specs, conditions.seed), [])
    for number, names in enumerate(groups):
        bus, motors = start_bus(found.simulation.links[number], names, conditions, number)
        found.buses.append(bus)
        found.motors += motors
    return found


def stream_buses(
    trajectory: Trajectory,
    groups: Sequence[Sequence[str]],
    conditions: Conditions,
    profile: Profile = "adaptive",
    holds_s: Sequence[float] = (),
    overrides: Sequence[tuple[float, float]] = (),
) -> SharedOutcome:
    """Play the trajectory on several buses and compare what came out with it; arguments as of ``rig.stream``."""
    several = bring_up_buses(groups, conditions)
    buses, motors, timing = several.buses, several.motors, timing_of(conditions)
    link = buses[0].link
    begin_ns = link.now_ns()
    before = [bus.counters.bytes_out + bus.counters.bytes_in for bus in buses]
    numbers = range(len(buses))
    start_ns = begin_ns + lead_in_of_buses_ns(motors, dict.fromkeys(numbers, timing))
    streams = make_sources(
        trajectory,
        motors,
        timings=dict.fromkeys(numbers, timing),
        start_ns=start_ns,
        profiles=dict.fromkeys(numbers, profile),
    )
    busy = _play(buses, streams, list(holds_s), list(overrides))
    end_ns = link.now_ns()
    used = [bus.counters.bytes_out + bus.counters.bytes_in - n for bus, n in zip(buses, before, strict=True)]
    link.sleep_until(end_ns + 200_000_000)
    commanded, shaft = contours(several.simulation.trace(), trajectory, motors, start_ns)
    return SharedOutcome(
        contour=commanded,
        shaft=shaft,
        counts=streams.counts(),
        violations=dict(Counter(v.rule for v in several.simulation.violations)),
        bus_share=sum(used) / len(buses) * timing.byte_ns / max(end_ns - begin_ns, 1),
        packets=len(busy),
        pwm_changes=pwm_changes(several.simulation.trace(), conditions.gains, start_ns, trajectory.duration_s),
        skew=streams.start_skew(),
        overlap=_overlap(busy),
    )


def _play(
    buses: Sequence[Bus], streams: BusStreams, holds_s: list[float], rates: list[tuple[float, float]]
) -> list[tuple[int, int]]:
    """Play to the end; when each exchange had its bus."""
    busy = []
    for evidence in play_together(buses, streams.lanes):
        busy.append((evidence.sent_ns, evidence.replied_ns))
        now_s = (buses[0].link.now_ns() - streams.plan_start_ns) * 1e-9
        if streams.holding:
            streams.resume()
        elif holds_s and now_s > holds_s[0] and not streams.held:
            holds_s.pop(0)
            streams.hold()
        elif rates and now_s > rates[0][0] and not streams.held:
            streams.override(Rate(feed=rates.pop(0)[1]))
    return busy


def _overlap(busy: Sequence[tuple[int, int]]) -> float:
    """Share of the busy time in which two or more exchanges were under way."""
    changes = sorted([(begin, 1) for begin, _ in busy] + [(end, -1) for _, end in busy])
    once = twice = under_way = last_ns = 0
    for at_ns, change in changes:
        once += (at_ns - last_ns) * (under_way >= 1)
        twice += (at_ns - last_ns) * (under_way > 1)
        under_way, last_ns = under_way + change, at_ns
    return twice / max(once, 1)
