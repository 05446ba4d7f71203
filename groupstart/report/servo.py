"""Servo axes over time: following error, and the PWM that the chip's filter makes of it.

The trace keeps command and position of every tick; the filter is integer arithmetic on them (PIC-SERVO data sheet,
section 4.3), so the PWM follows exactly, as long as no tick is missing and no current limit is set.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from machines.schema import MachineConfig
from machines.tables import ServoTable
from machines.wiring import servo_tables
from planner.types import F8
from sim.trace import Trace

TICK_S = 512e-6
MOST_TICK_GAP = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class ServoAxisView:
    """One servo. t_s f8[S] of the plan, error_um f8[S], pwm f8[S] signed share of 255, None where it is not known."""

    name: str
    t_s: F8
    error_um: F8
    pwm: F8 | None


def servo_views(config: MachineConfig, trace: Trace) -> list[ServoAxisView]:
    """Every servo of a machine, in the order of its file."""
    found = []
    for name, (_, table) in servo_tables(config).items():
        mine = trace.servo_axis == trace.axes.index(name)
        if not mine.any():
            continue
        time_ns = trace.servo_ns[mine]
        error = trace.servo_command[mine].astype(np.int64) - trace.servo_position[mine]
        t_s = (time_ns - trace.plan_start_ns) * 1e-9
        every_tick = bool(np.diff(time_ns).max(initial=0) < MOST_TICK_GAP * TICK_S * 1e9)
        known = every_tick and table.servo.servo_rate_divisor == 1 and table.servo.current_limit == 0
        output = pwm_of(error, table.servo) if known else None
        run = t_s >= 0
        um = error[run] / abs(table.counts_per_unit) * 1e3
        found.append(ServoAxisView(name, t_s[run], um, None if output is None else output[run]))
    return found


def pwm_of(error: npt.NDArray[np.int64], gains: ServoTable) -> F8:
    """PWM of each tick as signed share of full: KP e + KD (e - e') + KI (sum >> 8), over 256, within OL."""
    total = clamped_sums(error, gains.integration_limit * 256)
    change = np.diff(error, prepend=error[:1])
    output = gains.kp * error + gains.kd * change + gains.ki * (total >> 8)
    size = np.minimum(np.abs(output) >> 8, gains.output_limit)
    size = np.where(output != 0, np.minimum(size + gains.deadband, 255), 0)
    return np.asarray(np.sign(output) * size / 255.0)


def clamped_sums(error: npt.NDArray[np.int64], bound: int) -> npt.NDArray[np.int64]:
    """Running sum that is held within plus and minus ``bound`` at every tick."""
    plain = np.cumsum(error)
    if np.abs(plain).max(initial=0) <= bound:
        return plain
    total, out = 0, np.empty(len(error), np.int64)
    for k, value in enumerate(error.tolist()):
        total = min(max(total + value, -bound), bound)
        out[k] = total
    return out
