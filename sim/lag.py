"""Lag, apart from shape: how late each motor is along its own axis, and how late the pins are in each line.

place                       the plan of one axis passes a place at p, its motor at t: its lag is t - p, whatever
  |         .-- plan        the other axes do. A place that the plan does not pass at about that time is an error
  |      . /                of shape, and no lag at all.
  |----p--t---- motor
  +---------------- time
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from sim.pulses import F8, Pins

WINDOW_S = 0.12
"""How far from its own time a pin is looked for on the plan."""
EVERY_S = 0.0005
"""A motor that moves straight between its places is looked at as often as its chip serves it, not when others step."""
MOVING_UNITS_S = 0.5
"""Lag is counted only where the plan moves faster than this; at rest every instant is as near as any other."""


@dataclass(frozen=True, slots=True, eq=False)
class Lags:
    """Lag of M motors and in L lines, ms, without sign; 0 where nothing moved.

    motors: names; max_ms, rms_ms f8[M]: of each along its own axis; lines i4[L]: ascending; path_ms f8[L]: greatest lag
    along the path in each line; motor_ms f8[L, M]: greatest lag of each motor in each line.
    """

    motors: tuple[str, ...]
    max_ms: F8
    rms_ms: F8
    lines: npt.NDArray[np.int32]
    path_ms: F8
    motor_ms: F8

    def __eq__(self, other: object) -> bool:
        """Whether every figure is the same."""
        return isinstance(other, Lags) and all(
            np.array_equal(getattr(self, field.name), getattr(other, field.name)) for field in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


def lags_of(
    out: Pins,
    plan_start_ns: int,
    motors: tuple[str, ...],
    knots_s: F8,
    knots: F8,
    per_unit: F8,
    line: npt.NDArray[np.int32],
    path: tuple[F8, F8],
) -> Lags:
    """Lag of every motor, and in every line.

    out: all places; those before ``plan_start_ns`` are not judged. knots_s f8[N], knots f8[N, M]: the plan in steps or
    counts, per_unit f8[M] of them a unit; line i4[N]: of each knot. path: along the path lag f8[J], s, and the nearest
    times f8[J] on the plan, s, of the pins that count.
    """
    from sim.lag_kernel import motor_lag, path_lag_by_line

    numbers, place = np.unique(line, return_inverse=True)
    place = place.astype(np.int64)
    along, by_motor = np.zeros(len(numbers)), np.zeros((len(numbers), len(motors)))
    path_lag_by_line(path[0], path[1], knots_s, place, along)
    time_s = (out.time_ns - plan_start_ns) * 1e-9
    position, knots = np.ascontiguousarray(out.position), np.ascontiguousarray(knots)
    found = np.array([
        motor_lag(
            time_s, position, m, EVERY_S if m in out.straight else 0.0, MOVING_UNITS_S * abs(float(per_unit[m])),
            knots_s, knots, place, by_motor, WINDOW_S,
        )
        for m in range(len(motors))
    ])  # fmt: skip
    return Lags(motors, 1e3 * found[:, 0], 1e3 * found[:, 1], numbers, 1e3 * along, 1e3 * by_motor)
