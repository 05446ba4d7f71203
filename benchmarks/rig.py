"""Streams a trajectory through driver and simulator, below the machine files: the bench of the streaming figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nmc.budget import BusTiming
from nmc.bus import Bus
from nmc.executor import play
from nmc.program import Exchange
from nmc.setup import ModuleExpectation, start_up
from planner.motors import StepMotor
from planner.quantize import speed_mode_for
from planner.stream import Profile, StreamCounts, make_source
from planner.types import Trajectory
from sim.build import Simulation, build
from sim.compare import Contour, Reference, compare
from sim.pulses import StepRuns
from sim.spec import BusSpec, StepModule

MODE_BITS = {8: 0, 4: 1, 2: 2, 1: 3}
"""Set Parameters, bits 1 and 0 (PIC-STEP data sheet, section 5.1)."""


@dataclass(frozen=True)
class Conditions:
    """What the host does not control. Jitter in ms before every packet, crystals in ppm, delays as the sheets leave them."""

    jitter_ms: float = 0.0
    crystal_ppm: float = 100.0
    start_delay_ms: float = 0.25
    seed: int = 1
    steps_per_mm: float = 200.0
    speed_max_mm_s: float = 60.0
    ppm_known: bool = False


@dataclass(frozen=True)
class Outcome:
    """Everything that the tables print of one run."""

    contour: Contour
    counts: StreamCounts
    violations: dict[str, int]
    bus_share: float
    packets: int


def bring_up(axes: Sequence[str], conditions: Conditions) -> tuple[Simulation, Bus, list[StepMotor]]:
    """A bus of one PIC-STEP an axis, started up, parameters set, amplifiers on."""
    modules = tuple(
        StepModule(
            name,
            crystal_ppm_max=conditions.crystal_ppm,
            start_delay_max_ns=round(conditions.start_delay_ms * 1e6),
        )
        for name in axes
    )
    jitter_ns = round(conditions.jitter_ms * 1e6)
    simulation = build([BusSpec("main", modules, host_jitter_max_ns=jitter_ns)], conditions.seed)
    bus = Bus(simulation.links[0])
    start_up(bus, [ModuleExpectation("pic-step", name=name) for name in axes])
    mode = speed_mode_for(conditions.speed_max_mm_s * conditions.steps_per_mm)
    motors = []
    for address, name in enumerate(axes, start=1):
        bus.exchange(Exchange(address, 0x6, bytes((MODE_BITS[mode], 1, 200, 50, 0))))
        bus.exchange(Exchange(address, 0x7, b"\x01"))
        motors.append(StepMotor(name, name, 0, address, conditions.steps_per_mm, mode))
    return simulation, bus, motors


def stream(trajectory: Trajectory, conditions: Conditions, profile: Profile = "group") -> Outcome:
    """Play the trajectory and compare the pins with it."""
    simulation, bus, motors = bring_up(trajectory.axes, conditions)
    link = bus.link
    timing = BusTiming.at(
        115200,
        jitter_max_ns=round(conditions.jitter_ms * 1e6),
        start_delay_max_ns=round(conditions.start_delay_ms * 1e6),
    )
    begin_ns, bytes_before = link.now_ns(), bus.counters.bytes_out + bus.counters.bytes_in
    start_ns = begin_ns + 50_000_000
    source = make_source(trajectory, motors, timing=timing, start_ns=start_ns, profile=profile)
    packets = sum(1 for _ in play(bus, source))
    end_ns = link.now_ns()
    bytes_used = bus.counters.bytes_out + bus.counters.bytes_in - bytes_before
    link.sleep_until(end_ns + 200_000_000)
    trace = simulation.trace()
    t = np.append(np.arange(0.0, trajectory.duration_s, 1e-3), trajectory.duration_s)
    runs = StepRuns(
        trace.run_axis, trace.run_first_ns, trace.run_period_ns, trace.run_count, trace.run_dir, trace.start_steps
    )
    scale = np.full(len(motors), conditions.steps_per_mm)
    reference = Reference(trajectory.axes, t, trajectory.q(t), trajectory.line(t))
    contour = compare(reference, runs, trajectory.axes, trajectory.axes, scale, start_ns)
    return Outcome(
        contour=contour,
        counts=source.counts(),
        violations=dict(Counter(v.rule for v in simulation.violations)),
        bus_share=bytes_used * timing.byte_ns / max(end_ns - begin_ns, 1),
        packets=packets,
    )
