"""The simulated PIC-SERVO's control filter, limits and Set Gain (data sheet 4.3, 5.2).

Figures are the data sheet's own (version 4), or follow from them by the arithmetic shown.
"""

import struct

import numpy as np
import pytest

from sim import servokernel as k
from sim.rawhost import servos
from sim.rawservo import LOCKED, gains, set_gain, stop_here, tick
from sim.spec import ServoPlant

item = pytest.mark.item


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
    assert sim.rules() == []
    host.exchange(1, 0x6, bytes(15))
    assert sim.rules() == ["X-04"]
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
    assert sim.rules() == ["SV-130"]
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
