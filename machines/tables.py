"""What every table of a machine file is made of: numbers that may be arithmetic, and a model that is strict.

``schema.py`` and ``outputs_schema.py`` build the tables of a file from these.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from machines.arith import nonzero, number, whole

Number = Annotated[float, BeforeValidator(number), Field(allow_inf_nan=False)]
Positive = Annotated[float, BeforeValidator(number), Field(gt=0, allow_inf_nan=False)]
Scale = Annotated[float, BeforeValidator(number), Field(allow_inf_nan=False), AfterValidator(nonzero)]
NotNegative = Annotated[float, BeforeValidator(number), Field(ge=0, allow_inf_nan=False)]
Byte = Annotated[int, BeforeValidator(whole), Field(ge=0, le=255)]
Address = Annotated[int, BeforeValidator(whole), Field(ge=1, le=127)]
Integer = Annotated[int, BeforeValidator(whole)]


class Table(BaseModel):
    """Base of all tables: frozen, strict, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)


class ServoTable(Table):
    """``[axis.X.servo]``: what Set Gain of a PIC-SERVO is told (data sheet section 5.2)."""

    kp: Annotated[int, BeforeValidator(whole), Field(ge=0, le=0x7FFF)]
    kd: Annotated[int, BeforeValidator(whole), Field(ge=0, le=0x7FFF)]
    ki: Annotated[int, BeforeValidator(whole), Field(ge=0, le=0x7FFF)] = 0
    integration_limit: Annotated[int, BeforeValidator(whole), Field(ge=0, le=0x7FFF)] = 0
    output_limit: Byte = 255
    current_limit: Byte = 0
    position_error_limit: Annotated[int, BeforeValidator(whole), Field(ge=0, le=0x3FFF)] = 0x3FFF
    servo_rate_divisor: Annotated[int, BeforeValidator(whole), Field(ge=1, le=255)] = 1
    deadband: Byte = 0
