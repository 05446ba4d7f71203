"""Compiled search: when the plan of one axis passes a place, of all times the one nearest to a given time."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nmc.native import native

F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]


@native()
def _crossing_s(place: float, way: float, i: int, knots_s: F8, knots: F8, m: int, time_s: float) -> float:
    """When segment ``i`` is at ``place``, going ``way`` (0: either); nan if it never is. At rest: nearest to time_s."""
    begin, end = float(knots[i, m]), float(knots[i + 1, m])
    if place < min(begin, end) or place > max(begin, end) or (end - begin) * way < 0:
        return math.nan
    begin_s, end_s = float(knots_s[i]), float(knots_s[i + 1])
    if begin == end:
        return min(max(time_s, begin_s), end_s)
    return begin_s + (place - begin) / (end - begin) * (end_s - begin_s)


@native()
def _passing(
    now: float, place: float, way: float, at: int, knots_s: F8, knots: F8, m: int, window_s: float
) -> tuple[float, int]:
    """(time, segment) at which the plan passes ``place``, nearest to ``now``, which lies in segment ``at``; or nan."""
    best, best_s, found = window_s, math.nan, at
    i = at
    while i >= 0 and now - knots_s[i + 1] < best:
        when = _crossing_s(place, way, i, knots_s, knots, m, now)
        if abs(now - when) <= best:
            best, best_s, found = abs(now - when), when, i
        i -= 1
    i = at + 1
    while i < len(knots_s) - 1 and knots_s[i] - now < best:
        when = _crossing_s(place, way, i, knots_s, knots, m, now)
        if abs(now - when) < best:
            best, best_s, found = abs(now - when), when, i
        i += 1
    return best_s, found


@native("Tuple((f8, f8))(f8[::1], f8[:, ::1], i8, f8, f8, f8[::1], f8[:, ::1], i8[::1], f8[:, ::1], f8)")
def motor_lag(
    time_s: F8,
    pins: F8,
    m: int,
    every_s: float,
    slowest: float,
    knots_s: F8,
    knots: F8,
    lines: I8,
    by_line: F8,
    window_s: float,
) -> tuple[float, float]:
    """Greatest lag and root mean square of motor ``m``, s without sign; ``by_line`` f8[L, M]: greatest a line.

    time_s f8[K] ascending, those below 0 are not judged; pins f8[K, M]; every_s: how often a motor is looked at that
    moves straight from place to place, 0 for one that is looked at when it steps, half a step short of its new place;
    slowest: units of the pins a second. knots_s f8[N], knots f8[N, M]: the plan, lines i8[N]: which line each belongs
    to; window_s of it is looked at either way.

    No lag is where the plan of the axis moves no faster than ``slowest`` at that time, nor where it does not pass the
    place in the window. More than a step at once is no pulse: the motor has slipped.
    """
    segments = len(knots_s) - 1
    greatest, squares, count, at, next_s = 0.0, 0.0, 0, 0, 0.0
    for k in range(len(time_s)):
        now, place, way = time_s[k], pins[k, m], 0.0
        if now < 0.0 or now > knots_s[segments]:
            continue
        if every_s > 0.0:
            if now < next_s:
                continue
            next_s = now + every_s
        else:
            way = place - pins[k - 1, m] if k > 0 else 0.0
            if abs(way) != 1.0:
                continue
            place -= 0.5 * way
        while at < segments - 1 and knots_s[at + 1] <= now:
            at += 1
        if abs(knots[at + 1, m] - knots[at, m]) <= slowest * (knots_s[at + 1] - knots_s[at]):
            continue
        when, found = _passing(now, place, way, at, knots_s, knots, m, window_s)
        if math.isnan(when):
            continue
        lag = abs(now - when)
        greatest = max(greatest, lag)
        squares += lag * lag
        count += 1
        by_line[lines[found], m] = max(by_line[lines[found], m], lag)
    return greatest, math.sqrt(squares / count) if count else 0.0


@native("void(f8[::1], f8[::1], f8[::1], i8[::1], f8[::1])")
def path_lag_by_line(lag_s: F8, nearest_s: F8, knots_s: F8, lines: I8, by_line: F8) -> None:
    """Greatest lag in each line, s without sign, into ``by_line`` f8[L].

    lag_s, nearest_s f8[J]: of each pin, and where on the plan it is nearest; knots_s f8[N], lines i8[N]: the plan.
    """
    at, segments = 0, len(knots_s) - 1
    for k in range(len(lag_s)):
        while at > 0 and knots_s[at] >= nearest_s[k]:
            at -= 1
        while at < segments - 1 and knots_s[at + 1] < nearest_s[k]:
            at += 1
        by_line[lines[at]] = max(by_line[lines[at]], abs(lag_s[k]))
