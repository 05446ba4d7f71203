"""The trajectory: pieces of constant s'' over the interval arrays, exact at any time.

Inside a piece the distance from its interval's start is sigma = offset + v tau + u tau^2 / 2, and q = start + q'(in)
sigma + q'' sigma^2 / 2. Rest (dwell, tool change) is a piece of zero speed. Evaluation is one binary search and one
gather a sample; long sample trains go through a compiled walk.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from nmc.native import at_hand
from planner.timing import Pieces
from planner.types import F8, I4, Event, Index, Intervals

WALK_FROM = 20_000
"""Samples from which the compiled walk is worth its import; it says the same to the last bit."""


@dataclass(frozen=True, eq=False)
class PathTrajectory:
    """Piecewise-quadratic s(t) over interval arrays; implements ``planner.types.Trajectory``.

    axes: names, A. intervals: N >= 1. pieces: M >= 1. events: ascending in time. origin_s: time of the first piece, 0
    but for a trajectory whose past was forgotten. begin_s: f8[M], derived.
    """

    axes: tuple[str, ...]
    intervals: Intervals
    pieces: Pieces
    events: Sequence[Event] = ()
    origin_s: float = 0.0
    begin_s: F8 = field(init=False)
    duration_s: float = field(init=False)

    def __post_init__(self) -> None:
        end = self.origin_s + np.cumsum(self.pieces.duration_s)
        object.__setattr__(self, "begin_s", np.concatenate([[self.origin_s], end[:-1]]))
        object.__setattr__(self, "duration_s", float(end[-1]))

    def q(self, t_s: F8) -> F8:
        """Positions f8[len(t), A], mm or degrees, machine frame."""
        t = _times(t_s)
        p = self.intervals
        if len(t) >= WALK_FROM or at_hand():
            from planner.walk import sample_q

            return np.asarray(sample_q(t, self.begin_s, *self._columns()))
        i, sigma, _, _ = self.locate(t)
        bend = (p.tangent_out[i] - p.tangent_in[i]) * (sigma / (2 * p.length[i]))[:, None]
        return np.asarray(p.start[i] + (p.tangent_in[i] + bend) * sigma[:, None])

    def coordinate(self, t_s: F8, column: int) -> F8:
        """Positions f8[len(t)] of one axis: to the last bit a column of ``q``."""
        t = _times(t_s)
        if len(t) >= WALK_FROM or at_hand():
            return self.q(t)[:, column]
        p = self.intervals
        i, sigma, _, _ = self.locate(t)
        tangent = p.tangent_in[:, column][i]
        bend = (p.tangent_out[:, column][i] - tangent) * (sigma / (2 * p.length[i]))
        return np.asarray(p.start[:, column][i] + (tangent + bend) * sigma)

    def v(self, t_s: F8) -> F8:
        """Velocities f8[len(t), A], mm/s."""
        i, sigma, speed, _ = self.locate(_times(t_s))
        return np.asarray(self._tangent(i, sigma) * speed[:, None])

    def a(self, t_s: F8) -> F8:
        """Accelerations f8[len(t), A], mm/s2, one-sided from the right where they jump."""
        i, sigma, speed, accel = self.locate(_times(t_s))
        p = self.intervals
        bend = (p.tangent_out[i] - p.tangent_in[i]) / p.length[i][:, None]
        return np.asarray(self._tangent(i, sigma) * accel[:, None] + bend * (speed**2)[:, None])

    def line(self, t_s: F8) -> I4:
        """Source line i4[len(t)] that is being executed."""
        if len(t_s) == 1:  # a stream asks for one, some hundred times a second
            m = int(self.begin_s.searchsorted(t_s[0], side="right")) - 1
            interval = self.pieces.interval[min(max(m, 0), len(self.pieces) - 1)]
            return self.intervals.line[interval : interval + 1]
        return np.asarray(self.intervals.line[self.pieces.interval[self.piece(_times(t_s))]])

    def junctions_s(self) -> F8:
        """Ascending times at which a piece begins or ends."""
        return np.append(self.begin_s, self.duration_s)

    def piece(self, t: F8) -> Index:
        """The piece i8[len(t)] that runs at each time."""
        m = np.searchsorted(self.begin_s, t, side="right") - 1
        return np.asarray(np.clip(m, 0, len(self.pieces) - 1))

    def locate(self, t: F8) -> tuple[I4, F8, F8, F8]:
        """Interval, distance in it, s' and s'' at each time."""
        m = self.piece(t)
        w = self.pieces
        tau = np.clip(t - self.begin_s[m], 0.0, w.duration_s[m])
        i, v, u = w.interval[m], w.speed_mm_s[m], w.accel_mm_s2[m]
        sigma = np.minimum(w.offset_mm[m] + (v + u * (tau / 2)) * tau, self.intervals.length[i])
        return i, sigma, np.maximum(v + u * tau, 0.0), u

    def _tangent(self, i: I4, sigma: F8) -> F8:
        p = self.intervals
        return np.asarray(p.tangent_in[i] + (p.tangent_out[i] - p.tangent_in[i]) * (sigma / p.length[i])[:, None])

    def _columns(self) -> tuple[F8, I4, F8, F8, F8, F8, F8, F8, F8]:
        p, w = self.intervals, self.pieces
        return (
            w.duration_s, w.interval, w.offset_mm, w.speed_mm_s, w.accel_mm_s2,
            p.length, p.start, p.tangent_in, p.tangent_out,
        )  # fmt: skip

    def integrals(self) -> F8:
        """Integral of q from 0 to the beginning of each piece, f8[M, A]."""
        from planner.walk import piece_integrals

        return np.asarray(piece_integrals(*self._columns()))

    def integral(self, t: F8, sums: F8) -> F8:
        """Integral of q from 0 to each time, f8[len(t), A]; before 0 the axes rest. sums: of ``integrals``."""
        from planner.walk import sample_integral

        return np.asarray(sample_integral(t, self.begin_s, sums, *self._columns()))


def _times(t_s: F8) -> F8:
    return np.atleast_1d(np.asarray(t_s, dtype=np.float64))


def path_trajectory(
    axes: tuple[str, ...],
    intervals: Intervals,
    pieces: Pieces,
    events: Sequence[Event],
    start: F8,
    origin_s: float = 0.0,
) -> PathTrajectory:
    """A trajectory even of a program that never moves: then one interval of no length stands at ``start``."""
    if not len(intervals):
        flat = np.zeros((1, len(axes)))
        ends = np.ones(2, dtype=np.bool_)
        intervals = Intervals(np.ones(1), start[None, :], flat, flat, np.ones(1), np.zeros(1, np.int32), ends)
    if not len(pieces):
        zero = np.zeros(1)
        pieces = Pieces(zero, np.zeros(1, np.int32), zero, zero, zero)
    return PathTrajectory(axes, intervals, pieces, tuple(events), origin_s)
