"""The simulated PIC-STEP's other commands (data sheet 5.1)."""

import numpy as np
import pytest

from sim.rawhost import machine, steppers
from sim.rawstep import count_for, gaps_ns, load_count, load_profile
from sim.spec import StepModule

item = pytest.mark.item


@item("ST-100", "X-72")
def test_reset_position():
    """ST 5.1: resets the 32-bit counter to 0; while moving it is executed and logged (choice)."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=40)
    host.wait_ms(500)
    host.exchange(1, 0x0)
    host.wait_ms(1)
    assert host.position(1) == 0
    assert chip.mechanical_steps == 40
    assert sim.rules() == []
    load_count(host, 65000)
    host.wait_ms(100)
    host.exchange(1, 0x0)
    host.wait_ms(1)
    assert 0 <= chip.position < 10
    assert sim.rules() == ["X-72"]


@item("ST-102", "X-76")
def test_status_item_2_is_the_timer_count():
    """ST 5.1: current initial timer count, 2 bytes. Choice: the one with which the timer was last reloaded."""
    _, host, _ = steppers(mode=0)
    load_count(host, 1)
    host.wait_ms(20)
    load_count(host, 65000)
    host.wait_ms(1)
    assert host.items(1, 0x04, 2) == bytes([1, 0])
    host.wait_ms(20)
    assert int.from_bytes(host.items(1, 0x04, 2), "little") == 65000
    host.exchange(1, 0x7, [0x05])
    load_profile(host, speed=100, acceleration=1)
    host.wait_ms(200)
    assert int.from_bytes(host.items(1, 0x04, 2), "little") == 65536 - 250 + 16


@item("ST-104")
def test_type_and_version():
    """ST 3.4, 5.1: PIC-STEP controller device type = 3; version 1 is that of the data sheet."""
    _, host, _ = steppers()
    assert host.items(1, 0x20, 2) == bytes([3, 1])


@item("ST-140", "ST-141", "ST-142", "ST-143", "ST-144", "ST-145")
def test_set_parameters_fields():
    """ST 5.1: operating mode, minimum speed, running and holding current, thermal limit; bits 5-7 ignored."""
    sim, host, (chip,) = steppers()
    for bits, multiple in ((0, 8), (1, 4), (2, 2), (3, 1)):
        for flags in (0x00, 0x04, 0x08, 0x10, 0x1C):
            host.exchange(1, 0x6, [bits | flags, 33, 44, 55, 0])
            host.wait_ms(1)
            assert chip.speed_mode == multiple
            assert (chip.limit_stop, chip.estop_stop, chip.off_on_stop) == (
                not flags & 4,
                not flags & 8,
                bool(flags & 16),
            )
            assert (chip.timer.least_speed, chip.running_current, chip.holding_current) == (33, 44, 55)
    assert sim.rules() == []
    host.exchange(1, 0x6, [0xE3, 33, 44, 55, 0])
    host.wait_ms(1)
    assert chip.speed_mode == 1
    assert sim.rules() == ["ST-145"]


@item("ST-146", "X-66")
def test_no_motion_before_set_parameters():
    """ST 5.1: this command must be issued before any motions can be executed."""
    sim, host = machine([StepModule("M1")])
    host.start_up(1)
    host.exchange(1, 0x7, [0x01])
    load_count(host, 65000)
    host.wait_ms(500)
    assert host.position(1) == 0
    assert sim.rules() == ["X-66"]


@item("ST-147")
def test_set_parameters_while_moving():
    """ST 5.1: changes to the speed mode bits and minimum profile speed will be ignored in motion; the rest is taken."""
    sim, host, (chip,) = steppers(mode=0)
    load_count(host, 60000)
    host.wait_ms(50)
    host.exchange(1, 0x6, [0x07, 99, 1, 2, 0])
    host.wait_ms(50)
    assert chip.speed_mode == 8
    assert chip.timer.least_speed == 1
    assert (chip.running_current, chip.holding_current, chip.limit_stop) == (1, 2, False)
    assert gaps_ns(sim) == pytest.approx((5536 + 16) * 200, rel=1e-6)


@item("ST-009", "ST-150", "ST-156", "ST-202")
def test_stop_motor_bit_0_is_amp_en():
    """ST 5.1: AMP_EN follows bit 0 regardless of the other bits; the command is needed first."""
    _, host, (chip,) = steppers()
    for control in (0x00, 0x01, 0x04, 0x05, 0x08, 0x09):
        host.exchange(1, 0x7, [control])
        host.wait_ms(1)
        assert chip.amp_enabled == bool(control & 1)
        assert bool(host.status(1) & 0x04) == bool(control & 1)
    _sim, host = machine([StepModule("M1")])
    host.wait_ms(2)
    assert not host.status(0) & 0x04


@item("ST-150", "ST-151", "ST-170")
@pytest.mark.parametrize("mode", ["trapezoid", "velocity", "with stop", "no stop"])
@pytest.mark.parametrize("control", [0x05, 0x09])
def test_stop_motor_stops_every_mode(mode, control):
    """ST 5.1, Table 4 first row: Stopped is entered from any mode by Stop Motor; bit 2 abruptly, bit 3 smoothly."""
    sim, host, (chip,) = steppers(mode=0, least_speed=10)
    if mode == "trapezoid":
        load_profile(host, position=500_000, speed=100, acceleration=2)
    elif mode == "velocity":
        load_profile(host, speed=100, acceleration=2)
    else:
        load_count(host, count_for(20_000, 0), speed=100, position=500_000 if mode == "with stop" else None)
    host.wait_ms(200)
    assert host.status(1) & 0x01
    before = host.position(1)
    host.exchange(1, 0x7, [control])
    host.wait_ms(1)
    if control == 0x05:
        assert not chip.moving
        stopped = host.position(1)
        assert stopped - before < 100
        host.wait_ms(100)
        assert host.position(1) == stopped
    else:
        assert chip.moving
        host.wait_ms(100)
        assert not chip.moving
    assert sim.rules() == []


@item("ST-152", "ST-154")
def test_smooth_stop_ramps_down_to_the_minimum_speed():
    """ST 5.1: decelerates with the current acceleration; at the minimum profile speed, it will stop."""
    sim, host, _ = steppers(mode=0, least_speed=50)
    load_profile(host, speed=150, acceleration=4)
    host.wait_ms(300)
    before = len(sim.trace().pulses_ns("M1"))
    host.exchange(1, 0x7, [0x09])
    host.wait_ms(300)
    gaps = gaps_ns(sim)[before:]
    rates = 1e9 / gaps
    assert rates[-1] == pytest.approx(51 * 200, rel=0.01)
    assert np.all(np.diff(gaps) >= -1)
    steps = sum(s * 200 * 1e-3 for s in range(51, 151))  # 1 ms at each speed
    assert len(gaps) == pytest.approx(steps, rel=0.02)


@item("ST-153")
def test_stop_motor_with_two_manners_is_logged():
    """ST 5.1: only one of bits 2 or 3 should be set at one time; unused bits clear."""
    sim, host, _ = steppers()
    host.exchange(1, 0x7, [0x0D])
    host.exchange(1, 0x7, [0x81])
    host.wait_ms(1)
    assert sim.rules() == ["ST-153", "ST-153"]


@item("ST-012", "ST-160")
def test_outputs():
    """ST 2.3: outputs 1-4 are initialized LOW, output 5 HIGH; ST 5.1 Set Outputs: bits 0-4 are OUT1-OUT5."""
    sim, host, (chip,) = steppers()
    assert chip.outputs == 0b10000
    for value in range(32):
        host.exchange(1, 0x8, [value])
        host.wait_ms(1)
        assert chip.outputs == value
    assert sim.rules() == []
    host.exchange(1, 0x8, [0xFF])
    host.wait_ms(1)
    assert chip.outputs == 0x1F
    assert sim.rules() == ["ST-160"]


@item("ST-161", "N-085", "X-75")
def test_save_as_home():
    """ST 5.1: the current position is saved in the home position register; X-75 while homing."""
    sim, host, _ = steppers()
    load_count(host, 65000, position=123)
    host.wait_ms(1000)
    host.exchange(1, 0xC)
    host.wait_ms(1)
    assert host.home(1) == 123
    host.exchange(1, 0x9, [0x01])
    host.exchange(1, 0xC)
    assert host.status(1) & 0x80
    assert sim.rules() == ["X-75"]


@item("ST-161")
def test_hard_reset_stops_and_forgets():
    """ST 5.1 Hard Reset: power-up state."""
    sim, host, (chip,) = steppers()
    load_count(host, 60000)
    host.exchange(1, 0x8, [0])
    host.wait_ms(100)
    host.send(1, 0xF)
    host.wait_ms(10)
    assert not chip.moving
    assert (chip.position, chip.outputs, chip.amp_enabled, chip.parameters_set) == (0, 0x10, False, False)
    assert sim.rules() == []


@item("ST-162")
@pytest.mark.parametrize("command", [0xB, 0xD])
def test_commands_b_and_d_do_not_exist(command):
    """ST 5.1: not defined for the PIC-STEP."""
    sim, host, _ = steppers()
    assert len(host.exchange(1, command)) == 1
    host.wait_ms(1)
    assert sim.rules() == ["X-41"]
