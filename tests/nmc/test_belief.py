"""What is believed of a chip: the truth is found, and known to be as near as it is."""

import numpy as np
import pytest

from nmc.belief import FAR_STEPS, Belief
from nmc.belief_kernel import CHIPS, ROOT
from nmc.budget import Window

DELAY_NS = 250_000
PERIOD_NS = 250_000
"""20 mm/s at 200 steps/mm."""
STEPS = 10**9


def at(time_ns: int) -> Window:
    return Window(time_ns, time_ns, time_ns)


def watch(seed: int, seconds: float, every_s: float = 0.02) -> tuple[float, float, float, float]:
    """A chip of unknown start and crystal at a constant rate, read again and again.

    Returns what is left of its offset in ns, what was said to be left (standard deviation), its crystal error and what
    was found of it in ppm.
    """
    rng = np.random.default_rng(seed)
    ppm = rng.uniform(-100, 100)
    belief, start_ns = Belief(100), rng.uniform(0, DELAY_NS)
    belief.start(Window(0, DELAY_NS, 0), PERIOD_NS, STEPS)
    period_ns = PERIOD_NS * (1 + ppm * 1e-6)
    now = 0
    for sent_ns in np.arange(every_s, seconds, every_s) * 1e9 + rng.uniform(0, 1e6, round(seconds / every_s) - 1):
        now = int(sent_ns) + DELAY_NS // 2
        belief.latch(Window(int(sent_ns), int(sent_ns) + DELAY_NS, int(sent_ns)))
        latched_ns = sent_ns + rng.uniform(0, DELAY_NS)
        belief.latched(STEPS - int((latched_ns - start_ns) / period_ns))
    next_ns, _, left = belief.mean(now)
    truth_ns = start_ns + (STEPS - left + 1) * period_ns
    return truth_ns - next_ns, belief.next_deviation_ns(left), ppm, belief.rate * 1e6


def test_offset_and_crystal_are_found_and_the_doubt_is_honest() -> None:
    found = np.array([watch(seed, 4.0) for seed in range(60)])
    left, said = found[:, 0], found[:, 1]
    assert np.sqrt(np.mean(left**2)) < 30_000  # the start alone leaves 72 us, the crystal 230 us more after 4 s
    assert 0.6 < np.sqrt(np.mean(left**2) / np.mean(said**2)) < 1.6
    assert np.sqrt(np.mean((found[:, 2] - found[:, 3]) ** 2)) < 12  # of 58 ppm that nobody knew


def test_the_crystal_outlives_a_leg_and_the_offset_does_not() -> None:
    belief = Belief(100)
    belief.start(at(0), 1_000, STEPS)
    for k in range(1, 100):
        now = k * 20_000_000
        belief.latch(at(now))
        belief.latched(STEPS - int(now / 1_000.05))  # 50 ppm slow
    assert belief.rate == pytest.approx(50e-6, abs=2e-6)
    belief.start(Window(2_000_000_000, 2_000_250_000, 2_000_000_000), PERIOD_NS, 10)
    assert belief.rate == pytest.approx(50e-6, abs=2e-6)
    assert belief.next_deviation_ns(10) == pytest.approx(250_000 / np.sqrt(12), rel=0.01)


def loaded(ahead_ns: int) -> Belief:
    """4 ms steps, then a count of 1 ms within 0.25 ms whose middle lies so long before a roll-over."""
    belief = Belief(0)
    belief.start(at(0), 4_000_000, 100)
    middle_ns = 12_000_000 - ahead_ns
    belief.load(Window(middle_ns - 125_000, middle_ns + 125_000, middle_ns - 125_000), 1_000_000)
    return belief


def test_a_load_at_a_roll_over_leaves_doubt_and_one_between_two_does_not() -> None:
    assert loaded(2_000_000).next_deviation_ns(50) == pytest.approx(0.0, abs=100)
    assert loaded(0).next_deviation_ns(50) == pytest.approx(1_500_000, rel=0.02)  # half of the chips are 3 ms later
    assert loaded(0).mean(12_200_000)[2] == 97  # either way the third step has been made by now


def test_the_counter_tells_on_which_side_of_the_load_the_roll_over_was() -> None:
    for seen, next_ns in ((94, 15_000_000 + 1_000_000), (91, 15_000_000 + 1_000_000)):
        belief = loaded(0)
        belief.latch(
            at(15_500_000)
        )  # the early chips have made steps at 12, 13, 14 and 15 ms, the late ones at 12 only
        assert belief.latched(100 - (6 if seen == 94 else 3))
        assert belief.next_deviation_ns(50) < 20_000
        assert belief.mean(15_500_000)[0] == pytest.approx(next_ns, abs=20_000)


def test_what_cannot_be_is_taken_as_seen() -> None:
    belief = Belief(100)
    belief.start(at(0), 1_000_000, 1_000)
    belief.latch(at(100_500_000))
    assert not belief.latched(1_000 - 90)  # a hundred steps were certain
    assert abs(belief.mean(100_500_000)[2] - 910) <= 1
    assert belief.next_deviation_ns(900) > 200_000


def test_a_chip_that_was_thought_a_little_too_early_is_not_lost_by_a_whole_period() -> None:
    """It rolled over 0.1 ms after it had done so for certain, as was thought: it is known to be late by about that."""
    belief = Belief(0)
    belief.start(at(0), 1_600_000, 1_000)
    belief.latch(at(16_100_000))
    assert not belief.latched(1_000 - 9)  # the tenth step was certain at 16 ms
    assert belief.mean(16_100_000)[2] == 1_000 - 9
    assert 16_100_000 < belief.mean(16_100_000)[0] < 16_250_000
    assert belief.next_deviation_ns(1_000 - 9) < 40_000


def test_nothing_is_learned_across_a_new_start() -> None:
    belief = Belief(0)
    belief.start(at(0), 1_000_000, 100)
    belief.latch(at(10_500_000))
    belief.start(at(200_000_000), 1_000_000, 50)
    assert belief.latched(3)
    assert belief.mean(200_000_000) == (201_000_000, 1_000_000, 50)


def test_a_load_is_worth_what_it_mends_less_what_it_risks() -> None:
    belief = Belief(0)
    belief.start(at(0), 4_000_000, 100)
    # At 20 ms 89 steps should be left, three more than by going on: 1 ms steps from the roll-over at 16 ms on do it.
    safe = belief.mends_steps(14_000_000, 250_000, 20_000_000, 92.0, 1_000_000)
    assert safe == pytest.approx(3.0 * 3.0 / FAR_STEPS, abs=0.05)
    risky = belief.mends_steps(16_000_000, 250_000, 20_000_000, 92.0, 1_000_000)
    left = 3.0 / 2**0.5  # rms if half of the chips are three steps off as before
    assert risky == pytest.approx((3.0 - left) * (3.0 + left) / FAR_STEPS, abs=0.05)
    little = belief.mends_steps(14_000_000, 250_000, 20_000_000, 94.0, 2_000_000)
    assert little == pytest.approx(1.0, abs=0.05)  # from 1 to 0: small things count as they are
    late = belief.mends_steps(20_500_000, 250_000, 20_000_000, 92.0, 1_000_000)
    assert late == pytest.approx(0.0, abs=1e-9)


def test_every_set_of_quantiles_is_another_one() -> None:
    assert len({ROOT**k % CHIPS for k in range(CHIPS - 1)}) == CHIPS - 1


def test_a_chip_that_a_load_may_have_met_at_either_side_is_known_less() -> None:
    belief = Belief(0)
    belief.start(at(0), 4_000_000, 100)
    belief.load(at(15_000_000), 2_000_000)  # between two roll-overs
    assert belief.deviation_steps(19_000_000) < 0.05
    doubtful = Belief(0)
    doubtful.start(at(0), 4_000_000, 100)
    doubtful.load(Window(15_900_000, 16_100_000, 15_900_000), 2_000_000)
    # at 19 ms half of them have made 5.5 steps, the last at 18 ms, and half 4.75: their next one comes at 20 ms
    assert doubtful.deviation_steps(19_000_000) == pytest.approx(0.75 / 2, abs=0.01)
