"""What came out of the pins against the plan, place by place: error, lag, the worst places, the path that was cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from machines.judge import reference_of, trace_pins
from machines.runner import RunResult
from machines.schema import MachineConfig
from machines.wiring import command_leads_ns, every_motor, scale_of
from planner.cy545 import Indexer
from planner.motors import Motor
from planner.types import F8, I4, Trajectory
from sim.lag import MOVING_UNITS_S, WINDOW_S
from sim.pulses import Pins
from sim.trace import Trace

WORST_PLACES, APART_S = 20, 0.25
SHIFT_STEPS = 0.75
CHUNK = 500_000


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """K places of the axes, each with the nearest planned place.

    t_s f8[K] of the plan; q f8[K, A] mm or degrees; planned f8[K, A] nearest to it; nearest_s f8[K] its time;
    error_um f8[K] distance of the two (shape); lag_ms f8[K] how late (0 where the plan rests).
    """

    axes: tuple[str, ...]
    t_s: F8
    q: F8
    planned: F8
    nearest_s: F8
    error_um: F8
    lag_ms: F8


@dataclass(frozen=True, slots=True)
class WorstPlace:
    """A place worth looking at. offset_um: by axis, where it was against where it should be; angles in mdeg."""

    time_s: float
    line: int
    error_um: float
    lag_ms: float
    offset_um: tuple[float, ...]


def steps_of(config: MachineConfig) -> dict[str, float]:
    """Length of a step or count of each axis, mm or degrees."""
    return {axis: 1 / abs(scale_of(motor)) for axis, motor in first_motors(config).items()}


def first_motors(config: MachineConfig) -> dict[str, Motor | Indexer]:
    """The motor that stands for each axis."""
    found: dict[str, Motor | Indexer] = {}
    for motor in every_motor(config):
        found.setdefault(motor.axis, motor)
    return found


def measured_pins(
    config: MachineConfig, result: RunResult, trajectory: Trajectory, *, shaft: bool = False
) -> Measured | None:
    """Measure a run on the twin. shaft: of servos where the shaft was, not where the chip wanted it."""
    trace, outcome = result.trace, result.outcome
    if trace is None or outcome is None:
        return None
    if shaft:
        out = trace_pins(trace, outcome.begins_at, trace.servo_position)
    else:
        out = trace_pins(trace, outcome.begins_at, trace.commanded, command_leads_ns(config))
    time_s, q = _of_axes(config, trace, out, tuple(trajectory.axes))
    return measure(trajectory, time_s, q)


def _of_axes(config: MachineConfig, trace: Trace, out: Pins, axes: tuple[str, ...]) -> tuple[F8, F8]:
    first = first_motors(config)
    columns = [trace.axes.index(first[axis].name) for axis in axes]
    scale = np.array([scale_of(first[axis]) for axis in axes])
    begun = out.time_ns >= trace.plan_start_ns
    return (out.time_ns[begun] - trace.plan_start_ns) * 1e-9, out.position[begun][:, columns] / scale


def measure(trajectory: Trajectory, time_s: F8, q: F8) -> Measured:
    """Measure places against a plan; the nearest place is looked for in a window of time, as the verdict does."""
    from sim.compare_kernel import distances

    reference = reference_of(trajectory)
    knots_s, knots = reference.t_s, np.ascontiguousarray(reference.q)
    first = np.maximum(np.searchsorted(knots_s, time_s - WINDOW_S) - 1, 0)
    last = np.minimum(np.searchsorted(knots_s, time_s + WINDOW_S) + 1, len(knots_s) - 1)
    first = np.minimum(first, last - 1)
    distance, nearest_s = distances(time_s, np.ascontiguousarray(q), first, last, knots_s, knots)
    planned = np.column_stack([np.interp(nearest_s, knots_s, knots[:, k]) for k in range(knots.shape[1])])
    lag_ms = np.where(_moving(knots_s, knots, time_s), (time_s - nearest_s) * 1e3, 0.0)
    return Measured(reference.axes, time_s, q, planned, nearest_s, distance * 1e3, lag_ms)


def _moving(knots_s: F8, knots: F8, time_s: F8) -> npt.NDArray[np.bool_]:
    speed = np.linalg.norm(np.diff(knots, axis=0), axis=1) / np.maximum(np.diff(knots_s), 1e-12)
    at = np.clip(np.searchsorted(knots_s, time_s) - 1, 0, len(speed) - 1)
    moving: npt.NDArray[np.bool_] = speed[at] > MOVING_UNITS_S
    return moving


def worst_places(m: Measured, trajectory: Trajectory, count: int = WORST_PLACES) -> list[WorstPlace]:
    """The largest errors, at least ``APART_S`` from each other, the largest first; equal ones in order of time."""
    found: list[WorstPlace] = []
    order = np.argsort(-m.error_um, kind="stable")
    taken = np.zeros(0)
    for k in order[: 200 * count].tolist():
        if len(found) == count:
            break
        if len(taken) and np.abs(taken - m.t_s[k]).min() < APART_S:
            continue
        taken = np.append(taken, m.t_s[k])
        offset = 1e3 * (m.q[k] - m.planned[k])
        found.append(WorstPlace(
            float(m.t_s[k]), int(trajectory.line(np.array([m.nearest_s[k]]))[0]), float(m.error_um[k]),
            float(m.lag_ms[k]), tuple(float(x) for x in offset),
        ))  # fmt: skip
    return found


@dataclass(frozen=True, slots=True)
class Shift:
    """From ``time_s`` on, in ``line``, an axis stands ``um`` (``steps``) from where it should: it lost its place."""

    axis: str
    time_s: float
    line: int
    um: float
    steps: float


def shifts(m: Measured, trajectory: Trajectory, units_per_step: dict[str, float]) -> list[Shift]:
    """Every axis that ends off its place, with the instant: where the mean distance from the plan changes most.

    The distance at equal times wanders around zero while an axis is in its place, and around the loss after it; the
    sum of what exceeds the overall mean turns round at the change (cumulative sums, E. S. Page 1954).
    """
    found = []
    wanted = trajectory.q(m.t_s)
    end = trajectory.q(np.array([trajectory.duration_s]))[0]
    for k, axis in enumerate(m.axes):
        off = m.q[:, k] - wanted[:, k]
        left = float(m.q[-1, k] - end[k]) if len(off) else 0.0
        if len(off) < 3 or abs(left) < SHIFT_STEPS * units_per_step[axis]:
            continue
        weight = np.gradient(m.t_s)
        sums = np.cumsum((off - np.average(off, weights=np.maximum(weight, 1e-12))) * weight)
        at = int(np.argmax(np.abs(sums[:-1])))
        before, after = float(np.median(off[: at + 1])), float(np.median(off[at + 1 :]))
        jump, step = after - before, units_per_step[axis]
        if abs(jump) < SHIFT_STEPS * step or jump * left < 0:
            continue
        time_s = float(m.t_s[at])
        line = int(trajectory.line(np.array([time_s]))[0])
        found.append(Shift(axis, time_s, line, 1e3 * jump, jump / step))
    return sorted(found, key=lambda s: s.time_s)


def worst_by_line(m: Measured, trajectory: Trajectory) -> tuple[I4, F8]:
    """Lines that moved, ascending, and the largest error in each, um."""
    line = trajectory.line(m.nearest_s)
    lines, place = np.unique(line, return_inverse=True)
    worst = np.zeros(len(lines))
    np.maximum.at(worst, place, m.error_um)
    return lines.astype(np.int32), worst


def simulated_path(m: Measured, most: int) -> Measured:
    """Fewer places, enough to draw the path that came out: the farthest from the plan of each small stretch."""
    every = max(1, -(-len(m.t_s) // most))
    if every == 1 or not len(m.t_s):
        return m
    starts = np.arange(0, len(m.t_s), every)
    padded = np.append(m.error_um, np.full(-len(m.t_s) % every, -1.0)).reshape(-1, every)
    keep = np.unique(np.append(starts + np.argmax(padded, axis=1), [0, len(m.t_s) - 1]))
    return Measured(m.axes, m.t_s[keep], m.q[keep], m.planned[keep], m.nearest_s[keep], m.error_um[keep],
                    m.lag_ms[keep])  # fmt: skip


def envelope(t_s: F8, values: F8, end_s: float, bins: int) -> tuple[F8, F8]:
    """Middle and largest value of each of ``bins`` equal stretches of time that has any."""
    edges = np.linspace(0.0, max(end_s, 1e-9), bins + 1)
    index = np.clip(np.searchsorted(edges, t_s, side="right") - 1, 0, bins - 1)
    worst = np.full(bins, -np.inf)
    np.maximum.at(worst, index, values)
    some = worst > -np.inf
    return (0.5 * (edges[:-1] + edges[1:]))[some], worst[some]
