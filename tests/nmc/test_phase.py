"""What is learned of a chip from counters that are read: the truth is found, and known to be as near as it is."""

import numpy as np
import pytest

from nmc.budget import Window
from nmc.phase import Phase

DELAY_NS = 250_000
PERIOD_NS = 250_000
"""20 mm/s at 200 steps/mm."""


def watch(seed: int, seconds: float, every_s: float = 0.02) -> tuple[float, float, float, float]:
    """A chip of unknown start and crystal at a constant rate, read again and again.

    Returns what is left of its offset in ns, what was said to be left (standard deviation), its crystal error and what
    was found of it in ppm.
    """
    rng = np.random.default_rng(seed)
    ppm = rng.uniform(-100, 100)
    phase, start_ns = Phase(100), rng.uniform(0, DELAY_NS)
    phase.start(Window(0, DELAY_NS, 0))
    nominal_ns, at_ns = DELAY_NS / 2, DELAY_NS // 2
    for sent_ns in np.arange(every_s, seconds, every_s) * 1e9 + rng.uniform(0, 1e6, round(seconds / every_s) - 1):
        sent = int(sent_ns)
        nominal_ns += (sent + DELAY_NS // 2 - at_ns) * phase.rate
        at_ns = sent + DELAY_NS // 2
        latched_ns = sent + rng.uniform(0, DELAY_NS)
        steps = int((latched_ns - start_ns) / (PERIOD_NS * (1 + ppm * 1e-6)))
        past_ns = round(steps * PERIOD_NS + nominal_ns)
        nominal_ns += phase.observe(Window(sent, sent + DELAY_NS, sent), past_ns, past_ns + PERIOD_NS)
    truth_ns = start_ns + at_ns * ppm * 1e-6
    return truth_ns - nominal_ns, phase.deviation_ns(), ppm, phase.rate * 1e6


def test_offset_and_crystal_are_found_and_the_doubt_is_honest() -> None:
    found = np.array([watch(seed, 4.0) for seed in range(60)])
    left, said = found[:, 0], found[:, 1]
    assert np.sqrt(np.mean(left**2)) < 30_000  # the start alone leaves 72 us, the crystal 230 us more after 4 s
    assert 0.6 < np.sqrt(np.mean(left**2) / np.mean(said**2)) < 1.6
    assert np.sqrt(np.mean((found[:, 2] - found[:, 3]) ** 2)) < 12  # of 58 ppm that nobody knew


def test_the_crystal_outlives_a_leg_and_the_offset_does_not() -> None:
    phase = Phase(100)
    phase.start(Window(0, 0, 0))
    late_ns = 0.0
    for k in range(1, 100):
        at_ns = k * 20_000_000
        late_ns += (50e-6 - phase.rate) * 20_000_000
        past_ns = round(at_ns - 500 - late_ns)
        late_ns -= phase.observe(Window(at_ns, at_ns, at_ns), past_ns, past_ns + 1_000)
    assert phase.rate == pytest.approx(50e-6, abs=2e-6)
    known = phase.deviation_ns()
    phase.start(Window(2_000_000_000, 2_000_250_000, 2_000_000_000))
    assert phase.rate == pytest.approx(50e-6, abs=2e-6)
    assert phase.deviation_ns() == pytest.approx(250_000 / np.sqrt(12))
    assert known < phase.deviation_ns()


def test_a_load_at_a_roll_over_leaves_doubt_and_one_between_two_does_not() -> None:
    def after(ahead_ns: int) -> float:
        phase = Phase(100)
        phase.start(Window(0, 0, 0))
        phase.load(Window(10_000_000, 10_250_000, 10_000_000), 10_125_000 + ahead_ns, 4_000_000, 1_000_000)
        return phase.deviation_ns()

    assert after(2_000_000) == pytest.approx(1_000)
    assert after(1_000) == pytest.approx(1_500_000, rel=0.02)  # as likely on either side: half of 3 ms


def test_what_cannot_be_is_taken_as_seen() -> None:
    phase = Phase(100)
    phase.start(Window(0, 0, 0))
    # Known to a microsecond, and yet seen ten periods late: the twin is put where the chip must be.
    shift = phase.observe(Window(1_000_000, 1_000_000, 1_000_000), -9_000_000, -8_000_000)
    assert shift == pytest.approx(9_500_000, abs=2)
    assert phase.deviation_ns() > 100_000
