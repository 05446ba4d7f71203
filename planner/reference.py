"""toppra on the interval arrays: the reference solver.

toppra sees the intervals through a custom linear constraint with one-sided values (its stock constraints evaluate q''
at the nodes, on one side only, and so violate limits where q'' jumps). Always in mm, always with our own gridpoints,
never with its spline parametrizer. Import is slow (about 1.2 s), so this module is imported only where toppra is
asked for.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from planner.errors import PlanError
from planner.lazyplots import without_plots
from planner.types import F8, Intervals

with without_plots():
    import toppra
    from toppra.constraint import ConstraintType, DiscretizationType, LinearConstraint


class _Grid(toppra.interpolator.AbstractGeometricPath):  # type: ignore[misc]  # toppra carries no types
    """toppra asks a path for little more than its interval when the constraints carry their own numbers."""

    def __init__(self, nodes: F8, dof: int) -> None:
        super().__init__()
        self._nodes, self._dof = nodes, dof

    dof = property(lambda self: self._dof)
    path_interval = property(lambda self: np.array([self._nodes[0], self._nodes[-1]]))

    def __call__(self, path_positions: Any, order: int = 0) -> F8:
        return np.zeros((*np.shape(path_positions), self._dof))


class _Acceleration(LinearConstraint):  # type: ignore[misc]
    """|q' u + q'' x| <= A at both ends of every interval, x and u those of the interval's start."""

    def __init__(self, length: F8, tangent_in: F8, tangent_out: F8, acceleration: F8) -> None:
        super().__init__()
        self.dof = tangent_in.shape[1]
        self.set_discretization_type(DiscretizationType.Collocation)
        self.identical = True
        self._constraint_type = ConstraintType.CanonicalLinear
        bend = (tangent_out - tangent_in) / length[:, None]
        out = tangent_out + 2 * (tangent_out - tangent_in)
        pad = np.zeros((1, 2 * self.dof))
        self._a = np.vstack([np.hstack([tangent_in, out]), pad])
        self._b = np.vstack([np.hstack([bend, bend]), pad])
        self._limit = np.tile(acceleration, 4)

    def compute_constraint_params(self, path: Any, gridpoints: Any, *_: Any) -> tuple[Any, ...]:
        eye = np.eye(2 * self.dof)
        return self._a, self._b, np.zeros_like(self._a), np.vstack([eye, -eye]), self._limit, None, None


class _Cap(LinearConstraint):  # type: ignore[misc]
    """x <= cap at every node."""

    def __init__(self, cap: F8, dof: int) -> None:
        super().__init__()
        self.dof = dof
        self.set_discretization_type(DiscretizationType.Collocation)
        self._constraint_type = ConstraintType.CanonicalLinear
        self._bound = np.stack([np.zeros_like(cap), cap], axis=1)

    def compute_constraint_params(self, path: Any, gridpoints: Any, *_: Any) -> tuple[Any, ...]:
        return None, None, None, None, None, None, self._bound


def solve(p: Intervals, tangents: tuple[F8, F8], acceleration: F8, node_cap: F8) -> F8:
    """x = s'^2 at all nodes f8[N + 1]. Each stop-to-stop run is a problem of its own. Raises PlanError.

    tangents: q' at both interval ends as the constraints see it, f8[N, R]. acceleration: f8[R]. node_cap: f8[N + 1].
    """
    x = np.zeros(len(p) + 1)
    for first, last in pairwise(np.flatnonzero(p.stop)):
        s = slice(int(first), int(last))
        try:
            part = tangents[0][s], tangents[1][s]
            x[first : last + 1] = _run(p.length[s], part, acceleration, node_cap[first : last + 1])
        except ValueError as error:
            raise PlanError(int(p.line[first]), "", f"toppra: {error}", "plan with --solver kernel") from None
    return x


def _run(length: F8, tangents: tuple[F8, F8], acceleration: F8, node_cap: F8) -> F8:
    if len(length) == 1:
        return np.zeros(2)
    s = np.concatenate([[0.0], np.cumsum(length)])
    cap = node_cap.copy()
    cap[[0, -1]] = np.max(node_cap)  # the ends are held by sd_start and sd_end
    dof = tangents[0].shape[1]
    problem = toppra.algorithm.TOPPRA(
        [_Acceleration(length, *tangents, acceleration), _Cap(cap, dof)], _Grid(s, dof), gridpoints=s,
        solver_wrapper="seidel", parametrizer="ParametrizeConstAccel",
    )  # fmt: skip
    _, speed, _ = problem.compute_parameterization(0.0, 0.0)
    if speed is None or np.isnan(speed).any():
        raise ValueError("no parametrization found")
    return np.asarray(speed) ** 2
