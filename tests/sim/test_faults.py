"""Faults on purpose: each does what it says, and nothing else."""

import numpy as np
import pytest

from sim.faults import Dead, Inputs, LostSteps, Noise, Overrun, Supply, schedule
from sim.rawhost import NoReplyError, i32, machine, servos, steppers
from sim.spec import StepModule, Switch

COUNT = (64000).to_bytes(2, "little")


def talk(host, number):
    """How many of ``number`` NOPs are answered well."""
    good = 0
    for _ in range(number):
        try:
            good += not host.exchange(1, 0xE)[0] & 0x02
        except NoReplyError:
            host.link.write(bytes(16))
            host.wait_ms(20)
            host.link.flush_input()
    return good


@pytest.mark.parametrize("kind", ["lose", "flip", "insert"])
@pytest.mark.parametrize("line", ["command", "status"])
def test_noise_spoils_some_exchanges_and_ends(kind, line):
    sim, host, _ = steppers()
    start = host.link.now_ns()
    lines = {"command": line == "command", "status": line == "status"}
    schedule(sim, [Noise(**{kind: 0.05}, from_ns=start, until_ns=start + 500_000_000, seed=3, **lines)])
    assert 20 < talk(host, 100) < 100
    host.link.sleep_until(max(host.link.now_ns(), start + 500_000_001))
    host.link.write(bytes(16))
    host.wait_ms(20)
    host.link.flush_input()
    assert talk(host, 100) == 100


def test_noise_is_repeatable():
    def run(seed):
        sim, host, _ = steppers()
        schedule(sim, [Noise(flip=0.02, lose=0.02, seed=seed)])
        talk(host, 100)
        trace = sim.trace()
        return trace.bus_ns, trace.bus_byte

    one, same, other = run(1), run(1), run(2)
    assert all(np.array_equal(a, b) for a, b in zip(one, same, strict=True))
    assert not np.array_equal(one[0], other[0])


def test_stuck_switch():
    sim, host, (chip,) = steppers(mode=0, switches=(Switch("limit1", 300, None),))
    schedule(sim, [Inputs("M1", host.link.now_ns(), {"limit1": False})])
    host.wait_ms(1)
    host.exchange(1, 0x4, [0x89, *i32(500), *COUNT, 50])
    host.wait_ms(1000)
    assert chip.position == 500
    schedule(sim, [Inputs("M1", host.link.now_ns(), {"limit1": None})])
    host.wait_ms(1)
    assert host.items(1, 0x08, 1) == bytes([0x08])


def test_lost_steps_separate_mechanics_and_counter():
    sim, host, (chip,) = steppers(mode=0)
    schedule(sim, [LostSteps("M1", host.link.now_ns() + 100_000_000, -7)])
    host.exchange(1, 0x4, [0x89, *i32(500), *COUNT, 50])
    host.wait_ms(1000)
    assert (chip.position, chip.mechanical_steps) == (500, 493)


def test_dead_module_is_silent_and_stands():
    sim, host, (first, second) = steppers(2, mode=0)
    for address in (1, 2):
        host.exchange(address, 0x4, [0x88, *COUNT, 50])
    schedule(sim, [Dead("M1", host.link.now_ns() + 50_000_000)])
    host.wait_ms(100)
    stood = first.position
    with pytest.raises(NoReplyError):
        host.exchange(1, 0xE)
    host.wait_ms(100)
    assert first.position == stood
    assert second.moving
    assert len(host.exchange(2, 0xE)) == 1  # its ADDR_OUT stays LOW, so the chain lives


def test_supply_and_overrun_of_a_servo():
    sim, host, (chip,) = servos()
    now = host.link.now_ns()
    schedule(sim, [Overrun("S1", now + 10_000_000, 50_000), Supply("S1", now + 20_000_000, 5.0)])
    host.wait_ms(15)
    assert host.items(1, 0x08, 1)[0] & 0x20
    host.wait_ms(15)
    assert host.status(1) & 0x18 == 0x10
    assert not chip.moving


@pytest.mark.parametrize("fault", [Overrun("M1", 0), Supply("M1", 0, 1.0), Dead("nobody", 0)])
def test_faults_that_cannot_be_are_refused(fault):
    sim, _ = machine([StepModule("M1")])
    with pytest.raises(ValueError, match=r"PIC-SERVO|does not exist"):
        schedule(sim, [fault])


def test_step_faults_on_a_servo_are_refused():
    sim, _, _ = servos()
    with pytest.raises(ValueError, match="needs a PIC-STEP"):
        schedule(sim, [LostSteps("S1", 0, 1)])


def test_second_master_stops_what_a_dead_host_left_running():
    sim, host, (chip,) = steppers(mode=0)
    host.exchange(1, 0x4, [0x88, *COUNT, 50])
    watchdog = sim.another_master(0)

    def expire():
        sim.links[0].fenced = True
        watchdog.write(bytes(16) + b"\xaa\x81\x17\x05\x9d")

    sim.world.call_at(host.link.now_ns() + 50_000_000, expire)
    host.wait_ms(40)
    assert chip.moving
    host.wait_ms(20)
    assert not chip.moving
    host.send(1, 0x4, [0x88, *COUNT, 50])
    host.wait_ms(20)
    assert not chip.moving
