"""The gains of a PIC-SERVO as its machine file has them."""

from __future__ import annotations

from machines.schema import ServoMotorTable
from nmc.picservo import Gains


def gains_of(table: ServoMotorTable) -> Gains:
    """``[axis.X.servo]`` as Set Gain is told (PIC-SERVO data sheet section 5.2)."""
    chosen = table.servo
    return Gains(
        position_gain=chosen.kp,
        velocity_gain=chosen.kd,
        integral_gain=chosen.ki,
        integration_limit=chosen.integration_limit,
        output_limit=chosen.output_limit,
        current_limit=chosen.current_limit,
        position_error_limit=chosen.position_error_limit,
        servo_rate_divisor=chosen.servo_rate_divisor,
        deadband=chosen.deadband,
    )
