"""What a bus can follow: the estimate of ``machines/busload.py`` beside what comes out of the simulated pins.

    PYTHONPATH=. python -m benchmarks.busload [--only adaptive] [--seed 1] [--fitted]

Random straight lines of all axes at once, path tolerance 0.05 mm, as programmed: nothing is slowed for the bus. With
``--fitted`` beside it what comes out when it is, and how long both take. One row takes a second or two.
"""

from __future__ import annotations

import argparse
import random
from dataclasses import dataclass, replace

from gcode.setup import Setup
from machines.busload import overload
from machines.job import Job, plan_job, read_job
from machines.load import MachineFile, parse_machine
from machines.runner import RunOptions, perform
from planner.plan import Plan

AXES = "XYZABCUV"
SERVO = "kp = 220\nkd = 2640\nki = 150\nintegration_limit = 4000\n"
STEPPERS, SERVOS = ("group", "adaptive", "exact"), ("smooth", "stop-here")


@dataclass(frozen=True)
class Case:
    """Axes on one bus, its rate, acceleration of each axis in mm/s2, feed in mm/min, host delays in ms."""

    axes: int
    baud: int
    acceleration: float
    feed: float
    jitter_ms: float = 0.2


CASES = (
    Case(3, 115200, 500, 1200), Case(3, 115200, 2000, 3600), Case(4, 115200, 500, 1200), Case(6, 115200, 500, 1200),
    Case(8, 115200, 500, 1200), Case(8, 115200, 500, 300), Case(8, 115200, 100, 1200), Case(3, 115200, 500, 1200, 2.0),
    Case(3, 115200, 500, 1200, 5.0), Case(3, 57600, 500, 1200), Case(5, 57600, 500, 1200), Case(8, 57600, 500, 1200),
    Case(3, 19200, 500, 1200), Case(3, 19200, 50, 300), Case(4, 19200, 50, 300), Case(2, 9600, 50, 300),
    Case(3, 9600, 50, 300), Case(3, 9600, 500, 1200),
)  # fmt: skip


def machine(case: Case, chips: str) -> MachineFile:
    """A machine of PIC-STEPs (``step``), PIC-SERVOs (``servo``) or both in turn (``mixed``) on one bus."""
    text = f'[machine]\nname = "m"\n[bus.main]\nbaud = {case.baud}\n'
    for number, axis in enumerate(AXES[: case.axes]):
        servo = chips == "servo" or (chips == "mixed" and number % 2 == 1)
        chip = 'chip = "pic-servo"\ncounts_per_unit = 400' if servo else 'chip = "pic-step"\nsteps_per_unit = 200'
        text += f'[axis.{axis}]\n{chip}\nbus = "main"\naddress = {number + 1}\nmax_velocity = 60\n'
        text += f"max_acceleration = {case.acceleration}\ntravel = [-20, 115]\n"
        text += f"[axis.{axis}.servo]\n{SERVO}" if servo else ""
    text += f"[sim]\nhost_jitter_ms = {case.jitter_ms}\ncrystal_ppm = 100\nstart_delay_ms = 0.25\n"
    return MachineFile("m.toml", text, parse_machine(text, "m.toml"))


def program(case: Case, seed: int) -> str:
    """Twelve random lines of all axes at once, and a rapid back."""
    chance, names = random.Random(seed), AXES[: case.axes]
    lines = [f"G21 G90 G64 P0.05 F{case.feed}"]
    lines += ["G1 " + " ".join(f"{axis}{chance.uniform(0, 15):.3f}" for axis in names) for _ in range(12)]
    return "\n".join([*lines, "G0 " + " ".join(f"{axis}0" for axis in names), "M2", ""])


def simulated(described: MachineFile, job: Job, plan: Plan, options: RunOptions) -> str:
    """Contour error, max and p99.9, and the time it took."""
    result = perform(job, plan, described, options)
    if result.verdict is None or result.verdict.contour_steps is None:
        return result.fault
    spread = result.verdict.contour_steps
    return f"{spread.max:8.1f} {spread.p999:8.1f} {result.verdict.plan_time_s:6.1f} s"


def row(case: Case, profile: str, chips: str, seed: int, *, fitted: bool) -> str:
    """One line of the table."""
    described = machine(case, chips)
    job = read_job(program(case, seed), Setup(file="p.nc"), described.config)
    plan = plan_job(job, described.config)
    ask = described.config.model_copy(
        update={"verify": described.config.verify.model_copy(update={"contour_steps": 0})}
    )
    load = overload(ask, plan.trajectory, profile, simulated=True)
    assert load is not None
    options = RunOptions(port="sim", seed=seed, profile=profile, fit_bus=False)
    measured = simulated(described, job, plan, options)
    if fitted:
        measured += f"  fitted {simulated(described, job, plan, replace(options, fit_bus=True))}"
    what = f"{case.axes} axes {case.baud:6d} baud {case.acceleration:5.0f} mm/s2 F{case.feed:<5.0f} {case.jitter_ms} ms"
    estimate = f"turn {load.turn_ms:5.1f} ms  estimate {load.steps:8.1f}"
    return f"{profile:10s} {chips:6s} {what}  {estimate}  simulated {measured}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--only", default="", help="rows of this profile")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--fitted", action="store_true", help="slowed for the bus as well")
    options = parser.parse_args()
    groups = [(name, "step") for name in STEPPERS] + [(name, chips) for name in SERVOS for chips in ("servo", "mixed")]
    for profile, chips in groups:
        for case in CASES if options.only in ("", profile) else ():
            print(row(case, profile, chips, options.seed, fitted=options.fitted), flush=True)


if __name__ == "__main__":
    main()
