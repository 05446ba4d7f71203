"""Twins: a chip that obeys the data sheet stays between the fastest and the slowest twin, whatever is unknown."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nmc.budget import Window
from nmc.twin import StepTimer, StepTimerTwin


@dataclass
class Chip:
    """The chip of section 4.1, stepped one roll-over at a time with its own clock error."""

    ppm: float
    next_ns: float = 0.0
    period_ns: float = 0.0
    left: int = 0

    def scaled(self, period_ns: int) -> float:
        return period_ns * (1.0 + self.ppm * 1e-6)

    def start(self, at_ns: float, period_ns: int, steps: int) -> None:
        self.period_ns, self.left = self.scaled(period_ns), steps
        self.next_ns = at_ns + self.period_ns

    def advance(self, now_ns: float) -> None:
        while self.left and self.next_ns <= now_ns:
            self.left -= 1
            self.next_ns += self.period_ns

    def load(self, at_ns: float, period_ns: int) -> None:
        self.advance(at_ns)
        self.period_ns = self.scaled(period_ns)


def certain(earliest_ns: int, latest_ns: int) -> Window:
    return Window(earliest_ns, latest_ns, earliest_ns)


def test_nominal_timer_follows_the_sheet() -> None:
    timer = StepTimer()
    timer.start(1_000, 500, 4)
    assert timer.advance(1_499) == 0
    assert timer.advance(1_500) == 1  # first step one period after the start
    timer.advance(1_700)
    timer.period_ns = 200  # loaded in mid-period: the running period ends at 2000 all the same
    assert (timer.next_ns, timer.left) == (2_000, 3)
    assert timer.arrival_ns() == 2_400
    assert timer.advance(10_000) == 3
    assert timer.left == 0


@settings(max_examples=3 * settings.default.max_examples)
@given(st.integers(0, 2**32 - 1))
def test_real_chip_lies_between_the_bounds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chip, twin = Chip(rng.uniform(-100, 100)), StepTimerTwin(100)
    width = int(rng.integers(0, 2_500_000))
    now, steps = 0, int(rng.integers(5, 4_000))
    period = int(rng.integers(80_000, 8_000_000))
    chip.start(now + rng.uniform(0, width), period, steps)
    twin.start(certain(now, now + width), period, steps)
    for _ in range(int(rng.integers(1, 40))):
        now += int(rng.integers(1_000_000, 12_000_000))
        if not twin.surely_moving_until_ns() > now + width + 100_000:
            break
        period = int(np.clip(period * rng.uniform(0.4, 2.5), 80_000, 20_000_000))
        chip.load(now + rng.uniform(0, width), period)
        assert chip.left > 0
        twin.load(certain(now, now + width), period)
    arrival = chip.next_ns + (chip.left - 1) * chip.period_ns
    assert twin.surely_moving_until_ns() <= arrival <= twin.surely_stopped_from_ns()


@settings(max_examples=3 * settings.default.max_examples)
@given(st.integers(0, 2**32 - 1))
def test_latched_positions_never_exclude_the_real_chip(seed: int) -> None:
    rng = np.random.default_rng(seed)
    chip, twin = Chip(rng.uniform(-100, 100)), StepTimerTwin(100)
    width = int(rng.integers(0, 1_500_000))
    now, steps = 0, int(rng.integers(50, 4_000))
    period = int(rng.integers(80_000, 4_000_000))
    chip.start(now + rng.uniform(0, width), period, steps)
    twin.start(certain(now, now + width), period, steps)
    seen = None
    for _ in range(int(rng.integers(1, 40))):
        now += int(rng.integers(3_000_000, 12_000_000))
        if not twin.surely_moving_until_ns() > now + width + 100_000:
            break
        at = now + rng.uniform(0, width)
        if rng.random() < 0.3:
            chip.advance(at)
            twin.latch(certain(now, now + width))
            seen = steps - chip.left
            continue
        period = int(np.clip(period * rng.uniform(0.5, 2.0), 80_000, 8_000_000))
        chip.load(at, period)
        twin.load(certain(now, now + width), period)
        if seen is not None and rng.random() < 0.5:
            assert twin.latched(seen)
            seen = None
    arrival = chip.next_ns + (chip.left - 1) * chip.period_ns
    assert twin.surely_moving_until_ns() <= arrival <= twin.surely_stopped_from_ns()


def test_a_position_that_no_chip_of_the_sheet_can_have_is_told() -> None:
    twin = StepTimerTwin(100)
    twin.start(certain(0, 250_000), 1_000_000, 100)
    twin.latch(certain(50_000_000, 50_250_000))
    assert not twin.latched(55)


def test_a_latch_narrows_the_bounds() -> None:
    twin = StepTimerTwin(100)
    twin.start(certain(0, 3_000_000), 1_000_000, 100)
    wide = twin.surely_stopped_from_ns() - twin.surely_moving_until_ns()
    twin.latch(certain(50_000_000, 50_100_000))
    assert twin.latched(49)
    assert twin.surely_stopped_from_ns() - twin.surely_moving_until_ns() < wide / 2


def test_bounds_meet_when_nothing_is_unknown() -> None:
    twin = StepTimerTwin(0)
    twin.start(certain(0, 0), 100_000, 10)
    assert twin.surely_moving_until_ns() == pytest.approx(1_000_000, abs=20)
    assert twin.surely_stopped_from_ns() == pytest.approx(1_000_000, abs=20)
    assert twin.done(550_000) == 5
