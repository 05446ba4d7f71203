"""How near the pins come to the path: every profile, every job, quiet and with a host that hesitates.

    PYTHONPATH=. python benchmarks/streaming.py [--seeds 20] [--processes 2] [--only adaptive] [--calibrated 10]

Prints contour errors in steps (steppers) or um (servos), worst over the seeds; ends, violations and bus share beside.
The floor is the ideal stepping of the same path: every step on its rounding instant. Planned and programmed
path are the same for these closed forms; jobs a to f, planned from G-code on mill3-step at its limits, show both.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.paths import ClosedForm, circle, helix, line, random_path, rounded_square
from benchmarks.pwm import all_of
from benchmarks.rig import Conditions, Outcome, stream
from benchmarks.rig_buses import SharedOutcome, stream_buses
from benchmarks.servo_floor import pwm_floor
from benchmarks.streaming_jobs import names
from benchmarks.streaming_jobs import row as job_row
from planner.motors import StepMotor
from planner.quantize import speed_mode_for
from planner.steptrain import StepTrain
from sim.compare import Contour, Reference, compare_pins
from sim.pulses import Pins

NAMED: dict[str, Callable[[], ClosedForm]] = {
    "line 20": lambda: line((60.0, 20.0, 5.0), 20.0),
    "circle 50 mm, 20": lambda: circle(25.0, 20.0),
    "circle 50 mm, 60": lambda: circle(25.0, 60.0),
    "circle r2, 20": lambda: circle(2.0, 20.0),
    "helix r2, 20": lambda: helix(2.0, 2.0, 5.0, 20.0),
    "square r1, 40": lambda: rounded_square(20.0, 1.0, 40.0),
}
JITTER_MS = (0.0, 0.2, 2.0)
SERVOS = Conditions(servos=("X", "Y", "Z"))


@dataclass(frozen=True)
class Case:
    """One row of the table before it is run."""

    label: str
    profile: str
    path: str
    seeds: int
    conditions: Conditions
    buses: tuple[str, ...] = ()
    """Axes of each bus, where there are several."""


def trajectory(path: str, seed: int) -> ClosedForm:
    """A named path, or ``random FEED AXES``."""
    if path in NAMED:
        return NAMED[path]()
    _, feed, axes = path.split()
    return random_path(seed, float(feed), int(axes))


def cases(seeds: int) -> Iterator[Case]:
    """Everything that the table shows, in its order."""
    for profile in ("group", "adaptive", "exact"):
        for jitter in JITTER_MS:
            for path in NAMED:
                yield Case(f"{path}, jitter {jitter}", profile, path, 1, Conditions(jitter))
            for feed in (20, 60):
                label = f"random {feed} mm/s, jitter {jitter}"
                yield Case(label, profile, f"random {feed} 3", seeds, Conditions(jitter))
    for axes in (2, 4, 6):
        yield Case(f"random 20 mm/s, {axes} axes", "adaptive", f"random 20 {axes}", seeds, Conditions())
    yield from bus_cases(min(seeds, 6))
    for profile in ("smooth", "stop-here"):
        for jitter in (0.0, 2.0):
            for path in ("circle 50 mm, 20", "circle r2, 20", "random 20 3"):
                servos = Conditions(jitter, servos=("X", "Y", "Z"))
                yield Case(f"{path}, servos, jitter {jitter}", profile, path, seeds, servos)
    for jitter in (0.0, 2.0):
        mixed = Conditions(jitter, servos=("X", "Y"))
        for profile, path in (("smooth", "helix r2, 20"), ("smooth", "random 20 3"), ("stop-here", "helix r2, 20")):
            yield Case(f"mixed {path}: X Y servos, Z stepper, jitter {jitter}", profile, path, seeds, mixed)


def bus_cases(seeds: int) -> Iterator[Case]:
    """The same axes on one bus and on several."""
    for axes, buses in ((3, ("XY", "Z")), (6, ("XYZ", "ABC")), (8, ("XYZA", "BCUV"))):
        for jitter in JITTER_MS:
            path, conditions = f"random 20 {axes}", Conditions(jitter)
            yield Case(f"buses 1: {axes} axes, jitter {jitter}", "adaptive", path, seeds, conditions)
            label = f"buses 2: {'+'.join(buses)}, jitter {jitter}"
            yield Case(label, "adaptive", path, seeds, conditions, buses)
    for jitter in (0.0, 2.0):
        mixed = Conditions(jitter, servos=("X", "Y"))
        yield Case(
            f"buses 2: X Y servos + Z stepper, jitter {jitter}", "smooth", "random 20 3", seeds, mixed, ("XY", "Z")
        )


def run_one(job: tuple[Case, int]) -> Outcome:
    """One seed of a case."""
    case, seed = job
    conditions = Conditions(**{**case.conditions.__dict__, "seed": 100 + seed})
    path = trajectory(case.path, seed)
    if case.buses:
        return stream_buses(path, case.buses, conditions, case.profile)  # type: ignore[arg-type]
    return stream(path, conditions, case.profile)  # type: ignore[arg-type]


def floor(path: ClosedForm, steps_per_mm: float = 200.0) -> Contour:
    """Contour error of the ideal stepping of a path."""
    mode = speed_mode_for(60.0 * steps_per_mm)
    times, motors = [], []
    start = np.zeros(len(path.axes))
    for column, name in enumerate(path.axes):
        train = StepTrain(path, StepMotor(name, name, 0, column + 1, steps_per_mm, mode))
        start[column] = train.start_steps
        while train.peek() is not None:
            leg = train.pop()
            times.append(leg.times_ns)
            motors.append(np.full(len(leg), (column + 1) * leg.direction))
    time_ns, motor = np.concatenate(times), np.concatenate(motors)
    order = np.argsort(time_ns, kind="stable")
    moves = np.zeros((len(order), len(path.axes)))
    moves[np.arange(len(order)), np.abs(motor[order]) - 1] = np.sign(motor[order])
    out = Pins(time_ns[order].astype(float), np.cumsum(moves, axis=0) + start)
    t = np.append(np.arange(0.0, path.duration_s, 1e-3), path.duration_s)
    scale = np.full(len(path.axes), steps_per_mm)
    return compare_pins(Reference(path.axes, t, path.q(t), path.line(t)), out, path.axes, path.axes, scale, 0)


def report(case: Case, outcomes: list[Outcome]) -> str:
    """One line of the table."""
    ends = sum(abs(n) for o in outcomes for n in o.contour.end_error_steps.values())
    violations = sum(sum(o.violations.values()) for o in outcomes)
    bus = np.mean([o.bus_share for o in outcomes])
    if case.conditions.servos:  # PWM: the worst axis; with its direction the worst run and the worst axis
        command = [o.contour.contour_um for o in outcomes]
        shaft = max(o.shaft.contour_um.max for o in outcomes)
        every = [change for o in outcomes for change in o.pwm_changes]
        runs = [all_of(o.pwm_changes) for o in outcomes]
        figures = (
            f"{max(c.max for c in command):6.1f} {max(c.p999 for c in command):6.1f} um command {shaft:6.1f} shaft"
            f" PWM {max(c.value for c in every):4.1f}, signed {max(r.signed for r in runs):4.1f}"
            f" {max(c.signed for c in every):4.1f}"
        )
    else:
        spreads = [o.contour.contour_steps for o in outcomes]
        worst = [max(getattr(s, field) for s in spreads) for field in ("max", "p999", "rms")]
        median = np.median([s.max for s in spreads])
        figures = f"{median:6.2f} {worst[0]:6.2f} {worst[1]:6.2f} {worst[2]:5.2f} steps"
    if isinstance(outcomes[0], SharedOutcome):
        shared = [o for o in outcomes if isinstance(o, SharedOutcome)]
        figures += f" both busy {np.mean([o.overlap for o in shared]):.0%}"
    return f"{case.profile:9s} {case.label:46s} {figures:42s} ends {ends} broken rules {violations} bus {bus:4.0%}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--only", default="", help="only rows whose profile or label contains this")
    parser.add_argument("--calibrated", type=float, metavar="PPM", help="every crystal is known to +/- PPM (calibrate)")
    options = parser.parse_args()
    print("floor, ideal stepping: max p99.9 rms, steps")
    for path in (*NAMED, "random 20 3", "random 60 3"):
        spread = floor(trajectory(path, 0)).contour_steps
        print(f"  {path:20s} {spread.max:5.2f} {spread.p999:5.2f} {spread.rms:5.2f}")
    ideal = [pwm_floor(trajectory("random 20 3", seed), SERVOS) for seed in range(options.seeds)]
    told = [(max(c.value for c in run), all_of(run).signed, max(c.signed for c in run)) for run in ideal]
    value, run, axis = (max(column) for column in zip(*told, strict=True))
    print(f"  random 20 3, servos: change of PWM a tick, rms {value:.1f}, signed {run:.1f} a run, {axis:.1f} an axis")
    print("profile   job: median max, worst max, worst p99.9, worst rms")
    with ProcessPoolExecutor(options.processes) as pool:
        for case in cases(options.seeds):
            if options.only in case.profile or options.only in case.label:
                case = replace(case, conditions=replace(case.conditions, known_ppm=options.calibrated))
                jobs = [(case, seed) for seed in range(case.seeds)]
                print(report(case, list(pool.map(run_one, jobs))), flush=True)
        if options.calibrated is None:
            planned = [(p, n, j) for p in ("adaptive", "group") for j in JITTER_MS for n in names()]
            wanted = [job for job in planned if options.only in job[0] or options.only in "jobs a to f"]
            for line in pool.map(job_row, wanted):
                print(line, flush=True)


if __name__ == "__main__":
    main()
