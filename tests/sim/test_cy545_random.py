"""The simulated CY545 under any bytes and any events: it never loses a step, and never breaks."""

import numpy as np
import pytest

from nmc.chips.cy545 import BLOCK, RateTable
from sim.cy545_host import TextHost
from sim.cy545_ramp import ENDLESS, Ramp, brake, climb, endless, journey

RATES = RateTable(tuple(50.0 + 40.0 * k for k in range(256)), "a table of equal steps")


def random_ramp(rng: np.random.Generator) -> Ramp:
    first = int(rng.integers(1, 250))
    top = int(rng.integers(first, 256))
    period = [RATES.period_ns(k) for k in range(256)]
    return Ramp(period, int(rng.integers(1, 255)) * 256_000, first, top)


def test_every_journey_has_its_steps_and_ends_at_the_first_rate() -> None:
    rng = np.random.default_rng(1)
    for _ in range(500):
        ramp = random_ramp(rng)
        start = int(rng.integers(ramp.first, ramp.top + 1))
        steps = int(np.exp(rng.uniform(0, 12)))
        runs = journey(ramp, start, steps)
        indices = [index for index, _ in runs]
        assert sum(count for _, count in runs) == steps
        assert all(count > 0 for _, count in runs)
        assert min(indices) >= ramp.first
        assert max(indices) <= ramp.top
        peak = indices.index(max(indices))
        assert indices[: peak + 1] == sorted(indices[: peak + 1])
        assert indices[peak:] == sorted(indices[peak:], reverse=True)
        if start == ramp.first:
            expanded = np.repeat(indices, [count for _, count in runs])
            assert expanded.tolist() == expanded[::-1].tolist()


def test_braking_comes_down_in_the_time_of_its_entries() -> None:
    rng = np.random.default_rng(2)
    for _ in range(300):
        ramp = random_ramp(rng)
        index = int(rng.integers(ramp.first, ramp.top + 1))
        waited = int(rng.integers(0, ramp.period[index]))
        runs = brake(ramp, index, waited, ENDLESS)
        indices = [k for k, _ in runs]
        assert indices == sorted(indices, reverse=True)
        assert all(ramp.first < k <= index for k in indices)
        took = waited + sum(count * ramp.period[k] for k, count in runs)
        assert took <= (index - ramp.first) * ramp.entry + waited + ramp.period[ramp.first]
        few = brake(ramp, index, waited, 3)
        assert sum(count for _, count in few) <= 3


def test_endless_ends_in_the_top_rate() -> None:
    ramp = random_ramp(np.random.default_rng(3))
    assert endless(ramp, ramp.first)[:-1] == climb(ramp, ramp.first)
    assert endless(ramp, ramp.first)[-1] == (ramp.top, ENDLESS)


@pytest.mark.parametrize("seed", range(6))
def test_random_commands_and_events_lose_no_step(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = TextHost(RATES, seed=seed, crystal_ppm_max=100, start_delay_max_ns=250_000, host_jitter_max_ns=200_000)
    chip = rig.chip
    offset = 0  # register = mechanical + offset
    for _ in range(120):
        act = int(rng.integers(0, 10))
        if act < 5:
            command = str(rng.choice(["G", "C", "+", "-", f"N {rng.integers(0, 5000)}", f"R {rng.integers(1, 256)}"]))
            rig.send(command + "\r")
        elif act == 5:
            target = int(rng.integers(0, 3000))
            if not chip.busy and (chip.register + BLOCK // 2) % BLOCK < BLOCK // 2 + 5000:
                rig.send(f"P {target}\r")
        elif act == 6:
            rig.link.pull_abort(bool(rng.integers(0, 2)))
        elif act == 7:
            chip.set_jog(rng.choice([None, "cw", "ccw"]))
        elif act == 8 and not chip.busy:
            value = int(rng.integers(0, BLOCK))
            rig.send(f"A {value}\r")
            rig.wait(0.002)
            offset = (chip.register - chip.mechanical) % BLOCK
        rig.wait(float(rng.uniform(0, 0.4)))
        assert (chip.register - chip.mechanical) % BLOCK == offset
    chip.set_jog(None)
    rig.link.pull_abort(True)
    rig.until_ready(100)
    trace = rig.sim.trace()
    steps = int((trace.run_count.astype(np.int64) * trace.run_dir).sum())
    assert steps == chip.mechanical
    pulses = trace.pulses_ns("A")
    assert len(pulses) > 100
    assert (np.diff(pulses) > 0).all()
    assert 1e9 / np.diff(pulses).min() <= RATES.steps_per_s[255] * 1.001


@pytest.mark.parametrize("seed", range(4))
def test_any_bytes_are_survived_and_the_chip_answers_afterwards(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = TextHost(RATES, seed=seed)
    letters = list(b'ABCDEFGHIJLNOPQRSTWXYZ+-/?0[" ,\r\r\r0123456789') + list(range(256))
    for _ in range(60):
        data = bytes(int(value) for value in rng.choice(letters, int(rng.integers(1, 40))))
        rig.link.write(data)
        rig.wait(0.1)
    rig.link.pull_abort(True)
    rig.send("\r")
    rig.until_ready(1e6)
    rig.link.pull_abort(False)
    rig.until_ready(1e6)
    rig.do("")
    assert rig.ask("R").startswith("R=")
