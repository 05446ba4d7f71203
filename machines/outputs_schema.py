"""``[spindle]``, ``[coolant]``, ``[output.N]``, ``[analog.N]``: what a machine does beside moving.

Which keys a drive of the spindle needs, and whether a module has the pin that is named, is checked across tables in
``outputs_rules.py``.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from machines.arith import number
from machines.tables import Address, Byte, NotNegative, Number, Positive, ServoTable, Table

Drive = Literal["velocity", "pwm", "output"]


class PinTable(Table):
    """One output pin. ``module``: an axis or motor, a ``[module.NAME]``, or ``spindle`` (its PIC-SERVO's limit pins).

    ``pin``: ``out1`` to ``out5`` of a PIC-STEP, ``limit1`` or ``limit2`` of a PIC-SERVO, ``bit0`` to ``bit11`` of a
    PIC-I/O; where a value is set: ``pwm1`` or ``pwm2`` of a PIC-I/O, ``pwm`` of a PIC-SERVO that moves nothing.
    """

    module: str = Field(min_length=1)
    pin: str = Field(min_length=1)
    active_low: bool = False


class CoolantTable(Table):
    """``[coolant]``: M7 is ``mist``, M8 ``flood``, M9 both off."""

    flood: PinTable | None = None
    mist: PinTable | None = None


class OutputTable(PinTable):
    """``[output.N]``: M62 to M65 P N. ``on_stop``: what a stop or a fault does to it."""

    on_stop: Literal["off", "keep"] = "off"


class AnalogTable(Table):
    """``[analog.N]``: M67 and M68 E N. The Q values ``least`` and ``greatest`` are PWM 0 and 255."""

    module: str = Field(min_length=1)
    pin: str = Field(min_length=1)
    least: Number = 0.0
    greatest: Number = 255.0
    on_stop: Literal["off", "keep"] = "off"


class SpindleTable(Table):
    """``[spindle]``. Speeds in rpm.

    ``drive``: a PIC-SERVO in velocity mode or in PWM mode, or output pins. ``counts_per_rev``: encoder counts a turn.
    ``clockwise``: the chip's direction that is M3. ``ramp_time``: s from rest to ``max_rpm``, ``settle_time``: s until
    the speed holds after that; both are planned as a rest. ``at_speed``: share by which the speed may differ then.
    ``pwm_at_min``, ``pwm_at_max``: PWM values of ``min_rpm`` and ``max_rpm``. ``on``, ``reverse``: pins that switch it
    on and turn it round; ``speed``: a PWM pin that says how fast.
    """

    drive: Drive
    max_rpm: Positive
    min_rpm: NotNegative = 0.0
    ramp_time: Positive
    settle_time: NotNegative = 0.2
    at_speed: Annotated[float, BeforeValidator(number), Field(gt=0, le=0.5)] = 0.05
    clockwise: Literal["forward", "reverse"] = "forward"
    bus: str | None = None
    address: Address | None = None
    counts_per_rev: Positive | None = None
    servo: ServoTable | None = None
    pwm_at_min: Byte = 0
    pwm_at_max: Byte = 255
    on: PinTable | None = None
    reverse: PinTable | None = None
    speed: PinTable | None = None
