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
from bisect import bisect_left
from collections.abc import Iterable
from typing import NamedTuple

from planner.quantize import NS_PER_S
from planner.stream_axis import StepAxis
from planner.stream_servo import ServoLane


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


def step_axis_off(axis: StepAxis, now_ns: int) -> Off:
    """Of a stepper; one that rests is behind by what is overdue."""
    leg = axis.leg
    if leg is not None:
        instants, gaps = leg.instants_ns, leg.gaps_ns
        made = bisect_left(instants, now_ns - axis.start_ns)
        next_ns, left = axis.twin.nominal.ahead(now_ns)
        to_go = max(left - 1 + (next_ns - now_ns) / max(axis.twin.nominal.period_ns, 1), 0.0) if left else 0.0
        rate = NS_PER_S / max(gaps[min(made, len(gaps)) - 1], 1) if made and gaps else 0.0
        return Off(leg.direction * (to_go - axis.planned_to_go(now_ns)), leg.direction * rate)
    leg = axis.next_leg()
    if leg is None or leg.instants_ns[0] + axis.start_ns > now_ns:
        return Off(0.0, 0.0)
    missed = bisect_left(leg.instants_ns, now_ns - axis.start_ns)
    rate = NS_PER_S / max(leg.gaps_ns[min(missed, len(leg.gaps_ns)) - 1], 1) if leg.gaps_ns else 0.0
    return Off(float(leg.direction * missed), leg.direction * rate)


def servo_off(lane: ServoLane, now_ns: int) -> Off:
    """Of a servo's command."""
    return Off(lane.off(now_ns), lane.track.rate(now_ns))
