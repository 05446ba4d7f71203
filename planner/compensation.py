"""Joints: kinematics, backlash and leadscrew errors applied to a trajectory, themselves limited in velocity and
acceleration.

Backlash: when a joint changes its direction, its motor must go the width of the gap further. The sign of the
direction is a square wave; averaged over T1 and again over T2 it moves with at most width / T1 and 2 width / (T1 T2),
however quickly reversals follow each other. Screw error: a table of corrections over position, piecewise linear, its
knots rounded by parabolas so wide that passing them at full speed costs at most the acceleration set aside.
``planning_limits`` takes both from the joint's limits, so that the sum keeps them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from planner.errors import PlanError
from planner.kinematics import Kinematics
from planner.turns import turns_in_time
from planner.types import F8, I4, Event, Index, Limits, Trajectory


@dataclass(frozen=True, slots=True)
class Backlash:
    """width_mm of the gap, what its take-up may use, and the direction (+1, -1) in which homing left it taken up."""

    width_mm: float
    velocity_mm_s: float
    acceleration_mm_s2: float
    homed: int = 1

    def windows_s(self) -> tuple[float, float]:
        """T1 >= T2 of the two averages."""
        t1 = self.width_mm / self.velocity_mm_s
        product = 2 * self.width_mm / self.acceleration_mm_s2
        return (t1, product / t1) if t1 * t1 >= product else (float(np.sqrt(product)), float(np.sqrt(product)))


@dataclass(frozen=True, slots=True, eq=False)
class ScrewTable:
    """Correction f8[K] to add at positions f8[K], ascending, mm; constant outside. half_mm: f8[K], half width of each
    knot."""

    position: F8
    correction: F8
    half_mm: F8

    def slopes(self) -> F8:
        """Slope of the correction left of each knot and right of the last, f8[K + 1]."""
        return np.concatenate([[0.0], np.diff(self.correction) / np.diff(self.position), [0.0]])

    def at(self, q: F8) -> tuple[F8, F8, F8]:
        """Correction, its slope and its curvature at q f8[N]."""
        slopes = self.slopes()
        out = np.interp(q, self.position, self.correction)
        k = np.searchsorted(self.position, q, side="right")
        slope, bend = slopes[k], np.zeros(len(q))
        for knot, (place, half) in enumerate(zip(self.position, self.half_mm, strict=True)):
            near = np.abs(q - place) < half
            if half > 0 and near.any():
                step, z = slopes[knot + 1] - slopes[knot], q[near] - place + half
                out[near] = self.correction[knot] + slopes[knot] * (z - half) + step * z**2 / (4 * half)
                slope[near] = slopes[knot] + step * z / (2 * half)
                bend[near] = step / (2 * half)
        return out, slope, bend


def screw_table(position: F8, correction: F8, velocity_mm_s: float, acceleration_mm_s2: float) -> ScrewTable:
    """A table whose knots can be passed at ``velocity_mm_s`` for at most ``acceleration_mm_s2``. Raises PlanError."""
    position, correction = np.asarray(position, float), np.asarray(correction, float)
    if len(position) < 2 or len(position) != len(correction) or (np.diff(position) <= 0).any():
        raise PlanError(0, "", "a screw table needs two or more positions in ascending order, each with a correction")
    table = ScrewTable(position, correction, np.zeros(len(position)))
    half = np.abs(np.diff(table.slopes())) * velocity_mm_s**2 / (2 * acceleration_mm_s2)
    gap = np.diff(position)
    tight = np.flatnonzero(half[:-1] + half[1:] > gap)
    if len(tight):
        k = int(tight[0])
        hint = "smooth the table, or set aside more acceleration"
        raise PlanError(0, "", f"screw table knots at {position[k]:g} and {position[k + 1]:g} mm are too close", hint)
    return replace(table, half_mm=half)


@dataclass(frozen=True, slots=True)
class Compensation:
    """Of one joint."""

    backlash: Backlash | None = None
    screw: ScrewTable | None = None
    screw_acceleration_mm_s2: float = 0.0


def planning_limits(limits: Limits, compensation: Mapping[str, Compensation]) -> Limits:
    """What is left of velocity and acceleration when compensation has its part. Raises PlanError if nothing is."""
    velocity, acceleration = limits.velocity.copy(), limits.acceleration.copy()
    for k, name in enumerate(limits.axes):
        c = compensation.get(name)
        if c is None:
            continue
        if c.backlash is not None:
            velocity[k] -= c.backlash.velocity_mm_s
            acceleration[k] -= c.backlash.acceleration_mm_s2
        if c.screw is not None:
            steepest = 1 + float(np.abs(c.screw.slopes()).max())
            velocity[k] /= steepest
            acceleration[k] = (acceleration[k] - c.screw_acceleration_mm_s2) / steepest
        if velocity[k] <= 0 or acceleration[k] <= 0:
            raise PlanError(0, name, f"compensation of {name} takes all of its velocity or acceleration")
    return replace(limits, velocity=velocity, acceleration=acceleration)


@dataclass(frozen=True, eq=False)
class JointTrajectory:
    """What the motors of a trajectory do; has the shape of ``planner.types.Trajectory`` with joints for axes."""

    trajectory: Trajectory
    kinematics: Kinematics
    compensation: Mapping[str, Compensation] = field(default_factory=dict)
    _turns: dict[int, F8] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        end = self.trajectory.duration_s
        for j, name in enumerate(self.kinematics.joints):
            found = self.compensation.get(name)
            if found is not None and found.backlash is not None:
                self._turns[j] = _direction_changes(
                    self.trajectory, self.kinematics.matrix[j], end, found.backlash.homed
                )

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.kinematics.joints

    @property
    def duration_s(self) -> float:
        """Time at which also the last take-up is over."""
        ends = [t[-1] + sum(self._backlash(j).windows_s()) for j, t in self._turns.items() if len(t)]
        return float(max([self.trajectory.duration_s, *ends]))

    @property
    def events(self) -> tuple[Event, ...]:
        """The trajectory's."""
        return tuple(self.trajectory.events)

    def q(self, t_s: F8) -> F8:
        """Joint positions f8[len(t), J]."""
        return self._compensated(t_s)[0]

    def v(self, t_s: F8) -> F8:
        """Joint velocities f8[len(t), J]."""
        return self._compensated(t_s)[1]

    def a(self, t_s: F8) -> F8:
        """Joint accelerations f8[len(t), J]."""
        return self._compensated(t_s)[2]

    def line(self, t_s: F8) -> I4:
        """Source line i4[len(t)]."""
        return self.trajectory.line(t_s)

    def junctions_s(self) -> F8:
        """The trajectory's, and begin, corners and end of every take-up."""
        parts = [self.trajectory.junctions_s()]
        for j, turns in self._turns.items():
            t1, t2 = self._backlash(j).windows_s()
            parts += [turns, turns + t2, turns + t1, turns + t1 + t2]
        return np.unique(np.concatenate(parts))

    def _backlash(self, joint: int) -> Backlash:
        found = self.compensation[self.kinematics.joints[joint]].backlash
        assert found is not None
        return found

    def _compensated(self, t_s: F8) -> tuple[F8, F8, F8]:
        t = np.atleast_1d(np.asarray(t_s, dtype=np.float64))
        q, v, a = (self.kinematics.position(f(t)) for f in (self.trajectory.q, self.trajectory.v, self.trajectory.a))
        for j, name in enumerate(self.kinematics.joints):
            c = self.compensation.get(name)
            if c is None:
                continue
            if c.screw is not None:
                correction, slope, bend = c.screw.at(q[:, j])
                a[:, j] = (1 + slope) * a[:, j] + bend * v[:, j] ** 2
                v[:, j] = (1 + slope) * v[:, j]
                q[:, j] += correction
            if c.backlash is not None:
                gap = _take_up(t, self._turns[j], c.backlash)
                q[:, j] += gap[0]
                v[:, j] += gap[1]
                a[:, j] += gap[2]
        return q, v, a


def _direction_changes(trajectory: Trajectory, row: F8, end_s: float, homed: int) -> F8:
    """Times at which the joint's direction differs from the one before, the first one against ``homed``."""
    times, _ = turns_in_time(trajectory, row, 0.0, end_s)
    moments = np.unique(np.concatenate([trajectory.junctions_s(), np.linspace(0.0, end_s, 1000)]))
    v = trajectory.v((moments[:-1] + moments[1:]) / 2) @ row if len(moments) > 1 else np.zeros(0)
    moving = np.flatnonzero(np.abs(v) > 1e-9)
    if len(moving) and np.sign(v[moving[0]]) != homed:
        times = np.concatenate([[0.0], times])
    return times


def _take_up(t: F8, turns: F8, b: Backlash) -> tuple[F8, F8, F8]:
    """Offset of the motor, velocity and acceleration, f8[len(t)] each: 0 in the homed direction, the gap in the
    other."""
    t1, t2 = b.windows_s()
    done, begun = np.searchsorted(turns, t - t1 - t2, side="right"), np.searchsorted(turns, t, side="right")
    out = (done % 2).astype(float), np.zeros(len(t)), np.zeros(len(t))
    for k in range(int((begun - done).max(initial=0))):
        n = done + k
        here = np.flatnonzero(n < begun)
        step = _smooth_step(t[here] - turns[n[here]], t1, t2)
        sign = np.where(n[here] % 2 == 0, 1.0, -1.0)
        for total, part in zip(out, step, strict=True):
            _add(total, here, sign * part)
    scale = -b.homed * b.width_mm
    return scale * out[0], scale * out[1], scale * out[2]


def _add(total: F8, here: Index, part: F8) -> None:
    total[here] += part


def _smooth_step(t: F8, t1: float, t2: float) -> tuple[F8, F8, F8]:
    """A step averaged over t1 >= t2: from 0 to 1 in t1 + t2, with its derivatives."""
    peak = 1 / t1
    up, down = np.clip(t, 0, t2), np.clip(t - t1, 0, t2)
    cruise = np.clip(t - t2, 0, t1 - t2)
    s = peak * (up**2 / (2 * t2) + cruise + down - down**2 / (2 * t2))
    v = peak * (up / t2 - down / t2)
    a = peak / t2 * (((t >= 0) & (t < t2)).astype(float) - ((t >= t1) & (t < t1 + t2)).astype(float))
    return s, v, a
