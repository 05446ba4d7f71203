"""The simulated PIC-SERVO with PIC-ENC against its data sheet: time, encoder, filter, power, commands, status.

Figures are the data sheet's own (version 4), or follow from them by the arithmetic shown. Profiles have their own file.
"""

import struct

import numpy as np
import pytest

from sim import servokernel as k
from sim.rawhost import FIRM_GAINS, i32, machine, servos
from sim.spec import ServoModule, ServoPlant, SimOptions, Switch
from sim.uart import chip_baud

item = pytest.mark.item
LOCKED = ServoPlant(stop_low_counts=0.5, stop_high_counts=0.5)  # the shaft is held in the middle of count 0


def gains(kp=0, kd=0, ki=0, il=0, ol=255, cl=0, el=0x3FFF, sr=1, deadband=0):
    return (kp, kd, ki, il, ol, cl, el, sr, deadband)


def set_gain(host, *values):
    return host.exchange(1, 0x6, struct.pack("<HHHHBBHBB", *values))


def stop_here(host, position, amplifier=1):
    return host.exchange(1, 0x7, bytes([0x10 | amplifier]) + i32(position))


def tick(host, chip, count=1):
    """Let ``count`` servo ticks end."""
    host.link.sleep_until(chip.clock.ns_of(chip.clock.tick_at(host.link.now_ns()) + count))
    chip.synchronise()
    return chip.n.tolist()


def aux(host):
    return host.items(1, 0x08, 1)[0]


def rules(sim):
    return [v.rule for v in sim.violations]


# -- time -------------------------------------------------------------------------------------------------------------


@item("SV-001", "SV-030", "SV-135", "X-09")
@pytest.mark.parametrize(("sr", "hertz"), [(1, 1953.125), (3, 651), (255, 7.66)])
def test_servo_rate(sr, hertz):
    """SV 3.1, 4.3, 5.2: 1953.12 Hz at most; SR = 3 gives 651 Hz; 7.6 Hz at least."""
    _, host, (chip,) = servos(gains=gains(kp=1, sr=sr), plant=LOCKED)
    n = tick(host, chip, sr)
    seen = []
    for _ in range(3 * sr):
        phase = n[k.PHASE]
        n = tick(host, chip)
        if n[k.PHASE] <= phase and n[k.PHASE] == 0:
            seen.append(host.link.now_ns())
    assert 1e9 / np.diff(seen) == pytest.approx(hertz, rel=2e-3)


@item("SV-001")
@pytest.mark.parametrize("mhz", [10, 16, 20])
def test_clock_scales_tick_and_baud(mhz):
    """SV 3.0: any clock between 10 and 20 MHz, timing adjusted proportionally."""
    sim, host = machine([ServoModule("S1", oscillator_mhz=mhz)])
    assert sim.modules["S1"].clock.tick_ns == 512_000 * 20 / mhz
    assert sim.modules["S1"].rx_baud == pytest.approx(chip_baud(63) * mhz / 20)
    host.link.set_baud(round(19531 * mhz / 20))
    host.wait_ms(2)
    assert len(host.exchange(0, 0xE)) == 1


@item("SV-002", "SV-027")
def test_pwm_is_a_duty_of_255():
    """SV 3.1, 4.3: 19.53 KHz square wave (ten periods a tick), 255 = 100 %, 0 = 0 %: the motor sees its mean."""
    _, host, (chip,) = servos(plant=ServoPlant(stop_low_counts=0.5, stop_high_counts=0.5, sense_v_per_a=0.25))
    assert pytest.approx(10, rel=1e-4) == 512e-6 * 19531.2
    for pwm in (0, 51, 255):
        host.exchange(1, 0x4, [0x88, pwm])
        tick(host, chip, 40)
        current = chip.f[k.CURRENT]
        assert current == pytest.approx(24 * pwm / 255 / 1.5, rel=1e-3)


@item("SV-007")
def test_motion_commands_answer_at_once():
    """SV 4.1: motion commands will initiate the motion and return a status packet immediately."""
    _, host, (chip,) = servos()
    before = host.link.now_ns()
    host.exchange(1, 0x4, [0x97, *i32(1_000_000), *i32(65536), *i32(100)])
    assert host.link.now_ns() - before < 4_000_000
    assert chip.moving


@item("SV-006", "N-022")
def test_a_new_command_before_the_reply_wins():
    """SV 4.1: slaves disable any transmission and listen to the new command, so the host always commands attention."""
    sim, host, (chip,) = servos(gains=gains(), plant=LOCKED)
    host.exchange(1, 0x2, [0x3F], 14)
    host.send(1, 0xE)
    host.link.sleep_until(sim.buses[0].command.free_ns + 900_000)  # the reply is on its way
    host.send(1, 0x2, [0x00])
    host.wait_ms(5)
    reply = host.link.read(40, host.link.now_ns())
    assert len(reply) < 16
    assert reply[-2] == reply[-1]
    assert rules(sim) == ["N-022"]
    assert chip.mask == 0


# -- encoder ----------------------------------------------------------------------------------------------------------


@item("SV-010", "SV-012")
def test_four_counts_a_line_in_16_bits_extended_to_32():
    """SV 4.2: 500 lines give 2000 edges per revolution; the 16-bit counter wraps, the position does not."""
    _, host, (chip,) = servos(gains=gains())
    host.exchange(1, 0x7, [0x03])
    for turns in (1, 10, 40, -40, 0):
        goal = turns * 2000 + 0.5
        while abs(goal - chip.f[k.THETA]) > 0:
            chip.f[k.THETA] += np.clip(goal - chip.f[k.THETA], -250, 250)  # at most 256 counts a tick
            tick(host, chip)
        assert host.position(1) == turns * 2000
        assert chip.n[k.RAW16] == turns * 2000 & 0xFFFF
    assert chip.f[k.BACK_EMF] == pytest.approx(0.045 * 2 * np.pi / 2000)


@item("SV-004")
def test_edges_closer_than_2_us_are_lost():
    """SV 3.2: encoder transition rate 500 KHz at most."""
    _, host, (chip,) = servos(gains=gains(), plant=ServoPlant(coulomb_nm=0, inertia_kgm2=1.0))
    host.exchange(1, 0x7, [0x02])
    for speed, lost in ((490_000, False), (510_000, True)):
        chip.n[k.FAULTS] = 0
        chip.f[k.OMEGA] = speed
        before = host.position(1)
        tick(host, chip, 10)
        assert bool(chip.n[k.FAULTS]) == lost
        assert (host.position(1) - before > 2000) != lost


@item("SV-191", "SV-170")
@pytest.mark.parametrize("sign", [1, -1])
def test_position_wrap(sign):
    """SV 5.3: pos_wrap is set if the 32 bit position counter wraps around, until Clear Sticky Bits."""
    _, host, (chip,) = servos(gains=gains())
    host.exchange(1, 0x7, [0x02])
    edge = 0x7FFFFFFF if sign > 0 else -0x80000000
    chip.n[k.POS] = edge
    assert not aux(host) & 0x02
    chip.f[k.THETA] += sign * 5
    tick(host, chip)
    assert host.position(1) == edge + 5 * sign - sign * 2**32
    assert aux(host) & 0x02
    host.exchange(1, 0xB)
    assert not aux(host) & 0x02


# -- filter -----------------------------------------------------------------------------------------------------------


@item("SV-020", "SV-021", "SV-022", "SV-025", "SV-026", "X-01")
@pytest.mark.parametrize("goal", [100, -100, 3, 1000])
def test_pid_formula(goal):
    """SV 4.3: output = Kp e + Kd (e - e_prev) (sign: X-01) + Ki sum / 256; PWM = |output / 256|, Dir 1 below zero."""
    kp, kd, ki = 300, 2000, 700
    _, host, (chip,) = servos(gains=gains(kp, kd, ki, il=0x7FFF), plant=LOCKED)
    stop_here(host, goal)
    total = 0
    previous = 0
    for _ in range(50):
        n = tick(host, chip)
        total += goal
        output = kp * goal + kd * (goal - previous) + ki * (total >> 8)
        previous = goal
        assert n[k.OUTPUT] == output
        assert n[k.PWM] == min(abs(output) >> 8, 255)
        assert n[k.DIR] == (1 if output < 0 else 0)


@item("X-01")
def test_the_printed_sign_of_the_derivative_amplifies():
    """SV 4.3 prints - Kd(...): with e = command - actual that drives oscillation up; the prose calls it damping."""
    spread = {}
    for printed in (False, True):
        _, host, (chip,) = servos(gains=gains(220, 2640, 150, 4000, el=2000), derivative_as_printed=printed)
        stop_here(host, 40)
        host.wait_ms(300)
        spread[printed] = abs(chip.position - 40)
    assert spread[False] <= 2
    assert spread[True] > 100


@item("SV-023", "SV-024", "SV-133")
def test_the_running_sum_itself_is_bounded():
    """SV 4.3, 5.2: the sum is bounded by IL x 256, so there is no windup; IL = 0 zeroes it."""
    _, host, (chip,) = servos(gains=gains(kp=1, ki=1, il=10), plant=LOCKED)
    stop_here(host, 1000)
    n = tick(host, chip, 100)
    assert n[k.SUM] == 10 * 256
    stop_here(host, -1000)
    n = tick(host, chip, 2)
    assert 10 * 256 - n[k.SUM] in (2000, 3000, 4000, 5120)  # it comes down at once
    n = tick(host, chip, 10)
    assert n[k.SUM] == -10 * 256
    set_gain(host, *gains(kp=1, ki=1, il=0))
    assert tick(host, chip)[k.SUM] == 0


@item("SV-025", "SV-062")
@pytest.mark.parametrize("limit", [0, 127, 255])
def test_output_limit(limit):
    """SV 4.3, 4.5: the scaled output is limited by output_limit; in PWM mode the limit is ignored."""
    _, host, (chip,) = servos(gains=gains(kp=1000, ol=limit), plant=LOCKED)
    stop_here(host, 500)
    assert tick(host, chip)[k.PWM] == limit
    host.exchange(1, 0x4, [0x88, 200])
    assert tick(host, chip)[k.PWM] == 200


@item("SV-137")
def test_deadband_compensation_is_added_to_the_magnitude():
    """SV 5.2: the deadband value is added to the magnitude of the PWM output."""
    for deadband in (0, 17):
        _, host, (chip,) = servos(gains=gains(kp=256, deadband=deadband), plant=LOCKED)
        for goal, pwm in ((10, 10), (-10, 10), (250, 250)):
            stop_here(host, goal)
            assert tick(host, chip)[k.PWM] == min(255, pwm + deadband)
        stop_here(host, 0)
        assert tick(host, chip)[k.PWM] == 0


@item("SV-028", "SV-134", "SV-182", "X-05", "X-85")
@pytest.mark.parametrize("inverted", [False, True])
def test_current_limiting(inverted):
    """SV 4.3, 5.2: the adjustment grows by 1 a tick over the limit and shrinks by 1 under it; odd CL: high is over."""
    plant = ServoPlant(stop_low_counts=0.5, stop_high_counts=0.5, sense_inverted=inverted)
    limit = 154 if inverted else 101  # 2 A at 1 V/A is 102 of 255
    _, host, (chip,) = servos(gains=gains(kp=256, cl=limit), plant=plant)
    stop_here(host, 200)
    grown = [tick(host, chip)[k.ADJUST] for _ in range(400)]
    steps = np.diff(grown)
    assert set(steps) <= {-1, 0, 1}
    assert 1 in steps
    assert host.status(1) & 0x04
    assert chip.f[k.CURRENT] == pytest.approx(2.0, abs=0.15)
    assert 150 < max(grown) <= 200
    stop_here(host, 0)
    host.wait_ms(300)
    host.exchange(1, 0xB)
    assert not host.status(1) & 0x04
    assert tick(host, chip)[k.ADJUST] == 0


@item("SV-134")
def test_current_limit_zero_disables_it():
    """SV 5.2: setting CL to 0 effectively disables current limiting."""
    _, host, (chip,) = servos(gains=gains(kp=256, cl=0), plant=LOCKED)
    stop_here(host, 200)
    host.wait_ms(200)
    assert chip.n[k.ADJUST] == 0
    assert not host.status(1) & 0x04


@item("SV-028")
def test_adjustment_is_bounded_by_the_output():
    """SV 4.3: up to a maximum of min(abs(output / 256), output_limit)."""
    plant = ServoPlant(stop_low_counts=0.5, stop_high_counts=0.5, sense_inverted=True)
    for limit in (255, 60):
        _, host, (chip,) = servos(gains=gains(kp=256, ol=limit, cl=254), plant=plant)
        chip.f[k.SENSE_BASE] = 0.0  # the sense input reads 'over' whatever flows
        stop_here(host, 100)
        n = tick(host, chip, 400)
        assert n[k.ADJUST] == min(100, limit)
        assert n[k.PWM] == 0


@item("SV-136")
def test_current_limiting_runs_at_the_full_rate():
    """SV 5.2: command processing and current limiting are always performed at the maximum tick rate."""
    plant = ServoPlant(stop_low_counts=0.5, stop_high_counts=0.5, sense_inverted=True)
    _, host, (chip,) = servos(gains=gains(kp=256, cl=254, sr=50), plant=plant)
    chip.f[k.SENSE_BASE] = 0.0
    stop_here(host, 200)
    tick(host, chip, 60)
    first = tick(host, chip)[k.ADJUST]
    assert tick(host, chip, 5)[k.ADJUST] == first + 5
    before = host.link.now_ns()
    host.exchange(1, 0xE)
    assert host.link.now_ns() - before < 1_600_000


@item("SV-029", "SV-184", "SV-061")
@pytest.mark.parametrize(("error", "off"), [(100, False), (101, True), (-100, False), (-101, True)])
def test_position_error_limit(error, off):
    """SV 4.3: if abs(pos_error) becomes larger than the limit, the servo is disabled: PWM 0, pos_error."""
    _, host, (chip,) = servos(gains=gains(kp=100, el=100), plant=LOCKED)
    stop_here(host, error)
    n = tick(host, chip, 2)
    assert bool(n[k.SERVO_ON]) != off
    assert bool(host.status(1) & 0x10) == off
    assert (n[k.PWM] == 0) == off
    host.exchange(1, 0xB)
    assert bool(host.status(1) & 0x10) == off  # set whenever the servo is off


@item("X-84")
def test_any_error_trips_while_the_limit_is_zero():
    """Choice: EL = 0 after power-up, so Set Gain comes first."""
    _, host, (chip,) = servos(gains=gains(el=0), plant=LOCKED)
    stop_here(host, 1)
    assert not tick(host, chip, 2)[k.SERVO_ON]


@item("SV-031", "SV-130", "SV-131", "X-04")
def test_set_gain_fields():
    """SV 5.2: Kp, Kd, Ki, IL 16 bit, OL, CL 8 bit, EL 16 bit, SR, deadband; 13 bytes leave the deadband zero."""
    sim, host, (chip,) = servos(gains=gains(), plant=LOCKED)
    values = (1, 0x7FFF, 3, 4, 5, 6, 0x3FFF, 7, 8)
    registers = (k.KP, k.KD, k.KI, k.IL, k.OL, k.CL, k.EL, k.SR, k.DEADBAND)
    set_gain(host, *values)
    assert tuple(int(chip.n[r]) for r in registers) == values
    host.exchange(1, 0x6, struct.pack("<HHHHBBHB", *values[:-1]))
    assert tuple(int(chip.n[r]) for r in registers) == (*values[:-1], 0)
    assert rules(sim) == []
    host.exchange(1, 0x6, bytes(15))
    assert rules(sim) == ["X-04"]
    assert chip.n[k.KD] == 0x7FFF


@item("SV-130")
@pytest.mark.parametrize("field", range(8))
def test_set_gain_ranges(field):
    """SV 5.2: gains 0..0x7FFF, EL 0..0x3FFF, SR 1..0xFF."""
    values = list(gains())
    values[field] = {6: 0x4000, 7: 0}.get(field, 0x8000)
    if field in (4, 5):
        return
    sim, host, (chip,) = servos(gains=gains(), plant=LOCKED)
    set_gain(host, *values)
    assert rules(sim) == ["SV-130"]
    assert chip.n[k.SR] == 1
    assert chip.n[k.EL] <= 0x3FFF
    assert chip.n[k.KP] <= 0x7FFF


@item("SV-132")
@pytest.mark.parametrize(("version", "deadband"), [(3, 0), (4, 9)])
def test_versions_1_to_3_ignore_the_14th_byte(version, deadband):
    """SV 5.2."""
    _, host, (chip,) = servos(gains=gains(deadband=9), plant=LOCKED, version=version)
    assert chip.n[k.DEADBAND] == deadband
    assert host.items(1, 0x20, 2) == bytes([0, version])


# -- PWM mode, power, reset -------------------------------------------------------------------------------------------


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
    assert bool(aux(host) & 0x04) == on


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


# -- commands ---------------------------------------------------------------------------------------------------------


@item("SV-100", "SV-101", "SV-172")
def test_reset_position():
    """SV 5.2: encoder counter and command position become 0, so the motor does not jump; not during a trapezoid."""
    sim, host, (chip,) = servos()
    host.exchange(1, 0x4, [0x97, *i32(3000), *i32(10 * 65536), *i32(655)])
    host.wait_ms(1500)
    assert host.position(1) == 3000
    host.exchange(1, 0x0)
    host.wait_ms(50)
    assert host.position(1) == 0
    assert chip.mechanical_counts == pytest.approx(3000.5, abs=1)
    assert rules(sim) == []
    host.exchange(1, 0x4, [0x97, *i32(3000), *i32(65536), *i32(655)])
    host.wait_ms(50)
    host.exchange(1, 0x0)
    assert rules(sim) == ["SV-101"]


@item("X-02")
@pytest.mark.parametrize("accepted", [False, True])
def test_reset_position_with_a_data_byte(accepted):
    """SV 5.1 table says 0 or 1 bytes, 5.2 says 0. Choice: relative to home behind an option, else refused."""
    sim, host, _ = servos(options=SimOptions(reset_relative_home=accepted))
    stop_here(host, 100)
    host.wait_ms(100)
    host.exchange(1, 0xC)
    stop_here(host, 150)
    host.wait_ms(100)
    before = host.position(1)
    host.exchange(1, 0x0, [0x01])
    assert host.position(1) == before - (host.home(1) if accepted else 0)
    assert host.home(1) == pytest.approx(100, abs=8)
    assert rules(sim) == ([] if accepted else ["X-02"])


@item("SV-102", "X-87")
@pytest.mark.parametrize(("speed", "sent"), [(10, -10), (-10, 10), (0, 0)])
def test_velocity_item_is_negated(speed, sent):
    """SV 5.2: the signed 16 bit integer returned is the negative of the velocity in counts per servo tick."""
    _, host, (chip,) = servos()
    host.exchange(1, 0x4, [0xB6 | (0x40 if speed < 0 else 0), *i32(abs(speed) * 65536), *i32(6553)])
    host.wait_ms(500)
    seen = struct.unpack("<h", host.items(1, 0x04, 2))[0]
    assert abs(seen - sent) <= 1
    chip.n[k.MEASURED] = 40_000
    assert chip.status_item(2) == struct.pack("<h", -0x8000)
    chip.n[k.MEASURED] = -40_000
    assert chip.status_item(2) == struct.pack("<h", 0x7FFF)


@item("SV-104", "X-94")
def test_type_and_version():
    """SV 3.4, 5.2: PIC-SERVO device ID = 0; the sheet is that of version 4."""
    _, host, _ = servos()
    assert host.items(1, 0x20, 2) == bytes([0, 4])


@item("N-075")
def test_analog_item():
    """SV 5.2: A/D value, 1 byte: here the current sense, 1 V/A."""
    _, host, _ = servos(gains=gains(kp=256), plant=LOCKED)
    stop_here(host, 32)
    host.wait_ms(50)
    assert host.items(1, 0x02, 1)[0] == pytest.approx(24 * 32 / 255 / 1.5 * 51, abs=1)


@item("SV-140", "SV-141", "SV-147", "X-03")
def test_stop_motor_lengths_and_amp_en():
    """SV 5.2: 1 or 5 bytes; bit 0 is AMP_EN regardless of the others. X-03: bit 4 with one byte is refused."""
    sim, host, (chip,) = servos(gains=gains(), plant=LOCKED)
    for control in (0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x08, 0x09):
        host.exchange(1, 0x7, [control])
        assert chip.n[k.AMP] == control & 1
    host.exchange(1, 0x7, [0x05, *i32(77)])
    assert chip.n[k.COMMAND] >> 16 == 0
    assert rules(sim) == []
    host.exchange(1, 0x7, [0x11])
    assert rules(sim) == ["X-03"]


@item("SV-142", "SV-146")
def test_motor_off_wins_over_the_other_bits():
    """SV 5.2: if bit 1 is set, the servo is disabled, PWM 0, bits 2, 3, 4 ignored; only one should be set."""
    sim, host, (chip,) = servos()
    host.exchange(1, 0x7, [0x0F])
    assert not chip.n[k.SERVO_ON]
    host.exchange(1, 0x7, [0x21])
    assert rules(sim) == ["SV-146", "SV-146"]


@item("SV-143")
def test_stop_abruptly_holds_the_position():
    """SV 5.2: command velocity and goal velocity 0, servo enabled, velocity mode."""
    _, host, (chip,) = servos()
    host.exchange(1, 0x4, [0xB6, *i32(10 * 65536), *i32(655)])
    host.wait_ms(600)
    host.exchange(1, 0x7, [0x05])
    held = chip.command_position
    assert (chip.n[k.VELOCITY], chip.n[k.GOAL_VELOCITY], chip.n[k.MODE]) == (0, 0, k.MODE_VELOCITY)
    host.wait_ms(300)
    assert chip.command_position == held
    assert abs(chip.position - held) <= 10
    assert host.status(1) & 0x01


@item("SV-144", "X-83")
def test_stop_smoothly_decelerates():
    """SV 5.2: goal velocity 0 at the current acceleration; move_done is 0 until velocity 0."""
    _, host, (chip,) = servos()
    host.exchange(1, 0x4, [0xB6, *i32(10 * 65536), *i32(6554)])
    host.wait_ms(600)
    host.exchange(1, 0x7, [0x09])
    started = int(chip.n[k.TICK])
    assert not host.status(1) & 0x01
    while not chip.n[k.MOVE_DONE]:
        tick(host, chip)
    assert chip.n[k.TICK] - started == 100  # 10 counts/tick at 0.1 counts/tick^2
    assert host.status(1) & 0x01


@item("SV-145", "X-80")
def test_stop_here():
    """SV 5.2: moves to the given position abruptly without profiling; a stream of them is tracked; too far trips EL."""
    _, host, (chip,) = servos()
    for goal in (10, 25, 60, 30, -40):
        stop_here(host, goal)
        assert chip.n[k.COMMAND] >> 16 == goal
        assert chip.n[k.MODE] == k.MODE_VELOCITY
        assert host.status(1) & 0x01
        host.wait_ms(60)
        assert abs(host.position(1) - goal) <= 2
    stop_here(host, 5000)
    tick(host, chip, 2)
    assert not chip.n[k.SERVO_ON]


@item("SV-145")
def test_version_1_has_no_stop_here():
    """SV 5.2: not available on version 1."""
    sim, host, (chip,) = servos(gains=gains(), plant=LOCKED, version=1)
    stop_here(host, 50)
    assert chip.n[k.COMMAND] == 0
    assert rules(sim) == ["SV-145"]


@item("SV-150", "SV-185")
def test_io_control():
    """SV 5.2: bits 0, 1 output values, bits 2, 3 directions of the limit pins, 0 = output; inputs by default."""
    sim, host, (chip,) = servos(switches=(Switch("limit1", 0, None),))
    tick(host, chip)
    assert host.status(1) & 0x60 == 0x20
    for control in range(16):
        host.exchange(1, 0x8, [control])
        tick(host, chip)
        limit1 = True if control & 4 else bool(control & 1)
        limit2 = False if control & 8 else bool(control & 2)
        assert host.status(1) & 0x60 == limit1 << 5 | limit2 << 6
    assert rules(sim) == []
    host.exchange(1, 0x8, [0xF0])
    assert rules(sim) == ["SV-150"]


@item("SV-162", "SV-186", "N-076", "N-085", "X-92")
def test_save_as_home():
    """SV 5.2: the current position is saved; choice: that of the end of the tick in which the command executes."""
    _, host, (chip,) = servos()
    host.exchange(1, 0x4, [0xB6, *i32(10 * 65536), *i32(6554)])
    host.wait_ms(300)
    host.exchange(1, 0xC)
    latched = int(chip.n[k.POS])
    assert host.home(1) == latched
    assert latched > 1000


HOMING = [
    pytest.param(0x01, "limit1", marks=item("SV-160")),
    pytest.param(0x02, "limit2", marks=item("SV-160")),
    pytest.param(0x08, "index", marks=item("SV-160")),
]


@pytest.mark.parametrize(("flag", "source"), HOMING)
@pytest.mark.parametrize(
    ("manner", "after"),
    [
        pytest.param(0x00, "moving", marks=item("SV-162")),
        pytest.param(0x04, "off", marks=item("SV-161")),
        pytest.param(0x10, "abrupt", marks=item("SV-161", "SV-163")),
        pytest.param(0x20, "smooth", marks=item("SV-161")),
    ],
)
def test_homing(flag, source, manner, after):
    """SV 5.2: capture on change of Limit1, Limit2, Index; stop in one of three manners (version 3 and higher)."""
    switches = () if source == "index" else (Switch(source, 500, None),)
    plant = ServoPlant(index_at_counts=500)
    sim, host, (chip,) = servos(switches=switches, plant=plant)
    host.exchange(1, 0x4, [0x36, *i32(2 * 65536), *i32(655)])
    host.exchange(1, 0x9, [flag | manner])
    assert host.status(1) & 0x80
    host.exchange(1, 0x5)
    host.wait_ms(150)
    assert host.status(1) & 0x80
    host.wait_ms(400)
    assert not host.status(1) & 0x80
    assert host.home(1) == pytest.approx(501, abs=2)  # 2 counts a tick
    if after == "moving":
        assert chip.n[k.GOAL_VELOCITY] != 0
    elif after == "off":
        assert not chip.n[k.SERVO_ON]
    else:
        assert (chip.n[k.SERVO_ON], chip.n[k.VELOCITY]) == (1, 0)
        over = (int(chip.n[k.COMMAND]) >> 16) - 501
        assert (50 < over < 500) if after == "smooth" else (-1 <= over < 10)
    assert rules(sim) == []


@item("SV-161")
def test_before_version_3_homing_does_not_stop():
    """SV 5.2: with versions 1 & 2 the user must stop the motor explicitly."""
    _, host, (chip,) = servos(switches=(Switch("limit1", 500, None),), version=2)
    host.exchange(1, 0x9, [0x11])
    host.exchange(1, 0x4, [0xB6, *i32(2 * 65536), *i32(655)])
    host.wait_ms(800)
    assert host.home(1) == pytest.approx(501, abs=2)
    assert chip.n[k.VELOCITY] == 2 * 65536


@item("SV-160")
def test_homing_on_position_error():
    """SV 4.3, 5.2 bit 6: running the motor up against a stop."""
    plant = ServoPlant(stop_high_counts=800.5)
    _, host, (chip,) = servos(gains=(*FIRM_GAINS[:6], 200, 1, 0), plant=plant)
    host.exchange(1, 0x9, [0x40])
    host.exchange(1, 0x4, [0xB6, *i32(65536), *i32(655)])
    host.wait_ms(1500)
    assert host.home(1) == 800
    assert not chip.n[k.SERVO_ON]
    assert not host.status(1) & 0x80


@item("SV-160")
def test_homing_on_current_limiting():
    """SV 5.2 bit 7: capture when current limiting occurs, here against a stop, and hold there."""
    plant = ServoPlant(stop_high_counts=800.5)
    _, host, (chip,) = servos(gains=(*FIRM_GAINS[:5], 101, 4000, 1, 0), plant=plant)
    host.exchange(1, 0x9, [0x90])
    host.exchange(1, 0x4, [0xB6, *i32(65536), *i32(655)])
    host.wait_ms(1500)
    assert host.home(1) == 800
    assert chip.n[k.SERVO_ON]
    assert chip.n[k.VELOCITY] == 0


@item("SV-161")
def test_two_manners_of_stopping_at_home_are_logged():
    """SV 5.2: one and only one of bits 2, 4 or 5."""
    sim, host, _ = servos()
    host.exchange(1, 0x9, [0x31])
    assert rules(sim) == ["SV-161"]


@item("SV-171", "X-41")
def test_command_d_is_reserved():
    """SV 5.1."""
    sim, host, _ = servos()
    assert len(host.exchange(1, 0xD)) == 1
    assert rules(sim) == ["X-41"]


# -- status -----------------------------------------------------------------------------------------------------------


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
        assert bool(aux(host) & 0x01) != high


@item("SV-192")
def test_servo_on_bit():
    """SV 5.3 aux bit 2."""
    _, host, _ = servos()
    assert aux(host) & 0x04
    host.exchange(1, 0x7, [0x03])
    assert not aux(host) & 0x04


@item("SV-195", "SV-170")
def test_servo_overrun_is_sticky_and_lengthens_the_tick():
    """SV 5.3 aux bit 5: typically not serious, only a small fraction of a millisecond of delay to the tick."""
    sim, host, (chip,) = servos()
    before = chip.clock.tick_at(sim.world.now_ns)
    host.send(1, 0xE)
    chip.inject_overrun(100_000)
    assert len(host.listen()) == 1
    assert aux(host) & 0x20
    host.wait_ms(51.2)
    assert chip.clock.tick_at(sim.world.now_ns) - before >= 100
    assert aux(host) & 0x20
    host.exchange(1, 0xB)
    assert not aux(host) & 0x20
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
