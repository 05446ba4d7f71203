"""Point to point: one straight move from rest to rest, timed by ruckig along s.

One degree of freedom along the line is straight by construction; ruckig's own multi-axis synchronisation is not (its
phase synchronisation silently leaves the line where the axes' limits are uneven). ruckig is asked for nothing but
state to state; a closed form stands in where it refuses a move whose length is at the edge between two profiles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from planner.errors import PlanError
from planner.types import F8, I4, Event, Limits


@dataclass(frozen=True, slots=True, eq=False)
class Profile:
    """s(t) in K phases of constant jerk. begin_s: f8[K + 1], the last is the end; s, v, a: f8[K + 1]; j: f8[K]."""

    begin_s: F8
    s: F8
    v: F8
    a: F8
    j: F8


@dataclass(frozen=True, eq=False)
class PointTrajectory:
    """A straight move from ``start`` to ``end``, f8[A]; implements ``planner.types.Trajectory``."""

    axes: tuple[str, ...]
    start: F8
    end: F8
    profile: Profile
    source_line: int = 0
    events: Sequence[Event] = ()

    @property
    def duration_s(self) -> float:
        """Time of the end."""
        return float(self.profile.begin_s[-1])

    def q(self, t_s: F8) -> F8:
        """Positions f8[len(t), A], mm or degrees."""
        s, _, _ = self._state(t_s)
        return np.asarray(self.start + s[:, None] * self._tangent)

    def v(self, t_s: F8) -> F8:
        """Velocities f8[len(t), A], mm/s."""
        return np.asarray(self._state(t_s)[1][:, None] * self._tangent)

    def a(self, t_s: F8) -> F8:
        """Accelerations f8[len(t), A], mm/s2."""
        return np.asarray(self._state(t_s)[2][:, None] * self._tangent)

    def line(self, t_s: F8) -> I4:
        """Source line i4[len(t)]."""
        return np.full(np.size(t_s), self.source_line, dtype=np.int32)

    def junctions_s(self) -> F8:
        """Ascending times at which the jerk changes."""
        return np.unique(self.profile.begin_s)

    @property
    def _tangent(self) -> F8:
        length = float(np.linalg.norm(self.end - self.start))
        return np.asarray((self.end - self.start) / length) if length > 0 else np.zeros(len(self.start))

    def _state(self, t_s: F8) -> tuple[F8, F8, F8]:
        p = self.profile
        t = np.clip(np.atleast_1d(np.asarray(t_s, dtype=np.float64)), 0.0, self.duration_s)
        k = np.clip(np.searchsorted(p.begin_s, t, side="right") - 1, 0, len(p.j) - 1)
        d = t - p.begin_s[k]
        a = p.a[k] + p.j[k] * d
        v = p.v[k] + (p.a[k] + p.j[k] * d / 2) * d
        return p.s[k] + (p.v[k] + (p.a[k] / 2 + p.j[k] * d / 6) * d) * d, v, np.where(t >= self.duration_s, 0.0, a)


def point_to_point(start: F8, end: F8, limits: Limits, *, speed_mm_s: float = np.inf, line: int = 0) -> PointTrajectory:
    """The quickest straight move from rest to rest within the axes' limits (jerk limits too) and ``speed_mm_s``.

    For jogs, homing, probing and rapids that begin and end at rest. Raises PlanError on positions of the wrong length.
    """
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    if len(start) != len(limits.axes) or len(end) != len(limits.axes):
        raise PlanError(line, "", f"positions must have {len(limits.axes)} numbers")
    length = float(np.linalg.norm(end - start))
    if length < 1e-9:
        zero = np.zeros(2)
        return PointTrajectory(limits.axes, start, end, Profile(zero, zero, zero, zero, np.zeros(1)), line)
    share = np.maximum(np.abs(end - start) / length, 1e-12)
    speed = min(float((limits.velocity / share).min()), speed_mm_s)
    jerk = np.inf if limits.jerk is None else float((limits.jerk / share).min())
    profile = rest_to_rest(length, speed, float((limits.acceleration / share).min()), jerk)
    return PointTrajectory(limits.axes, start, end, profile, line)


def rest_to_rest(length: float, speed: float, acceleration: float, jerk: float = np.inf) -> Profile:
    """The quickest s(t) from 0 to ``length`` > 0, by ruckig; in closed form where ruckig fails."""
    found = _by_ruckig(length, speed, acceleration, jerk)
    return closed_form(length, speed, acceleration, jerk) if found is None else found


def _by_ruckig(length: float, speed: float, acceleration: float, jerk: float) -> Profile | None:
    from ruckig import InputParameter, Result, Ruckig, RuckigError, Trajectory

    wanted, found = InputParameter(1), Trajectory(1)
    wanted.target_position = [length]
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = [speed], [acceleration], [jerk]
    try:
        if Ruckig(1).calculate(wanted, found) != Result.Working:
            return None
    except RuckigError:
        return None
    phases = found.profiles[0][0]
    if not np.isfinite(jerk):
        return _accelerate_cruise_brake(np.array(phases.t), np.array(phases.a), length)
    begin = np.concatenate([[0.0], np.cumsum(phases.t)])
    return Profile(begin, np.array(phases.p), np.array(phases.v), np.array(phases.a), np.array(phases.j))


def _accelerate_cruise_brake(t: F8, a: F8, length: float) -> Profile:
    """Phases of constant acceleration: accelerations f8[K] (or more) held over times f8[K]."""
    used = np.flatnonzero(t > 0)
    t, a = t[used], a[used]
    v = np.concatenate([[0.0], np.cumsum(a * t)])
    s = np.concatenate([[0.0], np.cumsum((v[:-1] + v[1:]) / 2 * t)])
    s[-1] = length
    return Profile(np.concatenate([[0.0], np.cumsum(t)]), s, v, np.append(a, 0.0), np.zeros(len(t)))


def closed_form(length: float, speed: float, acceleration: float, jerk: float = np.inf) -> Profile:
    """The same in closed form: L. Biagiotti, C. Melchiorri, "Trajectory Planning for Automatic Machines", section
    3.4."""
    if not np.isfinite(jerk):
        peak = min(speed, float(np.sqrt(length * acceleration)))
        up, cruise = peak / acceleration, length / peak - peak / acceleration
        return _accelerate_cruise_brake(
            np.array([up, max(cruise, 0.0), up]), np.array([acceleration, 0.0, -acceleration]), length
        )
    rise = acceleration / jerk if speed * jerk >= acceleration**2 else float(np.sqrt(speed / jerk))
    ramp = rise + speed / (jerk * rise)
    cruise = length / speed - ramp
    if cruise < 0:
        cruise, rise = 0.0, acceleration / jerk
        ramp = rise / 2 + float(np.sqrt((rise / 2) ** 2 + length / acceleration))
        if ramp < 2 * rise:
            rise = float(np.cbrt(length / (2 * jerk)))
            ramp = 2 * rise
    hold = ramp - 2 * rise
    t = np.array([rise, hold, rise, cruise, rise, hold, rise])
    j = jerk * np.array([1.0, 0, -1, 0, -1, 0, 1])
    s, v, a = np.zeros(8), np.zeros(8), np.zeros(8)
    for k in range(7):
        a[k + 1] = a[k] + j[k] * t[k]
        v[k + 1] = v[k] + (a[k] + j[k] * t[k] / 2) * t[k]
        s[k + 1] = s[k] + (v[k] + (a[k] / 2 + j[k] * t[k] / 6) * t[k]) * t[k]
    return Profile(np.concatenate([[0.0], np.cumsum(t)]), s, v, a, j)
