"""How far off the path the host believes its axes to be: what shows, while a machine runs, that its bus is too slow.

An axis is *off* by its plan less where its twin is. What all axes are off along the path is lag, which leaves the path
alone; what is left across it is the strain.

            plan  *------> t                   e: off, f8[A] in steps and counts
                  |\\                           t: the way of the plan there
                e | \\  strain                  strain^2 = e.e - (e.t)^2
                  v  *
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from planner.quantize import NS_PER_S
from planner.stream_axis import StepAxis
from planner.stream_servo import ServoLane
from planner.types import Trajectory

HALF_STEP = 0.5


class Off(NamedTuple):
    """One axis: behind its plan by ``off`` steps or counts (signed), and ``rate``, the plan's, steps or counts a s."""

    off: float
    rate: float


def strain_steps(offs: Iterable[Off]) -> float:
    """The part across the path."""
    square = along = rates = 0.0
    for off, rate in offs:
        square += off * off
        along += off * rate
        rates += rate * rate
    return math.sqrt(max(square - along * along / rates, 0.0)) if rates else 0.0


def step_axis_at(axis: StepAxis, now_ns: int) -> tuple[float, float]:
    """Where the nominal chip is, in steps, and how far from there its plan may be without any step being due.

    A step is made where the plan is half a step before it: between two of them a chip in motion is half a step behind
    the straight line through its counter.
    """
    leg, timer = axis.leg, axis.twin.nominal
    if leg is None:
        return float(axis.position_steps), HALF_STEP
    next_ns, left = timer.ahead(now_ns)
    if not left:
        return float(leg.stop_steps), HALF_STEP
    to_go = left - 1 + (next_ns - now_ns) / max(timer.period_ns, 1)
    length = abs(leg.stop_steps - leg.start_steps)
    return leg.stop_steps - leg.direction * (min(to_go, length) + HALF_STEP), 0.0


def step_axes_off(axes: Sequence[StepAxis], trajectory: Trajectory, start_ns: int, now_ns: int) -> list[Off]:
    """Of steppers; start_ns: link time of t = 0."""
    if not axes:
        return []
    time_s = np.array([(now_ns - start_ns) / NS_PER_S])
    planned, rates = trajectory.q(time_s)[0], trajectory.v(time_s)[0]
    found = []
    for axis in axes:
        column, per_unit = trajectory.axes.index(axis.motor.axis), axis.motor.steps_per_unit
        at, slack = step_axis_at(axis, now_ns)
        off = float(planned[column]) * per_unit - at
        found.append(Off(math.copysign(max(abs(off) - slack, 0.0), off), float(rates[column]) * per_unit))
    return found


def servo_off(lane: ServoLane, now_ns: int) -> Off:
    """Of a servo's command."""
    return Off(lane.off(now_ns), lane.track.rate(now_ns))
