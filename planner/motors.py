"""Motors as the lowering sees them: which chip, where on the bus, how many steps a millimetre."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class StepMotor:
    """A stepper on a PIC-STEP.

    axis: planned axis that it follows. steps_per_unit: signed (negative turns it round), steps/mm or steps/deg.
    speed_mode: 1, 2, 4 or 8 (PIC-STEP data sheet, table 3). crystal_ppm: bound of the chip's unknown clock error, added
    to crystal_fast_ppb, the parts in 10^9 by which it is known to run fast. first_at_once: its first step comes with
    the start, not one period later.
    """

    name: str
    axis: str
    bus: int
    address: int
    steps_per_unit: float
    speed_mode: int
    crystal_ppm: int = 100
    crystal_fast_ppb: int = 0
    first_at_once: bool = False


@dataclass(frozen=True, slots=True)
class ServoMotor:
    """A DC servo on a PIC-SERVO with servo rate divisor 1.

    axis: planned axis that it follows. counts_per_unit: signed, encoder counts/mm or counts/deg. crystal_fast_ppb: by
    how much its clock is known to run fast, None: not known. lead_ns: it is commanded so much ahead of the plan, by
    which its shaft lags.
    """

    name: str
    axis: str
    bus: int
    address: int
    counts_per_unit: float
    crystal_fast_ppb: int | None = None
    lead_ns: int = 0


Motor = StepMotor | ServoMotor
