"""A CY545 axis as the planner sees it: what it may do, which F, R and S keep within that, how long a move takes.

The chip makes a move by itself, from stop to stop, along a ramp of its rate table (CY545 manual, chapters 5 and 17):

    rate                 R  .--------------------.        one table entry every (256 - S) x 256 us x 12/Fcy;
                       ..--'                      '--..   a step takes the rate that holds when it begins;
                F  .--'                                '--.   the way down is the way up, reversed
                   +----------------------------------------+ t

so the time of a move is a sum over at most 255 entries, the same whole nanoseconds as the chip's, and exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from nmc.chips import cy545 as facts
from nmc.chips.cy545 import RateTable
from planner.errors import PlanError
from planner.quantize import NS_PER_S
from planner.types import F8

I8 = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Indexer:
    """A stepper on a CY545.

    axis: planned axis that it is. bus: number of its line. steps_per_unit: signed, steps/mm or steps/deg. velocity,
    acceleration: limits in units and s; pull_in_velocity: what the motor starts at without a ramp. before_s, after_s:
    rests of the whole machine around a move, for the commands and for the confirmation.
    """

    axis: str
    bus: int
    steps_per_unit: float
    rates: RateTable
    velocity: float
    acceleration: float
    pull_in_velocity: float = 0.0
    crystal_mhz: float = facts.TABLE_CRYSTAL_MHZ
    before_s: float = 0.15
    after_s: float = 0.15

    @property
    def name(self) -> str:
        """Of the motor: an indexer is its axis's only one."""
        return self.axis

    def rate_hz(self, index: int) -> float:
        """Steps/s of a table entry at this crystal."""
        return self.rates.rate_hz(index, self.crystal_mhz)


@dataclass(frozen=True, slots=True)
class RampSettings:
    """F, R and S as the chip is told them."""

    first: int
    rate: int
    slope: int


@dataclass(frozen=True, eq=False)
class StepProfile:
    """The steps of one move in runs: period_ns i8[K], count i8[K]; step k of a run begins k periods after the run."""

    period_ns: I8
    count: I8

    @cached_property
    def begin_ns(self) -> I8:
        """Begin of each run and the end of the last, i8[K + 1]."""
        return np.concatenate([[0], np.cumsum(self.period_ns * self.count)]).astype(np.int64)

    @cached_property
    def begin_steps(self) -> I8:
        """Steps made before each run and at the end, i8[K + 1]."""
        return np.concatenate([[0], np.cumsum(self.count)]).astype(np.int64)

    @property
    def duration_ns(self) -> int:
        """From the first step to the end of the last step's period, when the chip is ready again."""
        return int(self.begin_ns[-1])

    def steps(self, t_s: F8) -> F8:
        """Steps made at each time, straight between two steps, f8[len(t)]."""
        ns = np.clip(np.asarray(t_s) * NS_PER_S, 0.0, float(self.begin_ns[-1]))
        return np.asarray(np.interp(ns, self.begin_ns, self.begin_steps))

    def rate_hz(self, t_s: F8) -> F8:
        """Step rate at each time, zero outside the move."""
        ns = np.asarray(t_s) * NS_PER_S
        run = np.clip(np.searchsorted(self.begin_ns, ns, side="right") - 1, 0, len(self.count) - 1)
        inside = (ns >= 0) & (ns < self.begin_ns[-1])
        return np.where(inside, NS_PER_S / self.period_ns[run], 0.0)


def choose(indexer: Indexer, line: int = 0, feed: float | None = None) -> RampSettings:
    """The fastest F, R and S within the axis's limits, and within ``feed`` (units/s) if one is given.

    Raises PlanError where even the table's slowest rate or ramp is too much for the axis.
    """
    scale = abs(indexer.steps_per_unit)
    fastest = min(indexer.velocity, feed if feed is not None else np.inf) * scale
    rate = _index_below(indexer, fastest)
    if rate < facts.RATE_MIN:
        slowest = indexer.rate_hz(facts.RATE_MIN) / scale
        words = f"axis {indexer.axis} cannot go as slowly as {fastest / scale:g} a second on a CY545"
        raise PlanError(line, indexer.axis, words, f"its slowest rate is {slowest:.4g} a second")
    first = min(max(_index_below(indexer, indexer.pull_in_velocity * scale), facts.RATE_MIN), rate)
    slope = _steepest(indexer, first, rate, line)
    return RampSettings(first, rate, slope)


def profile(indexer: Indexer, settings: RampSettings, steps: int) -> StepProfile:
    """The runs of a move of ``steps`` >= 1 steps."""
    first, top = min(settings.first, settings.rate), settings.rate
    index = np.arange(first, top)
    period = np.array([indexer.rates.period_ns(int(k), indexer.crystal_mhz) for k in range(first, top + 1)], np.int64)
    count = _climbing(period[:-1], facts.ramp_entry_ns(settings.slope, indexer.crystal_mhz))
    half = steps // 2
    cruise = steps - 2 * int(count.sum())
    if cruise < 0:  # a partial ramp: it turns round in its middle
        before = np.concatenate([[0], np.cumsum(count)[:-1]])
        middle = int(np.searchsorted(np.cumsum(count), half, side="right"))
        count = np.clip(half - before, 0, count)
        cruise = steps - 2 * half
        top_period = period[middle]
    else:
        top_period = period[len(index)]
    periods = np.concatenate([period[:-1], [top_period], period[:-1][::-1]])
    counts = np.concatenate([count, [cruise], count[::-1]])
    used = counts > 0
    return StepProfile(periods[used], counts[used])


def _climbing(period: I8, entry_ns: int) -> I8:
    """Steps on each entry of the way up: those that begin before the entry's time is over."""
    count = np.zeros(len(period), np.int64)
    at = 0
    for k, step in enumerate(period.tolist()):
        count[k] = max(0, -(-((k + 1) * entry_ns - at) // step))
        at += int(count[k]) * step
    return count


def _index_below(indexer: Indexer, steps_s: float) -> int:
    """The fastest entry that is not above ``steps_s``; -1 if all are."""
    scaled = np.array(indexer.rates.steps_per_s) * indexer.crystal_mhz / facts.TABLE_CRYSTAL_MHZ
    return int(np.searchsorted(scaled, steps_s * (1 + 1e-9), side="right")) - 1


def _steepest(indexer: Indexer, first: int, rate: int, line: int) -> int:
    """The steepest slope whose ramp from ``first`` to ``rate`` keeps the acceleration limit."""
    if first == rate:
        return facts.SLOPE_MAX
    rates = np.array([indexer.rate_hz(k) for k in range(first, rate + 1)])
    allowed = indexer.acceleration * abs(indexer.steps_per_unit)
    shortest_ns = float(np.diff(rates).max()) / allowed * NS_PER_S
    unit_ns = facts.RAMP_UNIT_NS * facts.TABLE_CRYSTAL_MHZ / indexer.crystal_mhz
    slope = min(int(256 - np.ceil(shortest_ns / unit_ns - 1e-9)), facts.SLOPE_MAX)
    if slope < facts.SLOPE_MIN:
        least = float(np.diff(rates).max()) / (facts.ramp_entry_ns(1, indexer.crystal_mhz) / NS_PER_S)
        words = f"axis {indexer.axis} may accelerate at {indexer.acceleration:g}, less than a CY545's gentlest ramp"
        hint = f"up to its velocity that needs {least / abs(indexer.steps_per_unit):.4g}; lower max_velocity"
        raise PlanError(line, indexer.axis, words, hint)
    return slope
