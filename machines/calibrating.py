"""``calibrate`` of one motor of a machine: how far it may run, the measurement, and what is written about it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from machines.bringup import Connection, bus_of, set_step_parameters
from machines.calibration import Crystal, calibrate_servo, calibrate_stepper
from machines.commission import Asker, StopRequested, UndecidedError
from machines.probing import table_of
from machines.schema import MachineConfig
from machines.tomledit import Value, set_values
from machines.wiring import bus_timing, motor_tables, nmc_buses, servo_tables, speed_mode
from nmc.picservo import PicServo
from nmc.picstep import PicStep

RATE_HZ = 200.0
"""Steps a second of a calibrating run, at most: no motor stalls at it."""
STEPS_LEAST = 50


def run_steps(config: MachineConfig, motor: str, seconds: float, position: int = 0) -> int:
    """Steps of a calibrating run, signed: towards the side of the travel that has more room.

    position: counter where the motor stands. Raises UndecidedError where there is no room, or where the axis has
    another motor, which one that runs alone would rack.
    """
    axis, table = motor_tables(config)[motor]
    if sum(other == axis for other, _ in motor_tables(config).values()) > 1:
        raise UndecidedError(f"axis {axis} has several motors: one that runs alone would rack it")
    ends = [end * table.steps_per_unit - position for end in config.axis[axis].travel]
    room = max(ends, key=abs)
    steps = int(min(abs(room), RATE_HZ * seconds))
    if steps < STEPS_LEAST:
        raise UndecidedError(f"only {steps} steps of travel are left beside motor {motor}: jog it away first")
    return steps if room > 0 else -steps


def calibrate_motor(
    connection: Connection,
    motor: str,
    *,
    seconds: float,
    stop_requested: StopRequested,
    progress: Callable[[], None] = lambda: None,
) -> Crystal:
    """Measure one module; a stepper runs there and back, a servo rests. Raises UndecidedError."""
    config = connection.config
    steppers = motor_tables(config)
    table = steppers[motor][1] if motor in steppers else servo_tables(config)[motor][1]
    bus = bus_of(connection, table.bus)
    timing = bus_timing(config, list(nmc_buses(config)).index(table.bus), connection.simulation is not None)
    asker = Asker(bus, stop_requested)
    if motor not in steppers:
        found = calibrate_servo(PicServo(bus, table.address), timing, asker, seconds)
        progress()
        return found
    axis, step_table = steppers[motor]
    chip = PicStep(bus, table.address)
    steps = run_steps(config, motor, seconds, chip.position())
    set_step_parameters(chip, step_table, "1x")
    try:
        found = calibrate_stepper(chip, timing, asker, steps, seconds, progress)
    except UndecidedError:
        chip.stop_motor("abruptly")  # the next motor may have its turn: this one must stand
        set_step_parameters(chip, step_table, f"{speed_mode(config, axis, step_table)}x")
        raise
    chip.stop_motor("abruptly")
    set_step_parameters(chip, step_table, f"{speed_mode(config, axis, step_table)}x")
    return found


def with_crystals(text: str, config: MachineConfig, found: Sequence[tuple[str, Crystal]], place: str, date: str) -> str:
    """The text of the machine file with these crystals. Raises ValueError where it cannot be changed safely."""
    for motor, crystal in found:
        record: dict[str, Value] = {
            "ppm": round(crystal.ppm, 2),
            "within_ppm": round(crystal.within_ppm + 0.01, 2),
            "measured_on": place,
            "date": date,
        }
        text = set_values(text, (*table_of(config, motor), "crystal"), record)
    return text
