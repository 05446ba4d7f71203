"""Where each joint next reverses or comes to rest: from the path alone, ahead of timing.

A joint's share of the tangent is piecewise linear along the path, so its direction changes where that share crosses
zero inside a parabola, at a node, or at a stop. Streaming loads this position with the first count of a monotone run,
long before the run's timing is known. After a jerk filter the extreme lies a little inside; ``turns_in_time`` finds
it on the trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.types import F8, I4, Intervals, Trajectory

STILL = 1e-9
"""share of the tangent below which a joint stands still."""


@dataclass(frozen=True, slots=True, eq=False)
class Turns:
    """Ends of the monotone runs of one joint, in the order of the path.

    interval: i4[K], offset_mm: f8[K], where on the path. position: f8[K], of the joint. reverses: bool[K], it goes
    back at once; else it rests there (a stop of the path, or other joints go on alone).
    """

    interval: I4
    offset_mm: F8
    position: F8
    reverses: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.interval)

    def next(self, interval: int, offset_mm: float) -> int | None:
        """Number of the first turn at or after a place on the path; None if the path has no further one."""
        k = int(np.searchsorted(self.interval, interval, side="left"))
        while k < len(self) and self.interval[k] == interval and self.offset_mm[k] < offset_mm:
            k += 1
        return k if k < len(self) else None


def turns_of(p: Intervals, row: F8) -> Turns:
    """The turns of the joint ``row`` f8[A] (joint = row . q) along ``p``. An end of ``p`` that is no stop is no
    turn."""
    n = len(p)
    t0, t1 = p.tangent_in @ row, p.tangent_out @ row
    t0, t1 = np.where(np.abs(t0) < STILL, 0.0, t0), np.where(np.abs(t1) < STILL, 0.0, t1)
    crosses = t0 * t1 < 0
    count = 1 + crosses
    last = np.cumsum(count) - 1
    direction = np.empty(int(count.sum()) if n else 0)
    direction[last] = np.sign(np.where(crosses, t1, t0 + t1))
    direction[last[crosses] - 1] = np.sign(t0[crosses])
    of = np.repeat(np.arange(n, dtype=np.int32), count)
    with np.errstate(divide="ignore", invalid="ignore"):
        zero = np.where(crosses, -t0 * p.length / (t1 - t0), p.length)
    offset = p.length[of].copy()
    offset[last[crosses] - 1] = zero[crosses]
    stop = np.zeros(len(direction), dtype=np.bool_)
    stop[last] = p.stop[1:]
    following = np.append(direction[1:], direction[-1:])
    ends = (direction != 0) & ((following != direction) | stop)
    if len(ends):
        ends[-1] = direction[-1] != 0 and bool(stop[-1])
    k = np.flatnonzero(ends)
    i, sigma = of[k], offset[k]
    bend = (p.tangent_out[i] - p.tangent_in[i]) * (sigma / (2 * p.length[i]))[:, None]
    position = (p.start[i] + (p.tangent_in[i] + bend) * sigma[:, None]) @ row
    return Turns(i, sigma, position, (following[k] == -direction[k]) & ~stop[k])


def turns_in_time(trajectory: Trajectory, row: F8, from_s: float, to_s: float) -> tuple[F8, F8]:
    """Times f8[K] at which the joint ``row`` changes its direction between two times, and its positions there f8[K].

    Exact on any trajectory: between two junctions the velocity is a smooth polynomial, looked at in eight places.
    """
    j = trajectory.junctions_s()
    knots = np.unique(np.concatenate([[from_s], j[(j > from_s) & (j < to_s)], [to_s]]))
    steps = np.arange(8) / 8
    t = np.append((knots[:-1, None] + np.diff(knots)[:, None] * steps).ravel(), to_s)
    v = trajectory.v(t) @ row
    moving = np.flatnonzero(np.abs(v) > STILL)
    change = np.flatnonzero(np.sign(v[moving][1:]) != np.sign(v[moving][:-1]))
    low, high = t[moving][change], t[moving][change + 1]
    sign = np.sign(v[moving][change])
    for _ in range(60):
        middle = (low + high) / 2
        before = np.sign(trajectory.v(middle) @ row) == sign if len(middle) else np.zeros(0, dtype=np.bool_)
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    return low, trajectory.q(low) @ row if len(low) else np.zeros(0)
