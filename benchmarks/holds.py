"""Hold, resume and override on a running stream, at random instants of each job.

    PYTHONPATH=. python -m benchmarks.holds [--instants 50] [--only "jitter 0"]

Prints the worst contour error in steps of a whole run with one hold and of one with a sweep of overrides, and how long
after the announced rest the last step comes. Ends, violations and lost steps must be nought.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from benchmarks.paths import ClosedForm, Warped, circle, line, random_path, rounded_square
from benchmarks.rig import Conditions, Outcome, stream

JOBS: dict[str, tuple[Callable[[int], ClosedForm], float]] = {
    "line 20": (lambda _seed: line((60.0, 20.0, 5.0), 20.0), 20.0),
    "circle 50 mm, 20": (lambda _seed: circle(25.0, 20.0), 20.0),
    "circle 50 mm, 60": (lambda _seed: circle(25.0, 60.0), 60.0),
    "circle r2, 20": (lambda _seed: circle(2.0, 20.0), 20.0),
    "square r1, 40": (lambda _seed: rounded_square(20.0, 1.0, 40.0), 40.0),
    "random 20": (lambda seed: random_path(seed % 10, 20.0, duration_s=4.0), 20.0),
    "random 60": (lambda seed: random_path(seed % 10, 60.0, duration_s=4.0), 60.0),
}
SWEEP = (0.5, 1.0, 0.2, 0.8)


def one(job: str, jitter_ms: float, seed: int, sweep: bool) -> Outcome:
    """One run with one hold, or with four overrides, at random instants."""
    make, feed = JOBS[job]
    base = make(seed)
    dice = np.random.default_rng(seed)
    path, conditions = Warped(base, feed), Conditions(jitter_ms, seed=100 + seed)
    if sweep:
        times = np.sort(dice.uniform(0.1, base.duration_s, len(SWEEP)))
        return stream(path, conditions, "adaptive", (), list(zip(times.tolist(), SWEEP, strict=True)))
    return stream(path, conditions, "adaptive", [float(dice.uniform(0.1, base.duration_s - 0.1))])


def row(job: str, jitter_ms: float, sweep: bool, instants: int) -> str:
    """One line of the table."""
    outcomes = [one(job, jitter_ms, seed, sweep) for seed in range(instants)]
    worst = np.array([o.contour.contour_steps.max for o in outcomes])
    ends = sum(abs(n) for o in outcomes for n in o.contour.end_error_steps.values())
    broken = sum(sum(o.violations.values()) for o in outcomes)
    what = "overrides" if sweep else "hold"
    median, most = np.quantile(worst, (0.5, 0.9))
    spread = f"median {median:5.2f}  p90 {most:5.2f}  max {worst.max():5.2f} steps"
    return f"{what:9s} {job:17s} jitter {jitter_ms:3.1f}   {spread}   ends {ends}  broken rules {broken}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=50)
    parser.add_argument("--only", default="", help="only rows that contain this")
    options = parser.parse_args()
    for jitter_ms in (0.0, 2.0):
        for job in JOBS:
            for sweep in (False, True):
                if options.only in f"{'overrides' if sweep else 'hold'} {job} jitter {jitter_ms:.0f}":
                    print(row(job, jitter_ms, sweep, options.instants), flush=True)


if __name__ == "__main__":
    main()
