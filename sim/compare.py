"""The verdict: what came out of the pins against what was planned and what was programmed.

Two errors, never mixed: ``contour`` is the distance of the pins from the planned path, ``program`` their distance from
the programmed path (at most tolerance + contour). Both are taken after every single pulse, within a window of time, so
that a path which crosses itself is compared with its own stretch. ``lag`` is how late the pins are along the path and
is no shape error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sim.lag import MOVING_UNITS_S, WINDOW_S, Lags, lags_of
from sim.pulses import F8, Pins, StepRuns, pins

I8 = npt.NDArray[np.int64]
FOLLOW_AHEAD_MM = 0.5
LOST_MM = 0.1
END_ROWS = 4096
"""Pins that are looked at together, from the end back."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The plan to compare with: t_s f8[N], q f8[N, A], line i4[N]; ``programmed``: the polyline f8[M, A] asked for."""

    axes: tuple[str, ...]
    t_s: F8
    q: F8
    line: npt.NDArray[np.int32]
    programmed: F8 | None = None


@dataclass(frozen=True, slots=True)
class Spread:
    """Largest value, 99.9 % quantile and root mean square."""

    max: float
    p999: float
    rms: float


@dataclass(frozen=True, slots=True)
class Contour:
    """Result of ``compare``. Lengths in um, steps of each motor; times in s and ms."""

    sim_time_s: float
    contour_um: Spread
    contour_steps: Spread
    program_um: float
    lag_ms_max: float
    lag_ms_rms: float
    end_error_steps: dict[str, int]
    worst_line: int
    worst_time_s: float
    lags: Lags


def compare(
    reference: Reference,
    runs: StepRuns,
    motors: tuple[str, ...],
    motor_axis: tuple[str, ...],
    steps_per_unit: F8,
    plan_start_ns: int,
) -> Contour:
    """Compare the pulses of steppers with the plan; see ``compare_pins``."""
    return compare_pins(reference, pins(runs), motors, motor_axis, steps_per_unit, plan_start_ns)


def compare_pins(
    reference: Reference,
    out: Pins,
    motors: tuple[str, ...],
    motor_axis: tuple[str, ...],
    per_unit: F8,
    plan_start_ns: int,
) -> Contour:
    """Compare where the motors stood with where the plan wanted them.

    motors: names in the order of the columns of ``out``; motor_axis: the planned axis each follows; per_unit
    f8[motors]: steps or counts per unit, signed. plan_start_ns: trace time of the plan's t = 0. What came before that,
    such as a servo finding its place, is not judged.
    """
    column = [reference.axes.index(axis) for axis in motor_axis]
    planned = reference.q[:, column]
    knots = planned * per_unit
    first = int(np.searchsorted(out.time_ns, plan_start_ns))
    every = out
    out = Pins(out.time_ns[first:], out.position[first:], out.straight)
    time_s = (out.time_ns - plan_start_ns) * 1e-9
    wanted = np.floor(knots[-1] + 0.5).astype(np.int64)
    if not len(time_s):
        zero = Spread(0.0, 0.0, 0.0)
        start = np.floor(knots[0] + 0.5).astype(np.int64)
        missing = {name: int(start[m] - wanted[m]) for m, name in enumerate(motors)}
        nothing = np.zeros(len(motors))
        none = Lags(motors, nothing, nothing, np.zeros(0, np.int32), np.zeros(0), np.zeros((0, len(motors))))
        return Contour(float(reference.t_s[-1]), zero, zero, 0.0, 0.0, 0.0, missing, 0, 0.0, none)
    end_error = {name: round(float(out.position[-1, m])) - int(wanted[m]) for m, name in enumerate(motors)}
    window = _window(time_s, reference.t_s)
    in_steps, nearest_s = _distance(out.position, time_s, window, reference.t_s, knots)
    stood = out.position / per_unit
    scales = np.abs(per_unit)
    if (scales == scales[0]).all():
        in_units = in_steps / scales[0]
    else:
        in_units, _ = _distance(stood, time_s, window, reference.t_s, planned)
    worst = int(np.argmax(in_steps))
    moving = _moving(reference, time_s)
    lag_s, nearest_s = (time_s - nearest_s)[moving], nearest_s[moving]
    lag = lag_s * 1e3
    at = min(int(np.searchsorted(reference.t_s, time_s[worst])), len(reference.line) - 1)
    return Contour(
        sim_time_s=_sim_time(out, time_s, reference, knots),
        contour_um=_spread(in_units * 1e3),
        contour_steps=_spread(in_steps),
        program_um=_program_error(stood, time_s, window, reference, column) * 1e3,
        lag_ms_max=float(np.max(np.abs(lag), initial=0.0)),
        lag_ms_rms=float(np.sqrt(np.mean(lag**2))) if len(lag) else 0.0,
        end_error_steps=end_error,
        worst_line=int(reference.line[at]),
        worst_time_s=float(time_s[worst]),
        lags=lags_of(every, plan_start_ns, motors, reference.t_s, knots, per_unit, reference.line, (lag_s, nearest_s)),
    )


def _window(time_s: F8, knots_s: F8) -> tuple[I8, I8]:
    """Of every instant the knots at which its window of the plan begins and ends; found once, for they are many."""
    from sim.compare_kernel import places

    return places(knots_s, time_s - WINDOW_S), places(knots_s, time_s + WINDOW_S)


def _distance(position: F8, time_s: F8, window: tuple[I8, I8], knots_s: F8, knots: F8) -> tuple[F8, F8]:
    from sim.compare_kernel import distances

    first = np.maximum(window[0] - 1, 0)
    last = np.minimum(window[1] + 1, len(knots_s) - 1)
    first = np.minimum(first, last - 1)
    distance, nearest_s = distances(time_s, position, first, last, knots_s, np.ascontiguousarray(knots))
    return distance, nearest_s


def _program_error(position: F8, time_s: F8, window: tuple[I8, I8], reference: Reference, column: list[int]) -> float:
    """Largest distance of the pins from the programmed polyline, in units; 0 if none was given."""
    if reference.programmed is None or len(reference.programmed) < 2:
        return 0.0
    from sim.compare_kernel import follow, greatest_distance

    polyline = np.ascontiguousarray(reference.programmed[:, column])
    segment = follow(np.ascontiguousarray(reference.q[:, column]), polyline, FOLLOW_AHEAD_MM, LOST_MM)
    lower = np.clip(window[0] - 1, 0, len(segment) - 1)
    upper = np.clip(window[1], 0, len(segment) - 1)
    index_s = np.arange(len(polyline), dtype=np.float64)
    return float(greatest_distance(time_s, position, segment[lower], segment[upper] + 1, index_s, polyline))


def _moving(reference: Reference, time_s: F8) -> npt.NDArray[np.bool_]:
    from sim.compare_kernel import places

    span = np.maximum(np.diff(reference.t_s), 1e-12)
    speed = np.linalg.norm(np.diff(reference.q, axis=0), axis=1) / span
    at = np.clip(places(reference.t_s, time_s) - 1, 0, len(speed) - 1)
    result: npt.NDArray[np.bool_] = speed[at] > MOVING_UNITS_S
    return result


def _sim_time(out: Pins, time_s: F8, reference: Reference, knots: F8) -> float:
    """Until the pins stand, plus the rest that the plan prescribes after its own last step."""
    planned_last = _last_step_s(reference.t_s, knots)
    stands = time_s[min(_last_elsewhere(out.position) + 1, len(time_s) - 1)]
    return float(stands + reference.t_s[-1] - planned_last)


def _last_elsewhere(position: F8) -> int:
    """Number of the last row that is not yet at the end, to the step; -1 if all are. Looked for from the end."""
    end = len(position)
    while end:
        begin = max(end - END_ROWS, 0)
        short = np.flatnonzero(np.any(np.rint(position[begin:end]) != np.rint(position[-1]), axis=1))
        if len(short):
            return begin + int(short[-1])
        end = begin
    return -1


def _last_step_s(t_s: F8, knots: F8) -> float:
    """When the plan passes the middle before its last step; 0 if it never leaves its place."""
    last = 0.0
    for place in np.moveaxis(knots, 1, 0):
        level = np.floor(place + 0.5)
        away = np.flatnonzero(level != level[-1])
        if len(away):
            k = int(away[-1])
            middle = level[-1] + (0.5 if level[k] > level[-1] else -0.5)
            share = (middle - place[k]) / (place[k + 1] - place[k])
            last = max(last, float(t_s[k] + share * (t_s[k + 1] - t_s[k])))
    return last


def _spread(values: F8) -> Spread:
    return Spread(float(values.max()), float(np.quantile(values, 0.999)), float(np.sqrt(np.mean(values**2))))
