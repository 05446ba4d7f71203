"""The records of the planner: limits, interval arrays, trajectory.

A path is a chain of N intervals, each a straight line or a parabola: q' is linear in s and q'' constant inside an
interval, so an axis acceleration q' s'' + q'' s'^2 with constant s'' is linear in s and checking both interval ends is
exact. A = number of planned axes, N = intervals, M = pieces of constant s''.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from gcode.canon import Command

F8 = npt.NDArray[np.float64]
I4 = npt.NDArray[np.int32]
Index = npt.NDArray[np.intp]


def nobody_asks() -> None:
    """Called between bounded pieces of longer work where nobody watches whether it goes on."""


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """What the axes may do, in mm and s (degrees on rotary axes).

    axes: names, a subset of XYZABCUVW in that order. velocity, acceleration: f8[A], > 0. jerk: f8[A] or None (no
    filter). tolerance_mm: the machine's default of G64 P. velocity_jump: f8[A] or None, mm/s by which an axis may
    change its velocity at once in a corner (the pull-in rate of a stepper); not used together with a jerk filter.
    """

    axes: tuple[str, ...]
    velocity: F8
    acceleration: F8
    tolerance_mm: float
    jerk: F8 | None = None
    velocity_jump: F8 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Intervals:
    """The interval arrays: the interface that every timing solver shares.

    length: f8[N], > 0, mm of path. start: f8[N, A], q at the interval's start. tangent_in, tangent_out: f8[N, A], q'
    just inside its two ends (equal on a line). feed_mm_s: f8[N], cap on s' (inf: none). line: i4[N]. stop: bool[N +
    1], nodes at which s' must be zero; the first and the last are always True. bound_mm_s: f8[N] or None, cap on s'
    that no override raises (the jerk filter's share of the tolerance). corner_mm_s: f8[N + 1] or None, cap on s' at
    nodes where q' jumps (inf elsewhere).
    """

    length: F8
    start: F8
    tangent_in: F8
    tangent_out: F8
    feed_mm_s: F8
    line: I4
    stop: npt.NDArray[np.bool_]
    bound_mm_s: F8 | None = None
    corner_mm_s: F8 | None = None

    def __len__(self) -> int:
        return len(self.length)


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happens at ``time_s`` of the trajectory, while all axes rest.

    Only a ``Message``, a synchronised ``Output`` and a switch of the feed override (``Text``) do not wait for rest.
    """

    time_s: float
    command: Command


class Trajectory(Protocol):
    """q(t) of all axes over [0, duration_s], exact at any time; t outside is clamped.

    Implementations: piecewise quadratic s(t) over interval arrays, and the same after a jerk filter.
    """

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the planned axes."""

    @property
    def duration_s(self) -> float:
        """Time of the end."""

    @property
    def events(self) -> Sequence[Event]:
        """What happens on the way, ascending in time."""

    def q(self, t_s: F8) -> F8:
        """Positions f8[len(t), A], mm or degrees, machine frame."""

    def v(self, t_s: F8) -> F8:
        """Velocities f8[len(t), A], mm/s."""

    def a(self, t_s: F8) -> F8:
        """Accelerations f8[len(t), A], mm/s2, one-sided from the right where they jump."""

    def line(self, t_s: F8) -> I4:
        """Source line i4[len(t)] that is being executed."""

    def junctions_s(self) -> F8:
        """Ascending times at which a piece begins or ends."""


@runtime_checkable
class Coordinates(Protocol):
    """A trajectory that tells one coordinate for less than all of them."""

    def coordinate(self, t_s: F8, column: int) -> F8:
        """Positions f8[len(t)] of the axis of that number: to the last bit that column of ``Trajectory.q``."""
