"""The planner's closed form against the simulated chip: every move's time and place."""

import numpy as np
import pytest

from machines.cy545rates import read_rates
from nmc.chips import cy545 as facts
from nmc.cy545 import Cy545
from planner.cy545 import Indexer, RampSettings, choose, profile
from planner.errors import PlanError
from sim.cy545_host import TextHost

RATES = read_rates("stand-in")


def indexer(**other: float) -> Indexer:
    keys = {"steps_per_unit": 40.0, "velocity": 90.0, "acceleration": 400.0, "pull_in_velocity": 8.0} | other
    return Indexer(axis="A", bus=1, rates=RATES, **keys)  # type: ignore[arg-type]


@pytest.mark.parametrize("crystal_mhz", [12.0, 11.0592, 16.0])
def test_two_hundred_random_moves_take_the_predicted_time_and_end_on_their_step(crystal_mhz: float) -> None:
    rng = np.random.default_rng(545)
    axis = indexer(crystal_mhz=crystal_mhz)
    host = TextHost(RATES, crystal_mhz=crystal_mhz, host_jitter_max_ns=200_000, start_delay_max_ns=250_000)
    driver = Cy545(host.link, host.link)
    driver.start_up()
    worst = 0.0
    for _ in range(200):
        slow, fast = sorted(int(index) for index in rng.integers(1, 256, 2))
        settings = RampSettings(slow, fast, int(rng.integers(100, 256)))
        steps = int(np.exp(rng.uniform(0, np.log(60_000)))) * (1 if rng.random() < 0.5 else -1)
        predicted = profile(axis, settings, abs(steps))
        assert predicted.begin_steps[-1] == abs(steps)
        driver.set_rates(settings.first, settings.rate, settings.slope)
        before = len(host.chip.runs)
        driver.move_to(driver.position + steps, predicted.duration_ns)
        assert host.chip.mechanical == driver.position
        first, period, count, _ = (column[before:] for column in host.chip.runs.read())
        taken_ns = int(first[-1] + period[-1] * count[-1] - first[0])
        last_period_ns = int(period[-1])
        worst = max(worst, abs(taken_ns - predicted.duration_ns) / last_period_ns)
    assert worst <= 1
    assert host.sim.violations == []


def test_a_chip_with_a_wrong_crystal_differs_by_that_alone() -> None:
    host = TextHost(RATES, crystal_ppm=100)
    driver = Cy545(host.link, host.link)
    driver.start_up()
    settings = RampSettings(14, 100, 220)
    predicted = profile(indexer(), settings, 30_000)
    driver.set_rates(14, 100, 220)
    driver.move_to(30_000, predicted.duration_ns)
    pulses = host.pulses_s()
    nominal = predicted.duration_ns - int(predicted.period_ns[-1])
    assert (pulses[-1] - pulses[0]) * 1e9 == pytest.approx(nominal / 1.0001, abs=50)


def test_every_step_of_a_move_comes_when_the_closed_form_says() -> None:
    host = TextHost(RATES)
    host.do("F 20", "R 130", "S 200", "N 5001", "+", "G")
    predicted = profile(indexer(), RampSettings(20, 130, 200), 5001)
    k = np.arange(5001)
    run = np.searchsorted(predicted.begin_steps, k, side="right") - 1
    wanted = predicted.begin_ns[run] + (k - predicted.begin_steps[run]) * predicted.period_ns[run]
    pulses_ns = np.rint(host.pulses_s() * 1e9)
    assert np.abs(pulses_ns - pulses_ns[0] - wanted).max() <= 1


def test_the_choice_is_the_fastest_within_the_axis_limits() -> None:
    axis = indexer()
    chosen = choose(axis)
    assert axis.rate_hz(chosen.rate) <= 90 * 40 < axis.rate_hz(chosen.rate + 1)
    assert axis.rate_hz(chosen.first) <= 8 * 40 < axis.rate_hz(chosen.first + 1)
    rates = np.array([axis.rate_hz(k) for k in range(chosen.first, chosen.rate + 1)])
    entry_s = facts.ramp_entry_ns(chosen.slope) * 1e-9
    assert np.diff(rates).max() / entry_s <= 400 * 40
    assert np.diff(rates).max() / (facts.ramp_entry_ns(chosen.slope + 1) * 1e-9) > 400 * 40
    slower = choose(axis, feed=10.0)
    assert axis.rate_hz(slower.rate) <= 10 * 40 < axis.rate_hz(slower.rate + 1)


def test_an_axis_too_slow_or_too_gentle_for_the_chip_is_refused_with_its_line() -> None:
    with pytest.raises(PlanError, match="cannot go as slowly") as slow:
        choose(indexer(velocity=0.5), line=7)
    assert (slow.value.line, slow.value.axis) == (7, "A")
    with pytest.raises(PlanError, match="gentlest ramp") as gentle:
        choose(indexer(acceleration=1.0), line=8)
    assert "lower max_velocity" in gentle.value.hint


def test_the_profile_reads_steps_and_rates_at_any_time() -> None:
    move = profile(indexer(), RampSettings(14, 100, 220), 1000)
    end_s = move.duration_ns * 1e-9
    assert move.steps(np.array([-1.0, 0.0, end_s, end_s + 1])).tolist() == [0, 0, 1000, 1000]
    middle = move.steps(np.array([end_s / 2]))[0]
    assert middle == pytest.approx(500, abs=1)
    assert move.rate_hz(np.array([-0.1, end_s / 2, end_s])).tolist()[::2] == [0, 0]
