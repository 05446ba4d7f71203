"""From a trace to pins: where all motors stood after every pulse, and at every servo tick."""

from __future__ import annotations

from collections.abc import Sequence
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
    from sim.pulses_kernel import laid_out, positions

    time_ns, run = laid_out(runs.first_ns, runs.period_ns, runs.count)
    order = np.argsort(time_ns, kind="stable")
    run = run[order]
    motor = runs.axis[run]
    return Pulses(time_ns[order], motor, positions(motor, runs.direction[run], runs.start_steps))


@dataclass(frozen=True, slots=True, eq=False)
class ServoTrack:
    """Samples of one servo: motor index, time_ns i8[S] ascending, position f8[S] in counts (command or shaft)."""

    motor: int
    time_ns: npt.NDArray[np.int64]
    position: F8


@dataclass(frozen=True, slots=True, eq=False)
class Pins:
    """Where the motors stood: time_ns f8[K] ascending, position f8[K, M] in steps or counts.

    straight: columns of motors that move straight from one place to the next; the others jump.
    """

    time_ns: F8
    position: F8
    straight: tuple[int, ...] = ()


def pins(runs: StepRuns, servos: Sequence[ServoTrack] = ()) -> Pins:
    """Steppers after every pulse; servos at every sample, straight in between; all motors at all of these instants."""
    steps = pulses(runs)
    if not servos:
        return Pins(steps.time_ns, steps.position_steps.astype(np.float64))
    time_ns = np.unique(np.concatenate([steps.time_ns, *(track.time_ns for track in servos)]))
    position = np.empty((len(time_ns), len(runs.start_steps)))
    if len(steps.time_ns):
        after = np.searchsorted(steps.time_ns, time_ns, side="right") - 1
        position[:] = np.where(after[:, None] >= 0, steps.position_steps[np.maximum(after, 0)], runs.start_steps)
    else:
        position[:] = runs.start_steps
    for track in servos:
        position[:, track.motor] = np.interp(time_ns, track.time_ns, track.position)
    return Pins(time_ns, position, tuple(track.motor for track in servos))
