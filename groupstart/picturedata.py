"""What the pictures draw, taken from plan, program and trace."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from gcode.canon import KIND_RAPID, Command, MoveBlock, Rapid
from groupstart.picture import PathData, PinData
from machines.judge import step_runs
from planner.planfile import sample_times
from planner.types import Trajectory
from sim.pulses import pulses
from sim.trace import Trace


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


def pin_data(trace: Trace, axes: tuple[str, ...], motor_axis: Mapping[str, str], scale: Mapping[str, float]) -> PinData:
    """Where the axes stood after each pulse, by their first motors, in mm and on the plan's clock."""
    pins = pulses(step_runs(trace))
    first = {axis: name for name, axis in reversed(list(motor_axis.items()))}
    columns = [trace.axes.index(first[axis]) for axis in axes if axis in first]
    steps = np.array([scale[trace.axes[column]] for column in columns])
    return PinData((pins.time_ns - trace.plan_start_ns) * 1e-9, pins.position_steps[:, columns] / steps)
