"""Trajectories in closed form, for the benchmark and the tests of streaming: no interpreter and no planner needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from planner.timing import Rate
from planner.types import F8, I4, Event


class ClosedForm:
    """A trajectory from a vectorised function t -> q[N, A]; its line number is 1 + whole seconds."""

    def __init__(self, axes: tuple[str, ...], duration_s: float, function: Callable[[F8], F8]) -> None:
        self.axes = axes
        self.duration_s = duration_s
        self.events: Sequence[Event] = ()
        self._function = function

    def q(self, t_s: F8) -> F8:
        return self._function(np.clip(t_s, 0.0, self.duration_s))

    def v(self, t_s: F8) -> F8:
        return (self.q(t_s + 1e-6) - self.q(t_s - 1e-6)) / 2e-6

    def a(self, t_s: F8) -> F8:
        return (self.v(t_s + 1e-5) - self.v(t_s - 1e-5)) / 2e-5

    def line(self, t_s: F8) -> I4:
        return (1 + np.floor(np.clip(t_s, 0.0, self.duration_s))).astype(np.int32)

    def junctions_s(self) -> F8:
        return np.array([0.0, self.duration_s])


def ramp(t: F8, distance: float, speed: float, acceleration: float) -> F8:
    """Distance along a trapezoid from rest to rest."""
    ramp_time = speed / acceleration
    cruise = distance / speed - ramp_time
    assert cruise >= 0.0
    up = 0.5 * acceleration * np.clip(t, 0.0, ramp_time) ** 2
    late = np.clip(t - ramp_time - cruise, 0.0, ramp_time)
    return up + speed * np.clip(t - ramp_time, 0.0, cruise) + speed * late - 0.5 * acceleration * late**2


def ramp_s(distance: float, speed: float, acceleration: float) -> float:
    """Duration of that trapezoid."""
    return distance / speed + speed / acceleration


def along(axes: tuple[str, ...], length: float, feed: float, point: Callable[[F8], F8]) -> ClosedForm:
    """A path point(s) travelled from rest to rest with a tangential acceleration of 300 mm/s2."""
    return ClosedForm(axes, ramp_s(length, feed, 300.0), lambda t: point(ramp(t, length, feed, 300.0)))


def circle(radius_mm: float, feed_mm_s: float) -> ClosedForm:
    """One full circle in XY from the origin; Z stands."""

    def point(s: F8) -> F8:
        angle = s / radius_mm
        return np.stack((radius_mm * (1.0 - np.cos(angle)), radius_mm * np.sin(angle), np.zeros_like(s)), axis=1)

    return along(("X", "Y", "Z"), 2.0 * np.pi * radius_mm, feed_mm_s, point)


def helix(radius_mm: float, rise_mm: float, turns: float, feed_mm_s: float) -> ClosedForm:
    """A circle in XY from the origin while Z rises by ``rise_mm`` each turn; the feed is along the helix."""
    slope = np.hypot(2.0 * np.pi * radius_mm, rise_mm)

    def point(s: F8) -> F8:
        angle = 2.0 * np.pi * s / slope
        circle_xy = (radius_mm * (1.0 - np.cos(angle)), radius_mm * np.sin(angle))
        return np.stack((*circle_xy, rise_mm * s / slope), axis=1)

    return along(("X", "Y", "Z"), turns * slope, feed_mm_s, point)


def line(end_mm: tuple[float, ...], feed_mm_s: float) -> ClosedForm:
    """A straight line from the origin."""
    end = np.array(end_mm)
    length = float(np.linalg.norm(end))
    return along(("X", "Y", "Z")[: len(end_mm)], length, feed_mm_s, lambda s: np.outer(s / length, end))


def rounded_square(side_mm: float, radius_mm: float, feed_mm_s: float) -> ClosedForm:
    """A square with corners of the given radius, once around, from the middle of a side."""
    straight, quarter = side_mm - 2.0 * radius_mm, 0.5 * np.pi * radius_mm
    period = straight + quarter

    def point(s: F8) -> F8:
        shifted = s + straight / 2.0
        side = np.floor(shifted / period)
        u = shifted - side * period
        angle = np.clip(u - straight, 0.0, quarter) / radius_mm
        x = np.minimum(u, straight) - straight / 2.0 + radius_mm * np.sin(angle)
        y = -side_mm / 2.0 + radius_mm * (1.0 - np.cos(angle))
        turn = side * np.pi / 2.0
        xy = np.stack((x * np.cos(turn) - y * np.sin(turn), x * np.sin(turn) + y * np.cos(turn)), axis=1)
        return np.column_stack((xy - np.array([0.0, -side_mm / 2.0]), np.zeros(len(s))))

    return along(("X", "Y", "Z"), 4.0 * period, feed_mm_s, point)


def random_path(seed: int, feed_mm_s: float, axes: int = 3, duration_s: float = 8.0) -> ClosedForm:
    """A smooth random path: tangential 300, centripetal 500 mm/s2, every axis within 60 mm/s and 500 mm/s2.

    A cubic spline through random points, travelled as fast as these limits allow; cut where ``duration_s`` is reached
    (the path then ends at rest at that place).
    """
    rng = np.random.default_rng([seed, axes, int(feed_mm_s)])
    knots = int(8 + feed_mm_s * duration_s / 9.0)
    points = np.cumsum(rng.normal(0.0, 6.0, (knots, axes)), axis=0)
    points -= points[0]
    chord = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    spline = CubicSpline(chord, points)
    u = np.linspace(0.0, chord[-1], 40 * knots + 1)
    fine = spline(u)
    s = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))))
    path = CubicSpline(s, fine)
    reach = min(s[-1], feed_mm_s * duration_s)
    for _ in range(2):
        trajectory, total = _timed(path, reach, feed_mm_s, axes)
        reach *= min(duration_s / total, 1.0)
    return trajectory


def _timed(path: CubicSpline, reach: float, feed_mm_s: float, axes: int) -> tuple[ClosedForm, float]:
    s = np.linspace(0.0, reach, int(reach / 0.005) + 2)
    step = s[1] - s[0]
    tangent, curve = path(s, 1), path(s, 2)
    least = np.minimum(500.0 / np.maximum(np.linalg.norm(curve, axis=1), 1e-9), feed_mm_s**2)
    least = np.minimum(least, np.min((60.0 / np.maximum(np.abs(tangent), 1e-9)) ** 2, axis=1))
    least = np.minimum(least, np.min((500.0 - 300.0 * np.abs(tangent)) / np.maximum(np.abs(curve), 1e-9), axis=1))
    least[0] = least[-1] = 0.0
    x = least.copy()
    for i in range(1, len(x)):
        x[i] = min(x[i], x[i - 1] + 600.0 * step)
    for i in range(len(x) - 2, -1, -1):
        x[i] = min(x[i], x[i + 1] + 600.0 * step)
    v = np.sqrt(x)
    t = np.concatenate(([0.0], np.cumsum(2.0 * step / (v[1:] + v[:-1]))))
    acceleration = np.diff(x) / (2.0 * step)

    def q(time: F8) -> F8:
        i = np.clip(np.searchsorted(t, time, side="right") - 1, 0, len(acceleration) - 1)
        tau = time - t[i]
        return path(np.minimum(s[i] + v[i] * tau + 0.5 * acceleration[i] * tau**2, reach))

    names = ("X", "Y", "Z", "A", "B", "C", "U", "V")[:axes]
    return ClosedForm(names, float(t[-1]), q), float(t[-1])


@dataclass(frozen=True)
class Resting:
    """When a hold comes to rest."""

    time_s: float


class Warped:
    """A closed form whose time can be stretched: hold and resume with 300 mm/s2 along the path at the given feed."""

    def __init__(self, base: ClosedForm, feed_mm_s: float) -> None:
        self.base = base
        self.axes = base.axes
        self.events: Sequence[Event] = ()
        self._rate_per_s = 300.0 / feed_mm_s
        self._pieces = [(0.0, 0.0, 1.0, 0.0)]  # from, base time, rate, change of rate
        self._held_s: float | None = None

    @property
    def duration_s(self) -> float:
        """End of the path, or the rest of a hold."""
        if self._held_s is not None:
            return self._held_s
        begin, tau, rate, _ = self._pieces[-1]
        return begin + (self.base.duration_s - tau) / rate

    def hold(self, sent_s: float) -> Resting:
        """Slow down to rest from ``sent_s`` on."""
        self._forget(sent_s)
        rate = self._state(sent_s)[1]
        self._append(sent_s, -self._rate_per_s)
        self._held_s = sent_s + rate / self._rate_per_s
        self._append(self._held_s, 0.0, rate=0.0)
        return Resting(self._held_s)

    def resume(self, sent_s: float) -> None:
        """Speed up to the full rate from ``sent_s`` on."""
        self._held_s = None
        self._forget(sent_s)
        rate = self._state(sent_s)[1]
        self._append(sent_s, self._rate_per_s)
        self._append(sent_s + (1.0 - rate) / self._rate_per_s, 0.0, rate=1.0)

    def override(self, sent_s: float, rate: Rate) -> None:
        """Go over to a feed override from ``sent_s`` on."""
        self._forget(sent_s)
        now = self._state(sent_s)[1]
        change = self._rate_per_s if rate.feed > now else -self._rate_per_s
        self._append(sent_s, change)
        self._append(sent_s + (rate.feed - now) / change, 0.0, rate=rate.feed)

    def _forget(self, after_s: float) -> None:
        """Drop what an earlier request has foreseen for later."""
        self._pieces = [self._pieces[0], *(piece for piece in self._pieces[1:] if piece[0] <= after_s)]

    def _append(self, at_s: float, change: float, rate: float | None = None) -> None:
        tau, now = self._state(at_s)
        self._pieces.append((at_s, tau, now if rate is None else rate, change))

    def _state(self, at_s: float) -> tuple[float, float]:
        begin, tau, rate, change = self._pieces[-1]
        u = at_s - begin
        return tau + rate * u + 0.5 * change * u * u, rate + change * u

    def _base_time(self, t_s: F8) -> F8:
        begins = np.array([piece[0] for piece in self._pieces])
        t = np.clip(t_s, 0.0, self.duration_s)
        piece = np.array(self._pieces)[np.clip(np.searchsorted(begins, t, side="right") - 1, 0, len(begins) - 1)]
        u = t - piece[:, 0]
        return piece[:, 1] + piece[:, 2] * u + 0.5 * piece[:, 3] * u * u

    def q(self, t_s: F8) -> F8:
        return self.base.q(self._base_time(t_s))

    def v(self, t_s: F8) -> F8:
        return (self.q(t_s + 1e-6) - self.q(t_s - 1e-6)) / 2e-6

    def a(self, t_s: F8) -> F8:
        return (self.v(t_s + 1e-5) - self.v(t_s - 1e-5)) / 2e-5

    def line(self, t_s: F8) -> I4:
        return self.base.line(self._base_time(t_s))

    def junctions_s(self) -> F8:
        return np.array([piece[0] for piece in self._pieces] + [self.duration_s])
