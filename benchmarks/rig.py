"""Streams a trajectory through driver and simulator, below the machine files: the bench of the streaming figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from benchmarks.pwm import PwmChange, pwm_changes
from nmc.budget import BusTiming
from nmc.bus import Bus
from nmc.executor import play
from nmc.link import Link
from nmc.picservo import Gains, PicServo
from nmc.program import Exchange
from nmc.setup import ModuleExpectation, start_up
from planner.motors import Motor, ServoMotor, StepMotor
from planner.quantize import speed_mode_for
from planner.stream import Profile, StreamCounts, lead_in_ns, make_source
from planner.timing import Rate
from planner.types import Trajectory
from sim.build import Simulation, build
from sim.compare import Contour, Reference, compare_pins
from sim.pulses import F8, Pins, ServoTrack, StepRuns, pins
from sim.spec import BusSpec, CountLatch, ServoModule, ServoPlant, StepModule
from sim.trace import Trace

RESTS_NS = 100_000_000
"""A command that shows the same count for so long is taken to stand on it: slower than 0.025 mm/s at 400 counts/mm."""
MODE_BITS = {8: 0, 4: 1, 2: 2, 1: 3}
"""Set Parameters, bits 1 and 0 (PIC-STEP data sheet, section 5.1)."""


@dataclass(frozen=True)
class Conditions:
    """What the host does not control: jitter before every packet, crystals, delays where the sheets are silent."""

    jitter_ms: float = 0.0
    crystal_ppm: float = 100.0
    start_delay_ms: float = 0.25
    seed: int = 1
    steps_per_mm: float = 200.0
    speed_max_mm_s: float = 60.0
    count_latch: CountLatch = "rollover"
    servos: tuple[str, ...] = ()
    counts_per_mm: float = 400.0
    gains: tuple[int, int, int, int] = (400, 4800, 200, 4000)
    known_ppm: float | None = None
    """A calibration knows every crystal to plus or minus this, and is half of that off; None: nothing is known."""


@dataclass(frozen=True)
class Outcome:
    """Everything that the tables print of one run."""

    contour: Contour
    shaft: Contour
    counts: StreamCounts
    violations: dict[str, int]
    bus_share: float
    packets: int
    pwm_changes: tuple[PwmChange, ...] = ()
    """Of each servo while the plan runs."""


def module_of(name: str, conditions: Conditions) -> StepModule | ServoModule:
    """The simulated module of an axis."""
    if name in conditions.servos:
        return ServoModule(name, crystal_ppm_max=conditions.crystal_ppm, plant=ServoPlant(lines_per_rev=500))
    return StepModule(
        name,
        crystal_ppm_max=conditions.crystal_ppm,
        start_delay_max_ns=round(conditions.start_delay_ms * 1e6),
        count_latch=conditions.count_latch,
    )


def start_bus(link: Link, names: Sequence[str], conditions: Conditions, number: int = 0) -> tuple[Bus, list[Motor]]:
    """Bus ``number`` of a simulation, started up: parameters or gains set, amplifiers on."""
    bus = Bus(link, host_latency_ns=max(round(conditions.jitter_ms * 1e6), 1_000_000))
    chips = ["pic-servo" if name in conditions.servos else "pic-step" for name in names]
    start_up(bus, [ModuleExpectation(chip, name=name) for chip, name in zip(chips, names, strict=True)])
    mode = speed_mode_for(conditions.speed_max_mm_s * conditions.steps_per_mm)
    motors: list[Motor] = []
    for address, name in enumerate(names, start=1):
        if name in conditions.servos:
            PicServo(bus, address).set_gain(Gains(*conditions.gains, position_error_limit=4000))
            motors.append(ServoMotor(name, name, number, address, conditions.counts_per_mm))
            continue
        bus.exchange(Exchange(address, 0x6, bytes((MODE_BITS[mode], 1, 200, 50, 0))))
        bus.exchange(Exchange(address, 0x7, b"\x01"))
        motors.append(StepMotor(name, name, number, address, conditions.steps_per_mm, mode))
    return bus, motors


def bring_up(axes: Sequence[str], conditions: Conditions) -> tuple[Simulation, Bus, list[Motor]]:
    """One bus, one module an axis, started up, parameters or gains set, amplifiers on."""
    modules = tuple(module_of(name, conditions) for name in axes)
    simulation = build([BusSpec("main", modules, round(conditions.jitter_ms * 1e6))], conditions.seed)
    bus, motors = start_bus(simulation.links[0], axes, conditions)
    return simulation, bus, calibrated(motors, simulation, conditions.known_ppm)


def calibrated(motors: Sequence[Motor], simulation: Simulation, known_ppm: float | None) -> list[Motor]:
    """The motors with what a calibration to ``known_ppm`` tells of them; streams allow for 5 ppm of drift more."""
    if known_ppm is None:
        return list(motors)
    found: list[Motor] = []
    for number, motor in enumerate(motors):
        said_ppb = simulation.modules[motor.name].ppb + round((500 if number % 2 else -500) * known_ppm)
        known = replace(motor, crystal_fast_ppb=said_ppb)
        found.append(replace(known, crystal_ppm=round(known_ppm) + 5) if isinstance(known, StepMotor) else known)
    return found


def timing_of(conditions: Conditions) -> BusTiming:
    """What a stream may assume of a bus under these conditions."""
    return BusTiming.at(
        115200,
        jitter_max_ns=round(conditions.jitter_ms * 1e6),
        start_delay_max_ns=round(conditions.start_delay_ms * 1e6),
    )


def stream(
    trajectory: Trajectory,
    conditions: Conditions,
    profile: Profile = "group",
    holds_s: Sequence[float] = (),
    overrides: Sequence[tuple[float, float]] = (),
) -> Outcome:
    """Play the trajectory and compare what came out with it. holds_s: when (s of the plan) to hold and then resume.

    overrides: (s of the plan, feed override).
    """
    simulation, bus, motors = bring_up(trajectory.axes, conditions)
    link = bus.link
    timing = timing_of(conditions)
    begin_ns, bytes_before = link.now_ns(), bus.counters.bytes_out + bus.counters.bytes_in
    start_ns = begin_ns + lead_in_ns(motors, timing)
    source = make_source(trajectory, motors, timing=timing, start_ns=start_ns, profile=profile)
    packets = 0
    waiting, rates = list(holds_s), list(overrides)
    for _ in play(bus, source):
        packets += 1
        source.passed(link.now_ns())
        now_s = (link.now_ns() - start_ns) * 1e-9
        if source.holding:
            source.resume()
        elif waiting and now_s > waiting[0] and not source.held:
            waiting.pop(0)
            source.hold()
        elif rates and now_s > rates[0][0] and not source.held:
            source.override(Rate(feed=rates.pop(0)[1]))
    end_ns = link.now_ns()
    bytes_used = bus.counters.bytes_out + bus.counters.bytes_in - bytes_before
    link.sleep_until(end_ns + 200_000_000)
    commanded, shaft = contours(simulation.trace(), trajectory, motors, start_ns)
    return Outcome(
        contour=commanded,
        shaft=shaft,
        counts=source.counts(),
        violations=dict(Counter(v.rule for v in simulation.violations)),
        bus_share=bytes_used * timing.byte_ns / max(end_ns - begin_ns, 1),
        packets=packets,
        pwm_changes=pwm_changes(simulation.trace(), conditions.gains, start_ns, trajectory.duration_s),
    )


def contours(trace: Trace, trajectory: Trajectory, motors: Sequence[Motor], start_ns: int) -> tuple[Contour, Contour]:
    """What was commanded against the plan, and where the shafts were; motors in the order of the trace."""
    t = np.append(np.arange(0.0, trajectory.duration_s, 1e-3), trajectory.duration_s)
    reference = Reference(trajectory.axes, t, trajectory.q(t), trajectory.line(t))
    names = tuple(motor.axis for motor in motors)
    scale = np.array([m.steps_per_unit if isinstance(m, StepMotor) else m.counts_per_unit for m in motors])
    commanded, shaft = (
        compare_pins(reference, pins_of(trace, which), names, names, scale, start_ns)
        for which in (commands(trace), shafts(trace))
    )
    return commanded, shaft


def travelling(time_ns: npt.NDArray[np.int64], counts: npt.NDArray[np.int32]) -> npt.NDArray[np.bool_]:
    """Where a count stands for less than ``RESTS_NS`` between the change before it and the one after it."""
    changes = np.flatnonzero(np.diff(counts))
    if not len(changes):
        return np.zeros(len(counts), dtype=np.bool_)
    edges = np.concatenate(([-np.inf], time_ns[changes + 1], [np.inf]))
    number = np.searchsorted(changes, np.arange(len(counts)), side="left")
    brief: npt.NDArray[np.bool_] = edges[number + 1] - edges[number] < RESTS_NS
    return brief


def commands(trace: Trace) -> F8:
    """Command positions of the servo samples in counts, to the last of their 16 fractional bits; f8[S]."""
    return np.asarray(trace.commanded, dtype=np.float64)


def shafts(trace: Trace) -> F8:
    """Shaft positions of the servo samples in counts; f8[S].

    An encoder shows whole counts: while it is on its way from count to count the truth lies half a count above on
    average. A count that stands longer than ``RESTS_NS`` is taken as it is.
    """
    found = trace.servo_position.astype(np.float64)
    for motor in np.unique(trace.servo_axis):
        mine = trace.servo_axis == motor
        found[mine] += 0.5 * travelling(trace.servo_ns[mine], trace.servo_position[mine])
    return found


def pins_of(trace: Trace, servo_counts: F8 | None = None) -> Pins:
    """Pins of a trace with ``servo_counts`` (f8[S]), or the commands of its servos if nothing is given."""
    runs = StepRuns(
        trace.run_axis, trace.run_first_ns, trace.run_period_ns, trace.run_count, trace.run_dir, trace.start_steps
    )
    counts = commands(trace) if servo_counts is None else servo_counts
    tracks = []
    for motor in np.unique(trace.servo_axis):
        mine = trace.servo_axis == motor
        tracks.append(ServoTrack(int(motor), trace.servo_ns[mine], counts[mine]))
    return pins(runs, tracks)
