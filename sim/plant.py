"""A DC motor with screw and load: from the numbers of a motor's data sheet to those that the compiled loop integrates.

Derivations, with K = counts per radian = 4 lines / 2 pi (four edges a line, PIC-SERVO data sheet section 4.2):
inertia J = rotor + mass (lead / 2 pi)^2; acceleration per ampere = Kt K / J; volts per count/s = Kt / K (Ke = Kt);
dry friction and load torque become counts/s^2 by K / J. The winding settles with time constant L / R.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from sim.servokernel import (
    AMP_DEADBAND,
    BACK_EMF,
    COULOMB,
    DECAY,
    F_SIZE,
    INDEX_AT,
    INDEX_EVERY,
    INDEX_WIDTH,
    LOAD,
    RESISTANCE,
    SENSE,
    SENSE_BASE,
    STOP_HIGH,
    STOP_LOW,
    SUBSTEP_S,
    SUBSTEPS,
    SUPPLY,
    THETA,
    TORQUE,
    VISCOUS,
)  # fmt: skip
from sim.spec import ServoPlant


def plant_arrays(plant: ServoPlant, start_counts: int, tick_s: float) -> npt.NDArray[np.float64]:
    """The array that the compiled loop integrates, f8[F_SIZE]; at rest in the middle of count ``start_counts``."""
    f = np.zeros(F_SIZE)
    counts_per_rad = 4 * plant.lines_per_rev / (2 * math.pi)
    inertia = plant.inertia_kgm2 + plant.load_mass_kg * (plant.lead_mm * 1e-3 / (2 * math.pi)) ** 2
    step_s = tick_s / SUBSTEPS
    f[THETA] = start_counts + 0.5
    f[SUPPLY] = plant.supply_v
    f[RESISTANCE] = plant.resistance_ohm
    f[DECAY] = math.exp(-step_s * plant.resistance_ohm / plant.inductance_h) if plant.inductance_h > 0 else 0.0
    f[BACK_EMF] = plant.torque_nm_per_a / counts_per_rad
    f[TORQUE] = plant.torque_nm_per_a * counts_per_rad / inertia
    f[COULOMB] = plant.coulomb_nm * counts_per_rad / inertia
    f[VISCOUS] = plant.viscous_nms / inertia
    f[LOAD] = plant.load_nm * counts_per_rad / inertia
    f[STOP_LOW] = -math.inf if plant.stop_low_counts is None else plant.stop_low_counts
    f[STOP_HIGH] = math.inf if plant.stop_high_counts is None else plant.stop_high_counts
    f[SENSE] = plant.sense_v_per_a * 255 / 5
    if plant.sense_inverted:
        f[SENSE], f[SENSE_BASE] = -f[SENSE], 255
    f[SUBSTEP_S] = step_s
    f[INDEX_EVERY] = 4 * plant.lines_per_rev if plant.index else 0
    f[INDEX_WIDTH] = plant.index_width_counts
    f[INDEX_AT] = plant.index_at_counts
    f[AMP_DEADBAND] = plant.amp_deadband
    return f
