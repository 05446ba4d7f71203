"""Chips that take a new count at once, not at the roll-over as the host believes: how soon does the stream stop?

    PYTHONPATH=. python benchmarks/guardian.py [--seeds 100] [--feed 20]

Prints, over the seeds of a random path, the time from the first step to the moment at which every motor has answered
that it stands, and how far from the planned path the axes stand then.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np

from benchmarks.paths import random_path
from benchmarks.rig import Conditions, bring_up
from nmc.budget import BusTiming
from nmc.executor import play, stop_all
from planner.motors import StepMotor
from planner.stream import lead_in_ns, make_source
from planner.stream_error import StreamError


@dataclass(frozen=True)
class Reaction:
    """One seed: found out or not, ms from the first step to rest, steps off the path."""

    found: bool
    moved_ms: float
    off_path_steps: float


def react(seed: int, feed_mm_s: float) -> Reaction:
    """Stream a random path to chips that do not do what the twins do."""
    path = random_path(seed, feed_mm_s, duration_s=3.0)
    simulation, bus, motors = bring_up(path.axes, Conditions(seed=seed, count_latch="immediate"))
    timing = BusTiming.at(115200)
    start_ns = bus.link.now_ns() + lead_in_ns(motors, timing)
    source = make_source(path, motors, timing=timing, start_ns=start_ns, profile="adaptive")
    found = False
    try:
        for _ in play(bus, source):
            pass
    except StreamError:
        found = True
    stop_all(bus)
    stopped_ns = bus.link.now_ns()
    trace = simulation.trace()
    first_ns = int(trace.run_first_ns.min())
    scale = np.array([motor.steps_per_unit for motor in motors if isinstance(motor, StepMotor)])
    names = [motor.name for motor in motors]
    stood = np.array([simulation.steppers()[name].position for name in names])
    planned = path.q(np.arange(0.0, (stopped_ns - start_ns) * 1e-9, 1e-4)) * scale
    off = float(np.linalg.norm(planned - stood, axis=1).min())
    return Reaction(found, (stopped_ns - first_ns) / 1e6, off)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--feed", type=float, default=20.0)
    options = parser.parse_args()
    all_of_them = [react(seed, options.feed) for seed in range(options.seeds)]
    moved = np.array([each.moved_ms for each in all_of_them])
    off = np.array([each.off_path_steps for each in all_of_them])
    good = sum(each.found and each.moved_ms <= 100 and each.off_path_steps <= 5 for each in all_of_them)
    print(f"stopped within 100 ms and 5 steps: {good} of {options.seeds}")
    print(f"ms from the first step: median {np.median(moved):.1f}, most {moved.max():.1f}")
    print(f"steps off the path: median {np.median(off):.2f}, most {off.max():.2f}")


if __name__ == "__main__":
    main()
