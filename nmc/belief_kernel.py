"""Compiled: the possible chips of ``nmc.belief``, advanced, loaded, weighed and averaged.

``s`` is f8[5, CHIPS], one column a possible chip, rows by the names below, times in ns. A chip that is not told
otherwise makes its next step at NEXT and then one every PERIOD; the period that ends at NEXT is RUNNING (a count acts
at the next roll-over: PIC-STEP data sheet, section 4.1).

Chance is spread evenly, not drawn: number i of a set takes the quantile (i m mod CHIPS + 1/2) / CHIPS, where m is
another power of a primitive root each time, so that every quantile occurs once and no two sets run together.

Choices are made by selecting, not by branching, and sums are taken over what a first loop has laid out: so the compiler
does several chips at once, and the sums keep their order.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nmc.native import native

F8 = npt.NDArray[np.float64]

CHIPS, ROOT = 97, 5
"""A prime, and a primitive root of it."""
NEXT, RUNNING, PERIOD, LEFT, RATE = 0, 1, 2, 3, 4
ROWS = 5
NEVER = 1e18
LOST = 1e-3
"""If less than this share of the chips agrees with what was read, something unforeseen has happened."""
SHRINK = 0.92
STIR = 0.4
"""Second copies of a chip are spread by this share of the deviation of all, for they could not differ otherwise; before
that their crystals are drawn to the mean (Liu and West, Combined parameter and state estimation in simulation-based
filtering, 2001: 1 - SHRINK^2 is nearly STIR^2)."""
STIR_MAX_NS, LEAST_RATE = 20_000.0, 1e-7
STRAY_MIN_NS = 100_000.0
"""Chips that agree with nothing that was read are moved by what they are off and up to as much again, at least
up to this and at most by a period."""
RISK = 0.5
"""What the worst case counts beside the mean."""
SMALL_STEPS = 1.0
"""No load is too risky that leaves every chip within this."""
UNIFORM = math.sqrt(12.0)
SPREAD = (np.arange(CHIPS) * 7 % CHIPS + 0.5) / CHIPS - 0.5
"""Quantiles about the middle, for what has not happened yet."""


@native("f8(i8, i8)", inline=True)
def quantile(chip: int, multiplier: int) -> float:
    """The share of the set that lies below this chip."""
    return (chip * multiplier % CHIPS + 0.5) / CHIPS


@native("void(f8[:, ::1], i8, f8, f8, f8, f8, b1)", exact=True)
def begin(s: F8, m: int, first_ns: float, last_ns: float, period_ns: float, steps: float, at_once: bool) -> None:
    """A run from rest, begun somewhere between two instants; ``at_once``: with its first step."""
    for i in range(CHIPS):
        period = period_ns * (1.0 + s[RATE, i])
        start_ns = first_ns + quantile(i, m) * (last_ns - first_ns)
        s[NEXT, i] = start_ns if at_once else start_ns + period
        s[RUNNING, i] = s[PERIOD, i] = period
        s[LEFT, i] = steps


@native("UniTuple(f8, 3)(f8, f8, f8, f8, f8)", inline=True)
def ahead(next_ns: float, running: float, period: float, left: float, at_ns: float) -> tuple[float, float, float]:
    """(next step, period that ends there, steps left) of a chip at an instant to come."""
    stays = at_ns < next_ns or left <= 0.0
    made = 0.0 if stays else min(np.floor((at_ns - next_ns) / period) + 1.0, left)
    return next_ns + made * period, running if stays else period, left - made


@native("f8(f8, f8, f8, f8, f8)", inline=True)
def to_go(next_ns: float, running: float, period: float, left: float, at_ns: float) -> float:
    """Steps left at an instant to come, with the part of the running period that is not over."""
    next_ns, running, left = ahead(next_ns, running, period, left, at_ns)
    return 0.0 if left <= 0.0 else left - 1.0 + min(max((next_ns - at_ns) / running, 0.0), 1.0)


@native("void(f8[:, ::1], i8, f8, f8, f8)", exact=True)
def load(s: F8, m: int, first_ns: float, last_ns: float, period_ns: float) -> None:
    """A count was executed somewhere between two instants."""
    for i in range(CHIPS):
        at_ns = first_ns + quantile(i, m) * (last_ns - first_ns)
        s[NEXT, i], s[RUNNING, i], s[LEFT, i] = ahead(s[NEXT, i], s[RUNNING, i], s[PERIOD, i], s[LEFT, i], at_ns)
        s[PERIOD, i] = period_ns * (1.0 + s[RATE, i])


@native("UniTuple(f8, 3)(f8[:, ::1], f8, f8)", exact=True)
def mean(s: F8, at_ns: float, steps: float) -> tuple[float, float, float]:
    """(next step, period after it, steps left) of the chip that is where the chips are on average at an instant."""
    sum_to_go = sum_running = sum_period = most = 0.0
    for i in range(CHIPS):
        next_ns, running, left = ahead(s[NEXT, i], s[RUNNING, i], s[PERIOD, i], s[LEFT, i], at_ns)
        if left > 0.0:
            sum_to_go += (next_ns - at_ns) / running + left - 1.0
        sum_running += running
        sum_period += s[PERIOD, i]
        most = max(most, left)
    on_average, running = sum_to_go / CHIPS, sum_running / CHIPS
    left = min(math.floor(on_average) + 1.0, steps) if most > 0.0 else 0.0
    return at_ns + (on_average - (left - 1.0)) * running, sum_period / CHIPS, left


@native("f8(f8[:, ::1], f8)", exact=True)
def step_spread(s: F8, left: float) -> float:
    """Standard deviation of the instant at which ``left`` steps have become one less, in ns; no load comes before."""
    total = squares = 0.0
    base_ns = s[NEXT, 0]
    for i in range(CHIPS):
        arrival_ns = s[NEXT, i] + (s[LEFT, i] - left) * s[PERIOD, i] - base_ns
        total += arrival_ns
        squares += arrival_ns * arrival_ns
    return math.sqrt(max(squares / CHIPS - (total / CHIPS) ** 2, 0.0))


@native("f8(f8[:, ::1], f8)", exact=True)
def spread(s: F8, at_ns: float) -> float:
    """Standard deviation of the steps left at an instant to come."""
    total = squares = 0.0
    base = s[LEFT, 0]
    for i in range(CHIPS):
        off = to_go(s[NEXT, i], s[RUNNING, i], s[PERIOD, i], s[LEFT, i], at_ns) - base
        total += off
        squares += off * off
    return math.sqrt(max(squares / CHIPS - (total / CHIPS) ** 2, 0.0))


@native("UniTuple(f8, 2)(f8[:, ::1], f8, f8, f8, f8, f8)", exact=True)
def errors(
    s: F8, execute_ns: float, width_ns: float, target_ns: float, wanted: float, period_ns: float
) -> tuple[float, float]:
    """Distance in steps from ``wanted`` steps to go at the target, over all chips: as things are, and with a load.

    Root mean square; of the load, the worst case counts as well: it would be executed within ``width_ns`` around
    ``execute_ns``, and chips that roll over in there take it a period sooner or later than the others.
    """
    offs = np.empty((2, CHIPS))
    for i in range(CHIPS):
        next_ns, running, period, left = s[NEXT, i], s[RUNNING, i], s[PERIOD, i], s[LEFT, i]
        offs[0, i] = to_go(next_ns, running, period, left, target_ns) - wanted
        next_ns, running, left = ahead(next_ns, running, period, left, execute_ns + SPREAD[i] * width_ns)
        offs[1, i] = to_go(next_ns, running, period_ns * (1.0 + s[RATE, i]), left, target_ns) - wanted
    without = with_load = most = most_with = 0.0
    for i in range(CHIPS):
        without += offs[0, i] * offs[0, i]
        most = max(most, abs(offs[0, i]))
        with_load += offs[1, i] * offs[1, i]
        most_with = max(most_with, abs(offs[1, i]))
    risk = RISK * max(most_with - max(most, SMALL_STEPS), 0.0)
    return math.sqrt(without / CHIPS), math.sqrt(with_load / CHIPS) + risk


@native("UniTuple(f8, 2)(f8[:, ::1], i8, f8, f8)", inline=True)
def standing(s: F8, i: int, left: float, steps: float) -> tuple[float, float]:
    """From when till when chip i has ``left`` steps to go."""
    begin_ns, end_ns = -NEVER, NEVER
    if left > 0.0:
        beyond = left - s[LEFT, i]
        end_ns = s[NEXT, i] - (beyond * s[RUNNING, i] if beyond > 0.0 else beyond * s[PERIOD, i])
    if left < steps:
        beyond = left + 1.0 - s[LEFT, i]
        begin_ns = s[NEXT, i] - (beyond * s[RUNNING, i] if beyond > 0.0 else beyond * s[PERIOD, i])
    return begin_ns, end_ns


@native()
def _moved(s: F8, then: F8, m: int, first_ns: float, last_ns: float, left: float, steps: float) -> None:
    for i in range(CHIPS):
        begin_ns, end_ns = standing(then, i, left, steps)
        off_ns = max(first_ns - end_ns, 0.0) - max(begin_ns - last_ns, 0.0)
        if off_ns != 0.0:
            further_ns = min(max(abs(off_ns), STRAY_MIN_NS), s[RUNNING, i]) * quantile(i, m)
            off_ns += math.copysign(further_ns, off_ns)
        missed = max(np.floor(off_ns / s[RUNNING, i]), 0.0)  # whole steps that were not made
        s[NEXT, i] += off_ns - missed * s[RUNNING, i]
        s[LEFT, i] += missed


@native()
def _stir(s: F8, i: int, m: int, rate: float, rate_deviation: float, deviation_ns: float) -> None:
    before = 1.0 + s[RATE, i]
    noise = STIR * UNIFORM * (rate_deviation + LEAST_RATE)
    s[RATE, i] = rate + SHRINK * (s[RATE, i] - rate) + noise * (quantile(i, m) - 0.5)
    s[PERIOD, i] *= (1.0 + s[RATE, i]) / before
    width_ns = UNIFORM * min(STIR * deviation_ns, STIR_MAX_NS)
    s[NEXT, i] += (quantile(i, m * ROOT % CHIPS) - 0.5) * width_ns


@native("b1(f8[:, ::1], f8[:, ::1], i8, f8, f8, f8, f8)", exact=True)
def weigh(s: F8, then: F8, m: int, first_ns: float, last_ns: float, left: float, steps: float) -> bool:
    """Somewhere between two instants the chip had ``left`` steps to go; ``then``: the chips as they were known then.

    Chips that agree with more of that time are copied, others go. False if hardly any agrees: then each is moved until
    it does, and a little more, for what is nearest to what was thought is still the likeliest.
    """
    share = np.empty(CHIPS)
    total = 0.0
    for i in range(CHIPS):
        begin_ns, end_ns = standing(then, i, left, steps)
        total += max(min(last_ns, end_ns) - max(first_ns, begin_ns), 0.0)
        share[i] = total
    if total <= LOST * (last_ns - first_ns) * CHIPS:
        _moved(s, then, m, first_ns, last_ns, left, steps)
        return False
    kept = s.copy()
    rate, rate_deviation = np.mean(s[RATE]), np.std(s[RATE])
    deviation_ns = step_spread(s, np.min(s[LEFT]))
    taken, before = 0, -1
    for i in range(CHIPS):
        while share[taken] < (i + 0.5) / CHIPS * total and taken < CHIPS - 1:
            taken += 1
        s[:, i] = kept[:, taken]
        if taken == before:
            _stir(s, i, m, rate, rate_deviation, deviation_ns)
        before = taken
    return True
