"""Step rates: what the plan wants of each stepper, and what its step timer gave out (its registers make steps)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from machines.schema import MachineConfig
from machines.wiring import every_motor
from planner.cy545 import Indexer
from planner.motors import StepMotor
from planner.types import F8, Trajectory
from sim.trace import Trace

REST_NS = 100_000_000
"""A pulse that comes this long after the one before says nothing of a rate: the motor stood."""
MOST_POINTS = 120_000


@dataclass(frozen=True, slots=True, eq=False)
class RateView:
    """One stepper. planned_s, planned: the plan's rate in steps/s, signed; emitted_s, emitted: steps in time."""

    name: str
    planned_s: F8
    planned: F8
    emitted_s: F8
    emitted: F8


def rate_views(config: MachineConfig, trace: Trace, trajectory: Trajectory, t_s: F8) -> list[RateView]:
    """Every stepper of a machine; ``t_s``: where to look at the plan."""
    v, found = trajectory.v(t_s), []
    for motor in every_motor(config):
        if not isinstance(motor, StepMotor | Indexer):
            continue
        wanted = v[:, trajectory.axes.index(motor.axis)] * motor.steps_per_unit
        emitted_s, emitted = emitted_rate(trace, motor.name)
        found.append(RateView(motor.name, t_s, wanted, emitted_s, emitted))
    return found


def emitted_rate(trace: Trace, motor: str) -> tuple[F8, F8]:
    """Rate in steps/s from each instant on, signed, 0 while the motor stands; of long runs every n-th change."""
    mine = trace.run_axis == trace.axes.index(motor)
    first, period = trace.run_first_ns[mine].astype(np.float64), trace.run_period_ns[mine]
    count, way = trace.run_count[mine].astype(np.float64), trace.run_dir[mine].astype(np.float64)
    if not len(first):
        return np.zeros(1), np.zeros(1)
    last = first + (count - 1) * period
    gap = np.append(first[1:] - last[:-1], np.inf)
    # a single pulse has no period of its own: the way to the next pulse tells the rate
    rate = np.where(count > 1, 1e9 / np.maximum(period, 1.0), np.where(gap < REST_NS, 1e9 / np.maximum(gap, 1.0), 0.0))
    stands = gap >= REST_NS
    times = np.concatenate([first, last[stands] + np.minimum(period[stands], REST_NS)])
    values = np.concatenate([rate * way, np.zeros(int(stands.sum()))])
    order = np.argsort(times, kind="stable")
    every = max(1, -(-len(order) // MOST_POINTS))
    order = order[::every]
    return (times[order] - trace.plan_start_ns) * 1e-9, values[order]
