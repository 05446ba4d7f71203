"""The simulated PIC-SERVO's commands (data sheet 5.1, 5.2); loads and profiles have their own file."""

import struct

import pytest

from sim import servokernel as k
from sim.rawhost import i32, servos
from sim.rawservo import LOCKED, gains, stop_here, tick
from sim.spec import SimOptions, Switch

item = pytest.mark.item


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
    assert sim.rules() == []
    host.exchange(1, 0x4, [0x97, *i32(3000), *i32(65536), *i32(655)])
    host.wait_ms(50)
    host.exchange(1, 0x0)
    assert sim.rules() == ["SV-101"]


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
    assert sim.rules() == ([] if accepted else ["X-02"])


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
    assert sim.rules() == []
    host.exchange(1, 0x7, [0x11])
    assert sim.rules() == ["X-03"]


@item("SV-142", "SV-146")
def test_motor_off_wins_over_the_other_bits():
    """SV 5.2: if bit 1 is set, the servo is disabled, PWM 0, bits 2, 3, 4 ignored; only one should be set."""
    sim, host, (chip,) = servos()
    host.exchange(1, 0x7, [0x0F])
    assert not chip.n[k.SERVO_ON]
    host.exchange(1, 0x7, [0x21])
    assert sim.rules() == ["SV-146", "SV-146"]


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
    assert sim.rules() == ["SV-145"]


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
    assert sim.rules() == []
    host.exchange(1, 0x8, [0xF0])
    assert sim.rules() == ["SV-150"]


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


@item("SV-171", "X-41")
def test_command_d_is_reserved():
    """SV 5.1."""
    sim, host, _ = servos()
    assert len(host.exchange(1, 0xD)) == 1
    assert sim.rules() == ["X-41"]
