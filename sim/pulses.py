"""From step runs to pins: every pulse of every motor in order of time, and where all motors stood after it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F8 = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StepRuns:
    """Step runs as in trace.npz: pulses of run r at first + k period, k = 0..count - 1; ``start_steps`` i8[A]."""

    axis: npt.NDArray[np.uint8]
    first_ns: npt.NDArray[np.int64]
    period_ns: F8
    count: npt.NDArray[np.int32]
    direction: npt.NDArray[np.int8]
    start_steps: npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Pulses:
    """All K pulses, ascending in time. time_ns f8[K], motor u1[K], position_steps i8[K, A] after each pulse."""

    time_ns: F8
    motor: npt.NDArray[np.uint8]
    position_steps: npt.NDArray[np.int64]


def pulses(runs: StepRuns) -> Pulses:
    """Lay out the runs pulse by pulse."""
    count = runs.count.astype(np.int64)
    run = np.repeat(np.arange(len(count)), count)
    k = np.arange(len(run)) - np.repeat(np.cumsum(count) - count, count)
    time_ns = runs.first_ns[run] + k * runs.period_ns[run]
    order = np.argsort(time_ns, kind="stable")
    run, time_ns = run[order], time_ns[order]
    motor = runs.axis[run]
    steps = np.zeros((len(run), len(runs.start_steps)), dtype=np.int64)
    steps[np.arange(len(run)), motor] = runs.direction[run]
    return Pulses(time_ns, motor, np.cumsum(steps, axis=0) + runs.start_steps)
