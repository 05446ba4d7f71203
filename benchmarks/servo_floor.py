"""How smooth the PWM of a servo can be: the plan itself is the command, tick by tick and to the last bit.

No stream can be smoother than that. What is left is the encoder's and the command's whole counts, seen by the filter.
"""

from __future__ import annotations

import numpy as np

from benchmarks.rig import Conditions, bring_up
from planner.types import Trajectory
from sim import servokernel as k

TICK_S = 512e-6


def pwm_floor(trajectory: Trajectory, conditions: Conditions) -> float:
    """Root mean square of the change of PWM a tick; the worst axis, as ``Outcome.pwm_change_rms``."""
    simulation, _, _ = bring_up(trajectory.axes, conditions)
    ticks = int(trajectory.duration_s / TICK_S)
    plan = trajectory.q(np.arange(ticks + 1) * TICK_S) * conditions.counts_per_mm
    steps = np.diff(np.round(plan * 65536.0), axis=0).astype(np.int64)
    worst = 0.0
    command, position = np.zeros(1, np.int64), np.zeros(1, np.int32)
    for column, name in enumerate(trajectory.axes):
        chip = simulation.modules[name]
        n = chip.n
        n[k.AMP] = n[k.SERVO_ON] = 1
        n[k.MODE] = k.MODE_VELOCITY
        error = np.zeros(ticks)
        for tick, step in enumerate(steps[:, column]):
            n[k.VELOCITY] = n[k.GOAL_VELOCITY] = step
            n[k.SAMPLES] = 0
            k.run(1, n, chip.f, chip.switches, command, position)
            error[tick] = (int(command[0]) >> 16) - int(position[0])
        output = (conditions.gains[0] * error[1:] + conditions.gains[1] * np.diff(error)) / 256.0
        worst = max(worst, float(np.sqrt(np.mean(np.diff(np.clip(output, -255.0, 255.0)) ** 2))))
    return worst
