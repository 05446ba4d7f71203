"""Trajectories in closed form for the tests of streaming."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from planner.types import F8, I4, Event


class ClosedForm:
    """A trajectory from a vectorised function t -> q[N, A]; line number 1 + whole seconds."""

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
    ramp_s = speed / acceleration
    cruise_s = distance / speed - ramp_s
    assert cruise_s >= 0.0
    up = 0.5 * acceleration * np.clip(t, 0.0, ramp_s) ** 2
    flat = speed * np.clip(t - ramp_s, 0.0, cruise_s)
    late = np.clip(t - ramp_s - cruise_s, 0.0, ramp_s)
    return up + flat + speed * late - 0.5 * acceleration * late**2


def ramp_s(distance: float, speed: float, acceleration: float) -> float:
    """Duration of that trapezoid."""
    return distance / speed + speed / acceleration


def circle(radius_mm: float, feed_mm_s: float, tangential_mm_s2: float = 300.0) -> ClosedForm:
    """One full circle in XY from rest to rest, Z standing."""
    length = 2.0 * np.pi * radius_mm

    def q(t: F8) -> F8:
        angle = ramp(t, length, feed_mm_s, tangential_mm_s2) / radius_mm
        return np.stack((radius_mm * (1.0 - np.cos(angle)), radius_mm * np.sin(angle), np.zeros_like(angle)), axis=1)

    return ClosedForm(("X", "Y", "Z"), ramp_s(length, feed_mm_s, tangential_mm_s2), q)


def line(end_mm: tuple[float, ...], feed_mm_s: float, acceleration_mm_s2: float = 300.0) -> ClosedForm:
    """A straight line from the origin, rest to rest."""
    end = np.array(end_mm)
    length = float(np.linalg.norm(end))

    def q(t: F8) -> F8:
        return np.outer(ramp(t, length, feed_mm_s, acceleration_mm_s2) / length, end)

    return ClosedForm(("X", "Y", "Z")[: len(end_mm)], ramp_s(length, feed_mm_s, acceleration_mm_s2), q)
