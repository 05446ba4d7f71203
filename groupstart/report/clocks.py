"""How wrong each module's crystal is, read from what came out, and how far it would drift over the job on its own.

A step timer counts whole ticks, so its periods are whole multiples of a tick that is as wrong as the crystal; a servo's
samples lie one servo tick apart. The stream corrects the drift as it goes; the figure tells what it had to correct.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from machines.schema import MachineConfig
from machines.wiring import motors
from planner.motors import StepMotor
from planner.quantize import tick_ns
from sim.trace import Trace

SERVO_TICK_NS = 512_000
MOST_TICKS = 2_500
"""periods longer than this say nothing: the error would be as long as a tick"""


@dataclass(frozen=True, slots=True)
class Clock:
    """Of motor ``name``: crystal_ppm > 0 fast; drift_ms over the whole job if nothing corrected it."""

    name: str
    crystal_ppm: float
    drift_ms: float


def clocks(config: MachineConfig, trace: Trace, duration_s: float) -> list[Clock]:
    """Every motor whose clock shows in the trace."""
    found = []
    for motor in motors(config):
        number = trace.axes.index(motor.name) if motor.name in trace.axes else -1
        if isinstance(motor, StepMotor):
            slow = _step_error(trace, number, tick_ns(motor.speed_mode))
        else:
            slow = _servo_error(trace, number)
        if slow is not None:
            found.append(Clock(motor.name, -1e6 * slow, 1e3 * abs(slow) * duration_s))
    return found


def _step_error(trace: Trace, number: int, one_tick_ns: float) -> float | None:
    """Share by which the periods are too long, the weighted mean over all long trains of pulses."""
    mine = (trace.run_axis == number) & (trace.run_count > 2)
    period, count = trace.run_period_ns[mine], trace.run_count[mine]
    ticks = np.rint(period / one_tick_ns)
    good = (ticks > 50) & (ticks < MOST_TICKS)
    if not good.any():
        return None
    return float(np.average(period[good] / (ticks[good] * one_tick_ns) - 1, weights=count[good]))


def _servo_error(trace: Trace, number: int) -> float | None:
    time_ns = trace.servo_ns[trace.servo_axis == number]
    if len(time_ns) < 2:
        return None
    span = int(time_ns[-1] - time_ns[0])
    every = round(span / (len(time_ns) - 1) / SERVO_TICK_NS)
    return span / ((len(time_ns) - 1) * every * SERVO_TICK_NS) - 1 if every else None
