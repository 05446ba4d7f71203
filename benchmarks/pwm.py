"""What comes out of a PIC-SERVO's PWM and DIR pins, reckoned from a trace by the data sheet, section 4.3.

``PWM = min(abs(output / 256), output_limit)`` is a whole number from 0 to 255, the direction a bit of its own. How much
either shakes the motor is told by the change from tick to tick: of the PWM value, and of the value with its sign, which
counts a change of direction as the sum of the two.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sim.trace import Trace

I8 = npt.NDArray[np.int64]
FULL = 255


@dataclass(frozen=True, slots=True)
class PwmChange:
    """Root mean squares of the change a tick of one servo. value: of PWM, 0 to 255; signed: with its direction."""

    value: float
    signed: float


def signed_pwm(error_counts: I8, gains: Sequence[int]) -> I8:
    """PWM, negative for DIR 1, at every tick. gains: Kp, Kd, Ki, IL; output limit 255, no current limit.

    error_counts i8[N]: command less position from where the servo was switched on.
    """
    kp, kd, ki, limit = gains
    total, sums = 0, np.empty_like(error_counts)
    for tick, error in enumerate(error_counts.tolist()):
        total = min(max(total + error, -256 * limit), 256 * limit)
        sums[tick] = total
    output = kp * error_counts + kd * np.diff(error_counts, prepend=0) + ki * (sums >> 8)
    return np.asarray(np.sign(output) * np.minimum(np.abs(output) >> 8, FULL))


def change_of(signed: I8) -> PwmChange:
    """What a motor is told from tick to tick."""
    return PwmChange(rms(np.diff(np.abs(signed))), rms(np.diff(signed)))


def pwm_changes(trace: Trace, gains: Sequence[int], start_ns: int, duration_s: float) -> tuple[PwmChange, ...]:
    """Of every servo while the plan runs, in the order of the motors."""
    found = []
    for motor in np.unique(trace.servo_axis):
        mine = trace.servo_axis == motor
        error = trace.servo_command[mine].astype(np.int64) - trace.servo_position[mine]
        time_ns = trace.servo_ns[mine]
        judged = (time_ns >= start_ns) & (time_ns <= start_ns + duration_s * 1e9)
        found.append(change_of(signed_pwm(error, gains)[judged]))
    return tuple(found)


def rms(values: npt.NDArray[np.float64] | I8) -> float:
    """Root mean square; 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64)))) if len(values) else 0.0


def all_of(changes: Sequence[PwmChange]) -> PwmChange:
    """Of several servos or runs of like length together."""
    return PwmChange(rms(np.array([c.value for c in changes])), rms(np.array([c.signed for c in changes])))
