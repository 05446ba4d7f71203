"""What bounds the motion: rows over the axes, each with a velocity and an acceleration.

|rows q'| s' <= velocity and |rows q'' s'^2 + rows q' s''| <= acceleration. On a plain machine the rows are the axes
themselves; a kinematics adds one row for each joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.errors import PlanError
from planner.kinematics import Kinematics
from planner.types import F8, Intervals, Limits


@dataclass(frozen=True, slots=True, eq=False)
class Constraints:
    """rows: f8[R, A], or None where they are the axes. velocity, acceleration: f8[R], mm (degrees) and s."""

    rows: F8 | None
    velocity: F8
    acceleration: F8

    def tangents(self, p: Intervals) -> tuple[F8, F8]:
        """q' at both interval ends as the rows see it, f8[N, R]."""
        if self.rows is None:
            return p.tangent_in, p.tangent_out
        return p.tangent_in @ self.rows.T, p.tangent_out @ self.rows.T

    def matrix(self, axes: int) -> F8:
        """The rows f8[R, A] written out."""
        return np.eye(axes) if self.rows is None else self.rows


def constraints_of(limits: Limits, kinematics: Kinematics | None = None) -> Constraints:
    """Limits of axes and joints together. Raises PlanError where a limit makes no sense."""
    _check(limits.axes, "velocity", limits.velocity)
    _check(limits.axes, "acceleration", limits.acceleration)
    axes = limits.velocity.astype(np.float64), limits.acceleration.astype(np.float64)
    if kinematics is None:
        return Constraints(None, *axes)
    _check(kinematics.joints, "velocity", kinematics.velocity)
    _check(kinematics.joints, "acceleration", kinematics.acceleration)
    return Constraints(
        np.vstack([np.eye(len(limits.axes)), kinematics.matrix]),
        np.concatenate([axes[0], kinematics.velocity]),
        np.concatenate([axes[1], kinematics.acceleration]),
    )


def _check(names: tuple[str, ...], what: str, values: F8) -> None:
    for name, value in zip(names, values, strict=True):
        if not value > 0:
            raise PlanError(0, name, f"{name}: {what} limit must be positive, not {value}")
