"""The simulated PIC-SERVO's time and its PIC-ENC (data sheet 3, 4.1, 4.2).

Figures are the data sheet's own (version 4), or follow from them by the arithmetic shown.
"""

import numpy as np
import pytest

from sim import servokernel as k
from sim.rawhost import i32, machine, servos
from sim.rawservo import LOCKED, auxiliary, gains, tick
from sim.spec import ServoModule, ServoPlant
from sim.uart import chip_baud

item = pytest.mark.item


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
    assert sim.rules() == ["N-022"]
    assert chip.mask == 0


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
    assert not auxiliary(host) & 0x02
    chip.f[k.THETA] += sign * 5
    tick(host, chip)
    assert host.position(1) == edge + 5 * sign - sign * 2**32
    assert auxiliary(host) & 0x02
    host.exchange(1, 0xB)
    assert not auxiliary(host) & 0x02
