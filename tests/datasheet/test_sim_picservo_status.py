"""The simulated PIC-SERVO's PWM mode, power, reset and status (data sheet 4.5, 5.3)."""

import numpy as np
import pytest

from sim import servokernel as k
from sim.rawhost import FIRM_GAINS, i32, machine, servos
from sim.rawservo import LOCKED, auxiliary, gains, stop_here, tick
from sim.spec import ServoModule, ServoPlant

item = pytest.mark.item


@item("SV-060", "SV-115", "SV-117", "SV-123", "SV-063")
@pytest.mark.parametrize("reverse", [False, True])
def test_raw_pwm_mode(reverse):
    """SV 4.5, 5.2: servo off, the value goes directly to the amplifier, bit 6 is the direction; no profiling."""
    _, host, (chip,) = servos()
    host.exchange(1, 0x4, [0x88 | (0x40 if reverse else 0), 80])
    n = tick(host, chip, 40)
    assert not n[k.SERVO_ON]
    assert n[k.PWM] == 80
    assert n[k.DIR] == reverse
    assert (host.position(1) < -100) if reverse else (host.position(1) > 100)
    assert host.status(1) & 0x11 == 0x11


@item("SV-061", "SV-123", "SV-142")
def test_servo_off_sets_pwm_to_zero():
    """SV 4.5, 5.2: PWM defaults to zero after Stop Motor, loss of power or excess error."""
    _, host, (chip,) = servos()
    host.exchange(1, 0x4, [0x88, 80])
    host.wait_ms(50)
    host.exchange(1, 0x7, [0x03])
    n = tick(host, chip, 2)
    assert (n[k.PWM], n[k.RAW_PWM]) == (0, 0)
    host.exchange(1, 0x7, [0x05])
    n = tick(host, chip)
    assert n[k.SERVO_ON]
    chip.set_supply(0.0)
    n = tick(host, chip, 2)
    assert (n[k.SERVO_ON], n[k.PWM], n[k.RAW_PWM]) == (0, 0, 0)


@item("SV-064", "SV-143")
def test_servo_off_tracks_so_that_there_is_no_jump():
    """SV 4.5: command position and velocity follow the motor, so entering a mode makes no jump."""
    _, host, (chip,) = servos()
    host.exchange(1, 0x4, [0x88, 60])
    host.wait_ms(200)
    n = tick(host, chip)
    speed = n[k.MEASURED]
    assert speed > 3
    assert n[k.COMMAND] >> 16 == n[k.POS]
    assert n[k.VELOCITY] >> 16 == speed
    host.exchange(1, 0x4, [0xB6, *i32(speed * 65536), *i32(655)])
    worst = 0
    for _ in range(200):
        n = tick(host, chip)
        worst = max(worst, abs((n[k.COMMAND] >> 16) - n[k.POS]))
    assert n[k.SERVO_ON]
    assert worst < 100


@item("SV-066", "SV-183")
@pytest.mark.parametrize(("volts", "on"), [(24.0, True), (12.1, True), (12.0, False), (0.0, False)])
def test_motor_power(volts, on):
    """SV 4.5, 5.3: power_on is set above 12 V; power loss disables the servo and sets pos_error."""
    _, host, (chip,) = servos()
    host.wait_ms(10)
    assert chip.n[k.SERVO_ON]
    chip.set_supply(volts)
    tick(host, chip, 2)
    status = host.status(1)
    assert bool(status & 0x08) == on
    assert bool(status & 0x10) != on
    assert bool(auxiliary(host) & 0x04) == on


@item(*(f"SV-{n:03d}" for n in range(70, 83)))
@pytest.mark.parametrize("how", ["power-up", "hard reset"])
def test_power_up_and_reset_conditions(how):
    """SV 4.5, list of powerup and reset conditions."""
    if how == "power-up":
        sim, host = machine([ServoModule("S1")])
        host.wait_ms(2)
    else:
        sim, host, _ = servos(gains=gains(5, 6, 7, 8, 9, 10, 11, 2, 3))
        host.exchange(1, 0x4, [0xB6, *i32(65536), *i32(655)])
        host.exchange(1, 0x2, [0x01], 4)
        host.wait_ms(500)
        host.send(1, 0xF)
        host.wait_ms(2)
        host.link.set_baud(19200)
        host.link.flush_input()
        chip = sim.modules["S1"]
        chip.f[k.OMEGA] = 0
        chip.set_supply(24.0)
    chip = sim.modules["S1"]
    n = chip.n
    assert len(host.exchange(0, 0xE)) == 1  # address, group, status items, baud
    assert host.status(0) & 0x95 == 0x11  # move_done and pos_error set; overcurrent, home_in_progress clear
    assert host.items(0, 0x08, 1)[0] & 0x3E == 0  # pos_wrap, servo_on, accel_done, slew_done, servo_overrun clear
    assert abs(host.position(0)) < 20 if how == "hard reset" else host.position(0) == 0
    assert all(n[r] == 0 for r in (k.KP, k.KD, k.KI, k.IL, k.OL, k.CL, k.EL, k.DEADBAND, k.ACCEL, k.GOAL_VELOCITY))
    assert n[k.SR] == 1
    assert (n[k.PWM], n[k.MODE], n[k.AMP]) == (0, k.MODE_PWM, 0)
    assert (chip.address, chip.group, chip.leader) == (0, 0xFF, False)


@item("SV-181")
def test_checksum_error_bit():
    """SV 5.3 bit 1: error in the just received command packet."""
    _, host, _ = servos()
    host.link.write(b"\xaa\x01\x0e\x00")
    assert host.listen()[0] & 0x02
    assert not host.status(1) & 0x02


@item("SV-103", "SV-190")
def test_index_bit_is_the_complement():
    """SV 5.3 aux bit 0: compliment of the value of the index input."""
    _, host, (chip,) = servos(gains=gains(), plant=ServoPlant(index_width_counts=10))
    host.exchange(1, 0x7, [0x02])
    for count, high in ((0.5, True), (9.5, True), (10.5, False), (1999.5, False), (2000.5, True)):
        chip.f[k.THETA] = count
        tick(host, chip)
        assert bool(auxiliary(host) & 0x01) != high


@item("SV-192")
def test_servo_on_bit():
    """SV 5.3 aux bit 2."""
    _, host, _ = servos()
    assert auxiliary(host) & 0x04
    host.exchange(1, 0x7, [0x03])
    assert not auxiliary(host) & 0x04


@item("SV-195", "SV-170")
def test_servo_overrun_is_sticky_and_lengthens_the_tick():
    """SV 5.3 aux bit 5: typically not serious, only a small fraction of a millisecond of delay to the tick."""
    sim, host, (chip,) = servos()
    before = chip.clock.tick_at(sim.world.now_ns)
    host.send(1, 0xE)
    chip.inject_overrun(100_000)
    assert len(host.listen()) == 1
    assert auxiliary(host) & 0x20
    host.wait_ms(51.2)
    assert chip.clock.tick_at(sim.world.now_ns) - before >= 100
    assert auxiliary(host) & 0x20
    host.exchange(1, 0xB)
    assert not auxiliary(host) & 0x20
    times = sim.trace().servo_ns
    gaps = np.diff(times)
    assert sorted(set(np.round(gaps, -1)))[-1] == 612_000
    assert np.count_nonzero(gaps > 512_002) == 1


@item("X-88")
def test_clear_bits_with_the_servo_off_leaves_pos_error():
    """Choice from SV 5.3: set whenever the position servo is disabled."""
    _, host, _ = servos()
    assert not host.status(1) & 0x10
    host.exchange(1, 0x7, [0x03])
    host.exchange(1, 0xB)
    assert host.status(1) & 0x10


@item("X-89")
def test_servo_with_the_amplifier_off_grows_its_error_until_the_limit():
    """Choice: the loop runs, the motor does not."""
    _, host, (chip,) = servos(gains=(*FIRM_GAINS[:6], 500, 1, 0))
    host.exchange(1, 0x7, [0x04])
    host.exchange(1, 0x4, [0xB6, *i32(65536), *i32(6553)])
    host.wait_ms(200)
    assert chip.n[k.SERVO_ON]
    assert host.position(1) == 0
    host.wait_ms(200)
    assert not tick(host, chip)[k.SERVO_ON]


@item("X-91")
def test_output_zero_leaves_dir():
    """Choice: DIR unchanged."""
    _, host, (chip,) = servos(gains=gains(kp=256), plant=LOCKED)
    for goal in (-5, 0):
        stop_here(host, goal)
        n = tick(host, chip)
        assert n[k.DIR] == 1
    assert n[k.PWM] == 0


@item("X-06")
def test_reply_shows_the_state_after_execution():
    """Choice from SV 4.1: executed at the end of the cycle, then answered."""
    _, host, _ = servos()
    assert not host.exchange(1, 0x4, [0xB6, *i32(65536), *i32(65)])[0] & 0x01
    assert host.exchange(1, 0x7, [0x05])[0] & 0x01


@item("X-81")
def test_group_stop_here_gives_all_the_same_position():
    """Choice: allowed."""
    _, host, chips = servos(2)
    host.exchange(0x81, 0x7, [0x11, *i32(33)])
    host.wait_ms(1)
    assert [int(c.n[k.COMMAND]) >> 16 for c in chips] == [33, 33]
