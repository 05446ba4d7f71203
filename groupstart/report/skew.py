"""Start skew: how far apart steppers that begin to move together are from where the plan has their first steps.

A start is a moment at which no motor has stepped for a while. Of each motor that steps soon after it, the first pulse
is compared with the instant at which the plan is half a step away; what differs between the motors is the skew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from machines.schema import MachineConfig
from machines.wiring import motors
from planner.motors import StepMotor
from planner.types import F8, Trajectory
from sim.trace import Trace

QUIET_NS, SOON_S, BEFORE_S, STEP_S = 100_000_000, 0.25, 0.05, 5e-5


@dataclass(frozen=True, slots=True)
class Start:
    """Motors beginning together at ``time_s``: the latest is ``skew_ms`` later than the earliest, against the plan."""

    time_s: float
    motors: tuple[str, ...]
    skew_ms: float


def starts(config: MachineConfig, trace: Trace, trajectory: Trajectory) -> list[Start]:
    """Every start of two steppers or more, in order."""
    steppers = [motor for motor in motors(config) if isinstance(motor, StepMotor)]
    pulses = {m.name: (trace.pulses_ns(m.name) - trace.plan_start_ns) * 1e-9 for m in steppers}
    every = np.sort(np.concatenate([*pulses.values(), np.zeros(0)]))
    every = every[every > -BEFORE_S]
    if not len(every):
        return []
    quiet = np.concatenate([[True], np.diff(every) > QUIET_NS * 1e-9])
    found = []
    for begin_s in every[quiet].tolist():
        t = np.arange(max(begin_s - BEFORE_S, 0.0), begin_s + SOON_S, STEP_S)
        q = trajectory.q(t)
        late: dict[str, float] = {}
        for motor in steppers:
            mine = pulses[motor.name]
            k = int(np.searchsorted(mine, begin_s - 1e-9))
            planned_s = _first_step(t, q[:, trajectory.axes.index(motor.axis)] * motor.steps_per_unit)
            if planned_s is not None and k < len(mine) and mine[k] < begin_s + SOON_S:
                late[motor.name] = float(mine[k]) - planned_s
        if len(late) > 1:
            found.append(Start(begin_s, tuple(late), 1e3 * (max(late.values()) - min(late.values()))))
    return found


def _first_step(t: F8, steps: F8) -> float | None:
    """When a planned position in steps has left its first whole step, None if it does not."""
    away = np.abs(steps - np.rint(steps[0])) >= 0.5
    return float(t[np.argmax(away)]) if away.any() else None
