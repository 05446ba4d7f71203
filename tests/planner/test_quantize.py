"""Timer arithmetic against the figures that the PIC-STEP data sheet prints, and crossings against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner import quantize as z


@pytest.mark.parametrize(
    ("mode", "rate_hz", "count"),
    [(8, 50_000, 65_452), (1, 25, 40_538), (1, 6_250, 65_438), (8, 1_600, 62_427)],
)
def test_counts_of_the_sheets_formula(mode: int, rate_hz: int, count: int) -> None:
    # Section 4.1: count = 65536 - f/S + {2, 4, 8, 16} with f = 625 kHz x mode.
    assert 65536 - 625_000 * mode / rate_hz + 2 * mode == pytest.approx(count, abs=0.5)
    assert z.count_of_period(round(1e9 / rate_hz), mode) == count


@pytest.mark.parametrize(
    ("mode", "least_hz", "greatest_hz"),
    [(1, 9.537, 7267), (2, 19.07, 14205), (4, 38.14, 27174), (8, 76.28, 50000)],
)
def test_range_of_each_speed_mode(mode: int, least_hz: float, greatest_hz: float) -> None:
    shortest, longest = z.period_range_ns(mode)
    assert 1e9 / shortest == pytest.approx(greatest_hz, rel=1e-3)
    assert 1e9 / longest == pytest.approx(least_hz, rel=1e-3)


@given(st.integers(1, 65_452), st.sampled_from(z.SPEED_MODES))
def test_count_and_period_are_inverse(count: int, mode: int) -> None:
    assert z.count_of_period(z.period_of_count_ns(count, mode), mode) == count


@given(st.integers(0, 10**12), st.sampled_from(z.SPEED_MODES))
def test_any_period_gives_a_legal_count(period_ns: int, mode: int) -> None:
    assert 1 <= z.count_of_period(period_ns, mode) <= 65_452


def test_lowest_mode_that_reaches_a_rate() -> None:
    assert [z.speed_mode_for(rate) for rate in (4_000, 12_000, 20_000, 45_000, 49_000)] == [1, 2, 4, 8, 8]
    with pytest.raises(ValueError, match="50000 steps/s"):
        z.speed_mode_for(50_100)


def test_nearest_speed_is_the_integer_profile_speed() -> None:
    # Table 3: speed 250 is 6250 steps/s in 1x and 50 000 in 8x.
    assert z.nearest_speed(160_000, 1) == 250
    assert z.nearest_speed(20_000, 8) == 250
    assert z.nearest_speed(10**9, 1) == 1


def test_crossings_of_a_constant_speed() -> None:
    t = np.linspace(0.0, 1.0, 11)
    time, direction, level = z.step_crossings(t, 5.0 * t)
    assert time == pytest.approx([0.1, 0.3, 0.5, 0.7, 0.9])
    assert direction.tolist() == [1] * 5
    assert level.tolist() == [1, 2, 3, 4, 5]


@given(st.lists(st.floats(-50, 50), min_size=2, max_size=40))
def test_crossings_count_every_step(positions: list[float]) -> None:
    p = np.array(positions)
    _, direction, level = z.step_crossings(np.arange(len(p), dtype=float), p)
    rounded = np.floor(p + 0.5)
    assert direction.sum() == rounded[-1] - rounded[0]
    assert np.abs(np.diff(rounded)).sum() == len(direction)
    if len(level):
        assert level[-1] == rounded[-1]
