"""How smooth the PWM of a servo can be: the plan itself is the command, tick by tick and to the last bit.

No stream can be smoother than that. What is left is the encoder's and the command's whole counts, seen by the filter.
"""

from __future__ import annotations

import numpy as np

from benchmarks.pwm import I8, PwmChange, change_of
from benchmarks.rig import Conditions, bring_up
from planner.types import Trajectory
from sim import servokernel as k
from sim.picservo import PicServo

TICK_S = 512e-6


def pwm_floor(trajectory: Trajectory, conditions: Conditions) -> tuple[PwmChange, ...]:
    """Change of PWM a tick of each servo, from the chip's own registers."""
    simulation, _, _ = bring_up(trajectory.axes, conditions)
    ticks = int(trajectory.duration_s / TICK_S)
    plan = trajectory.q(np.arange(ticks + 1) * TICK_S) * conditions.counts_per_mm
    steps = np.diff(np.round(plan * 65536.0), axis=0).astype(np.int64)
    found = []
    for column, name in enumerate(trajectory.axes):
        chip = simulation.modules[name]
        assert isinstance(chip, PicServo)
        found.append(change_of(driven(chip, steps[:, column])[0]))
    return tuple(found)


def driven(chip: PicServo, steps: I8) -> tuple[I8, I8]:
    """Signed PWM and error in counts at every tick, if the command moves by ``steps`` (counts x 65536) a tick."""
    n = chip.n
    n[k.AMP] = n[k.SERVO_ON] = 1
    n[k.MODE] = k.MODE_VELOCITY
    command, position = np.zeros(1, np.int64), np.zeros(1, np.int32)
    pwm, error = np.zeros_like(steps), np.zeros_like(steps)
    for tick, step in enumerate(steps):
        n[k.VELOCITY] = n[k.GOAL_VELOCITY] = step
        n[k.SAMPLES] = 0
        k.run(1, n, chip.f, chip.switches, command, position)
        pwm[tick] = -n[k.PWM] if n[k.DIR] else n[k.PWM]
        error[tick] = (int(command[0]) >> 16) - int(position[0])
    return pwm, error
