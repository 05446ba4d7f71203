"""What the pictures draw, taken from plan, program and trace."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from gcode.canon import KIND_RAPID, Command, MoveBlock, Rapid
from groupstart.picture import PathData, PinData
from machines.judge import trace_pins
from machines.runner import RunResult
from machines.schema import MachineConfig
from machines.wiring import every_motor, scale_of
from planner.cy545 import Indexer
from planner.motors import Motor
from planner.planfile import sample_times
from planner.types import Trajectory


def path_data(trajectory: Trajectory, commands: Iterable[Command | MoveBlock]) -> PathData:
    """The planned path in samples, with the samples that belong to rapids marked."""
    t_s = sample_times(trajectory, 0.005)
    rapids: set[int] = set()
    others: set[int] = set()
    for command in commands:
        if isinstance(command, MoveBlock):
            is_rapid = command.kind == KIND_RAPID
            rapids.update(command.line[is_rapid].tolist())
            others.update(command.line[~is_rapid].tolist())
        elif isinstance(command, Rapid):
            rapids.add(command.line)
        elif hasattr(command, "end"):
            others.add(command.line)
    rapid = np.isin(trajectory.line(t_s), sorted(rapids - others))
    return PathData(tuple(trajectory.axes), t_s, trajectory.q(t_s), trajectory.v(t_s), rapid)


def pin_data(config: MachineConfig, result: RunResult, axes: tuple[str, ...]) -> PinData | None:
    """Where the axes stood, by their first motors (of servos the shaft), in mm and on the plan's clock."""
    trace, outcome = result.trace, result.outcome
    if trace is None or outcome is None:
        return None
    out = trace_pins(trace, outcome.begins_at, trace.servo_position)
    first: dict[str, Motor | Indexer] = {}
    for motor in every_motor(config):
        first.setdefault(motor.axis, motor)
    columns = [trace.axes.index(first[axis].name) for axis in axes]
    scale = np.array([scale_of(first[axis]) for axis in axes])
    begun = out.time_ns >= trace.plan_start_ns
    return PinData((out.time_ns[begun] - trace.plan_start_ns) * 1e-9, out.position[begun][:, columns] / scale)
