"""What was measured of the modules: which record counts where, and what a stream then knows of its motors.

A record of a port is one of the module itself. A record of the twin is one of crystals that were drawn from a seed: it
counts for that seed and nowhere else.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil

from machines.schema import TWIN, CrystalTable, MachineConfig, StepMotorTable
from machines.wiring import motor_tables, motors, servo_tables
from planner.motors import Motor, StepMotor

DRIFT_PPM = 5.0
"""Temperature moves a crystal after it was measured; streams allow for so much more."""


def calibrated(config: MachineConfig, place: str) -> list[Motor]:
    """The motors with what is known of their crystals at ``place`` (of the connection)."""
    tables = {name: table for name, (_, table) in motor_tables(config).items()}
    servos = {name: table for name, (_, table) in servo_tables(config).items()}
    found = []
    for motor in motors(config):
        table = tables.get(motor.name) or servos[motor.name]
        known = motor if table.crystal is None else _with(motor, table.crystal, place)
        if isinstance(known, StepMotor):
            known = replace(known, first_at_once=_first_at_once(config, tables[motor.name], place))
        found.append(known)
    return found


def _first_at_once(config: MachineConfig, table: StepMotorTable, place: str) -> bool:
    """Of the twin ``[sim]`` says it, of a port what was measured on a module."""
    if place.startswith(TWIN):
        return config.sim.first_step == "immediate"
    on_twin = table.probed is not None and table.probed.measured_on.startswith(TWIN)
    return table.first_step == "immediate" and not on_twin


def _with(motor: Motor, crystal: CrystalTable, place: str) -> Motor:
    of_twin = crystal.measured_on.startswith(TWIN)
    if crystal.measured_on != place and (of_twin or place.startswith(TWIN)):
        return motor
    fast_ppb = round(crystal.ppm * 1000)
    if isinstance(motor, StepMotor):
        return replace(motor, crystal_fast_ppb=fast_ppb, crystal_ppm=ceil(crystal.within_ppm + DRIFT_PPM))
    return replace(motor, crystal_fast_ppb=fast_ppb)
