"""Descriptions that cannot be are refused, and what is drawn stays within its bounds."""

import numpy as np
import pytest

from sim.build import build
from sim.spec import BusSpec, IoModule, ServoModule, ServoPlant, StepModule, Switch


@pytest.mark.parametrize(
    ("module", "words"),
    [
        (StepModule("A", crystal_ppm=20_000), "ppm"),
        (StepModule("A", start_delay_max_ns=-1), "delays"),
        (IoModule("A", reply_delay_max_ns=-1), "delays"),
        (ServoModule("A", oscillator_mhz=25), "10 and 20 MHz"),
        (ServoModule("A", plant=ServoPlant(inertia_kgm2=0)), "above zero"),
        (ServoModule("A", plant=ServoPlant(coulomb_nm=-0.1)), "not below zero"),
        (ServoModule("A", switches=(Switch("home", 0, 1),)), "no switch input 'home'"),
    ],
)
def test_impossible_modules(module, words):
    with pytest.raises(ValueError, match=words):
        build([BusSpec("b", (module,))], 1)


def test_two_modules_of_one_name():
    with pytest.raises(ValueError, match="two modules are called 'A'"):
        build([BusSpec("b", (StepModule("A"),)), BusSpec("c", (StepModule("A"),))], 1)


def test_crystals_are_drawn_within_their_bounds_and_one_for_each():
    specs = tuple(StepModule(f"M{k}", crystal_ppm=10, crystal_ppm_max=100) for k in range(32))
    sim = build([BusSpec("b", specs)], 4)
    errors = np.array([m.ppb for m in sim.modules.values()]) / 1000
    assert np.all(np.abs(errors - 10) <= 100)
    assert len(set(errors)) == 32
    assert np.ptp(errors) > 100
    assert len({m.clock.phase_ns for m in sim.steppers().values()}) == 32


def test_buses_are_apart_but_share_the_clock():
    sim = build([BusSpec("b", (StepModule("A"),)), BusSpec("c", (StepModule("B"),))], 1)
    first, second = sim.links
    first.sleep_until(3_000_000)
    assert second.now_ns() == 3_000_000
    second.write(b"\xaa\x00\x0e\x0e")
    assert len(second.read(2, 20_000_000)) == 2
    assert first.read(2, 40_000_000) == b""
    assert set(sim.trace().bus_line) == {2, 3}


def test_power_cycle_brings_everything_back_but_the_mechanics():
    sim = build([BusSpec("b", (StepModule("A", start_steps=77), ServoModule("B")))], 1)
    for module in sim.modules.values():
        module.address, module.mask = 9, 0x3F
    sim.power_cycle()
    assert [(m.address, m.mask) for m in sim.modules.values()] == [(0, 0), (0, 0)]
    assert sim.steppers()["A"].mechanical_steps == 77
