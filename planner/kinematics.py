"""Kinematics: from axes to joints, as small plug-ins.

A joint is a linear combination of axes: joints = matrix q. One matrix serves a cartesian machine, a gantry with two
motors on one axis, and a CoreXY belt; limits are the joints' own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from planner.errors import PlanError
from planner.types import F8


@dataclass(frozen=True, slots=True, eq=False)
class Kinematics:
    """joints: names, J. matrix: f8[J, A], joints = matrix q. velocity, acceleration: f8[J], mm (degrees) and s."""

    joints: tuple[str, ...]
    matrix: F8
    velocity: F8
    acceleration: F8

    def position(self, q: F8) -> F8:
        """Joints f8[N, J] of axis positions (or velocities, accelerations) f8[N, A]."""
        return np.asarray(q @ self.matrix.T)

    def axes_of(self, joints: F8) -> F8:
        """Axes f8[N, A] of joint positions f8[N, J]: the least-squares solution, exact where joints agree."""
        return np.asarray(joints @ np.linalg.pinv(self.matrix).T)


def gantry(axes: tuple[str, ...], motors: Mapping[str, str], velocity: F8, acceleration: F8) -> Kinematics:
    """One joint a motor; several motors may follow one axis. motors: name -> axis. Raises PlanError."""
    matrix = np.zeros((len(motors), len(axes)))
    for row, (motor, axis) in enumerate(motors.items()):
        if axis not in axes:
            raise PlanError(0, axis, f"motor {motor} follows axis {axis}, which the machine does not have")
        matrix[row, axes.index(axis)] = 1.0
    return Kinematics(tuple(motors), matrix, np.asarray(velocity, float), np.asarray(acceleration, float))


def corexy(axes: tuple[str, ...], velocity: F8, acceleration: F8) -> Kinematics:
    """CoreXY: joint A = X + Y, joint B = X - Y, the other axes straight through. Raises PlanError without X and Y."""
    if "X" not in axes or "Y" not in axes:
        raise PlanError(0, "X", "CoreXY needs the axes X and Y")
    matrix = np.eye(len(axes))
    x, y = axes.index("X"), axes.index("Y")
    matrix[x, y] = matrix[y, x] = 1.0
    matrix[y, y] = -1.0
    joints = tuple({"X": "belt A", "Y": "belt B"}.get(a, a) for a in axes)
    return Kinematics(joints, matrix, np.asarray(velocity, float), np.asarray(acceleration, float))
