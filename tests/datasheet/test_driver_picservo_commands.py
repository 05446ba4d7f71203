"""Stopping, homing, status and the other commands of a PIC-SERVO, by its data sheet (version 4)."""

from __future__ import annotations

import pytest

from nmc.chips import picservo
from nmc.codec import decode_status
from nmc.errors import LocalFault, RemoteFault
from nmc.picservo import Gains, PicServo
from nmc.program import Exchange
from sim.spec import ServoModule, ServoPlant

item = pytest.mark.item
GAINS = Gains(220, 2640, 150, 4000)
S = 1_000_000_000


# -- stopping ----------------------------------------------------------------------------------------------------------


@item("SV-140", "SV-141", "SV-142", "SV-143", "SV-144", "SV-145", "SV-147", "X-03")
def test_stop_motor_bytes(servo: PicServo, servo_rig) -> None:
    """SV 5.2: 0x17 with bits 0 amplifier, 1 off, 2 abrupt, 3 smooth; 0x57 with bit 4 and a position."""
    for manner, amplifier, byte in (
        (None, True, 0x01),
        ("motor_off", True, 0x03),
        ("motor_off", False, 0x02),
        ("abruptly", True, 0x05),
        ("smoothly", True, 0x09),
    ):
        servo.stop_motor(manner, amplifier=amplifier)  # type: ignore[arg-type]
        assert servo_rig.last() == bytes([0x17, byte])
    servo.stop_here(-2)
    assert servo_rig.last() == bytes.fromhex("57 11 FEFFFFFF")


@item("SV-146", "X-03")
@pytest.mark.parametrize("data", ["06", "0C", "0E", "20", "40", "80", "10", "11", "05 00000000", "19 00000000"])
def test_stop_motor_combinations_that_must_not_be_sent(servo: PicServo, servo_rig, data: str) -> None:
    """SV 5.2: only one of bits 1, 2, 3 and 4; 5 to 7 clear; a position with bit 4 and only then."""
    before = servo_rig.count()
    with pytest.raises(LocalFault):
        servo_rig.bus.exchange(Exchange(1, 7, bytes.fromhex(data)))
    assert servo_rig.count() == before


@item("SV-067", "SV-066")
def test_power_and_position_error_are_looked_at_before_a_move(make_servo_rig) -> None:
    """SV 4.5: the host should be sure to monitor these status bits before issuing additional move commands."""
    servo_rig = make_servo_rig(ServoModule("x", plant=ServoPlant(supply_v=0.0)))
    servo_rig.servo.set_gain(GAINS)
    with pytest.raises(RemoteFault, match="power is off"):
        servo_rig.servo.require_ready()
    servo_rig = make_servo_rig()
    with pytest.raises(RemoteFault, match="disabled"):
        servo_rig.servo.require_ready()
    servo_rig.ready().require_ready()


@item("SV-007")
def test_a_motion_command_is_answered_at_once(servo: PicServo, servo_rig) -> None:
    """SV 4.1: motion commands initiate the motion and return a status packet immediately."""
    before_ns = servo_rig.link.now_ns()
    status = servo.load_trajectory(position=60_000, velocity=5 * 65536, acceleration=900, start_now=True)
    assert servo_rig.link.now_ns() - before_ns < 4_000_000
    assert "move_done" not in status.flags


# -- other commands ----------------------------------------------------------------------------------------------------


@item("SV-150")
def test_io_control_bytes(servo_rig) -> None:
    """SV 5.2: bits 0, 1 output values, bits 2, 3 directions (1 = input), 4 to 7 clear."""
    servo_rig.servo.io_control()
    assert servo_rig.last() == b"\x18\x0c"
    servo_rig.servo.io_control(limit1_output=True, limit1_is_input=False)
    assert servo_rig.last() == b"\x18\x09"
    servo_rig.servo.io_control(limit2_output=True, limit2_is_input=False)
    assert servo_rig.last() == b"\x18\x06"
    with pytest.raises(LocalFault):
        servo_rig.bus.exchange(Exchange(1, 8, b"\x10"))


@item("SV-160", "SV-161", "SV-163")
@pytest.mark.parametrize(
    ("events", "stop", "byte"),
    [
        (("limit1",), "none", 0x01),
        (("limit2",), "motor_off", 0x06),
        (("index",), "smoothly", 0x28),
        (("limit1", "limit2"), "abruptly", 0x13),
        (("position_error",), "none", 0x40),
        (("current_limit",), "abruptly", 0x90),
    ],
)
def test_homing_bytes(servo_rig, events: tuple[str, ...], stop: str, byte: int) -> None:
    """SV 5.2, Set Homing Mode: 0x19 and the control byte."""
    servo_rig.servo.set_homing_mode(*events, stop=stop)  # type: ignore[arg-type]
    assert servo_rig.last() == bytes([0x19, byte])
    with pytest.raises(LocalFault, match="only one"):
        servo_rig.bus.exchange(Exchange(1, 9, b"\x15"))


@item("SV-161")
def test_automatic_stops_need_version_3(make_servo_rig) -> None:
    """SV 5.2: don't care in versions 1 and 2."""
    servo_rig = make_servo_rig(ServoModule("x", version=2))
    with pytest.raises(LocalFault, match="version 3"):
        servo_rig.servo.set_homing_mode("index", stop="abruptly")
    servo_rig.servo.set_homing_mode("index")


@item("SV-162")
def test_home_is_searched_and_read(make_servo_rig) -> None:
    """SV 5.2: home_in_progress is set by the command and lowered once the position has been captured."""
    servo_rig = make_servo_rig(ServoModule("x", plant=ServoPlant(index_at_counts=300)))
    servo = servo_rig.ready()
    assert "home_in_progress" in servo.set_homing_mode("index").flags
    found = servo.find_home("index", velocity=65536, acceleration=900, reverse=False, timeout_ns=3 * S)
    assert abs(found.home_position - 300) <= 4


@item("SV-170", "SV-171", "X-41")
def test_clear_bits_and_the_reserved_command(servo_rig) -> None:
    """SV 5.1: 0x0B clears the sticky bits, 0xD is reserved."""
    servo_rig.servo.clear_sticky_bits()
    assert servo_rig.last() == b"\x0b"
    with pytest.raises(LocalFault, match="not defined"):
        servo_rig.bus.exchange(Exchange(1, 0xD))


# -- status ------------------------------------------------------------------------------------------------------------


@item("SV-102", "SV-103")
def test_velocity_comes_negated_and_is_turned_round(servo: PicServo, servo_rig) -> None:
    """SV 5.2: the signed 16 bit integer returned is the negative of the velocity."""
    servo.load_trajectory(velocity=6 * 65536, acceleration=3000, velocity_mode=True, start_now=True)
    servo.wait_until_done(S)
    assert servo.velocity() > 0
    assert servo.read("velocity") < 0
    assert picservo.FACTS.status_bytes[0x04 | 0x08] == 3


@item("SV-180", "SV-181", "SV-182", "SV-183", "SV-184", "SV-185", "SV-186")
def test_status_bits_in_words() -> None:
    """SV 5.3: the eight bits of the status byte."""
    names = ["move_done", "checksum_error", "overcurrent", "power_on", "position_error", "limit1", "limit2"]
    for bit, name in enumerate([*names, "home_in_progress"]):
        assert decode_status(picservo.FACTS, 1 << bit, 0, b"").flags == {name}


@item("SV-190", "SV-191", "SV-192", "SV-193", "SV-194", "SV-195")
def test_auxiliary_bits_in_words() -> None:
    """SV 5.3: index (complement), pos_wrap, servo_on, accel_done, slew_done, servo_overrun."""
    names = ["index", "position_wrap", "servo_on", "accel_done", "slew_done", "servo_overrun"]
    for bit, name in enumerate(names):
        values = decode_status(picservo.FACTS, 0, 0x08, bytes([1 << bit])).values
        assert [key for key, value in values.items() if "." in key and value] == [f"auxiliary.{name}"]
