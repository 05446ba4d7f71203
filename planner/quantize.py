"""The only place where floats become integers: millimetres to steps, seconds to timer counts.

Timer arithmetic (PIC-STEP data sheet, section 4.1): in speed mode m the timer runs at m x 625 kHz and

    period = (65536 - count + 2 m) ticks,    1 <= count <= 65452,

the 2 m ticks being the same 3.2 us of reloading in every mode.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planner.types import F8

I8 = npt.NDArray[np.int64]

TICK_NS_1X = 1600
COUNT_MIN, COUNT_MAX = 1, 65452
SPEED_MODES = (1, 2, 4, 8)
SPEED_UNIT_HZ_1X = 25
SPEED_MAX = 250
NS_PER_S = 1_000_000_000
SPEED_HEADROOM = 1.1
"""A mode is chosen so that the axis can still catch up by a tenth at its greatest rate."""


def tick_ns(speed_mode: int) -> int:
    """Duration of one timer tick: 1600, 800, 400 or 200 ns."""
    return TICK_NS_1X // speed_mode


def period_of_count_ns(count: int, speed_mode: int) -> int:
    """Step period of an initial timer count."""
    return (65536 - count + 2 * speed_mode) * tick_ns(speed_mode)


def count_of_period(period_ns: int, speed_mode: int) -> int:
    """Nearest initial timer count to ``period_ns``, clamped to what the chip allows."""
    ticks = (period_ns + tick_ns(speed_mode) // 2) // tick_ns(speed_mode)
    return min(max(65536 + 2 * speed_mode - ticks, COUNT_MIN), COUNT_MAX)


def nearest_speed(period_ns: int, speed_mode: int) -> int:
    """Integer profile speed nearest to a period: the third byte of a timer count (section 5.1, Load Trajectory)."""
    speed = round(NS_PER_S / (period_ns * SPEED_UNIT_HZ_1X * speed_mode))
    return min(max(speed, 1), SPEED_MAX)


def period_range_ns(speed_mode: int) -> tuple[int, int]:
    """Shortest and longest step period of a speed mode."""
    return period_of_count_ns(COUNT_MAX, speed_mode), period_of_count_ns(COUNT_MIN, speed_mode)


def speed_mode_for(rate_max_hz: float) -> int:
    """Lowest speed mode that reaches ``rate_max_hz`` steps/s with headroom; low modes also run slowest.

    Raises:
        ValueError: the rate is beyond the chip's 50 000 steps/s.
    """
    for mode in SPEED_MODES:
        shortest, _ = period_range_ns(mode)
        if rate_max_hz * SPEED_HEADROOM <= NS_PER_S / shortest:
            return mode
    shortest, _ = period_range_ns(SPEED_MODES[-1])
    if rate_max_hz <= NS_PER_S / shortest:
        return SPEED_MODES[-1]
    raise ValueError(f"{rate_max_hz:.0f} steps/s is more than the chip's {NS_PER_S / shortest:.0f} steps/s")


def nearest_step(position_units: float, steps_per_unit: float) -> int:
    """The step nearest to a position."""
    return int(np.floor(position_units * steps_per_unit + 0.5))


def step_crossings(t_s: F8, position_steps: F8) -> tuple[F8, I8, I8]:
    """Instants at which a sampled position passes the middle between two steps.

    Args:
        t_s: f8[N], ascending. position_steps: f8[N], in steps, taken as straight between samples.

    Returns:
        time_s f8[K], direction i8[K] (+1 or -1), level i8[K] = position of the counter after the step.
    """
    level = np.floor(position_steps + 0.5).astype(np.int64)
    change = np.diff(level)
    at = np.flatnonzero(change)
    count = np.abs(change[at])
    direction = np.repeat(np.sign(change[at]), count)
    index = np.repeat(at, count)
    first = np.repeat(np.cumsum(count) - count, count)
    after = level[index] + direction * (np.arange(len(index)) - first + 1)
    middle = after - 0.5 * direction
    p0, p1 = position_steps[index], position_steps[index + 1]
    fraction = np.clip((middle - p0) / (p1 - p0), 0.0, 1.0)
    return t_s[index] + fraction * (t_s[index + 1] - t_s[index]), direction.astype(np.int64), after
