"""Units, gains and trajectories of a PIC-SERVO as the driver sends them, by its data sheet (version 4)."""

from __future__ import annotations

import pytest

from nmc.chips import picservo
from nmc.codec import encode
from nmc.errors import LocalFault
from nmc.picservo import Gains, PicServo
from nmc.program import Exchange
from sim.spec import ServoModule

item = pytest.mark.item
GAINS = Gains(220, 2640, 150, 4000)
S = 1_000_000_000


# -- facts and units ---------------------------------------------------------------------------------------------------


@item("SV-001", "SV-002", "SV-052")
def test_rates() -> None:
    """SV 3.1: servo rate 1953.12 Hz (tick 0.512 ms), PWM 19531.2 Hz; SV 4.3: SR = 3 gives 651 Hz, least 7.6 Hz."""
    assert pytest.approx(1953.12, abs=0.01) == picservo.SERVO_RATE_HZ
    assert pytest.approx(19531.2, abs=0.1) == picservo.PWM_HZ
    assert pytest.approx(651, abs=0.1) == picservo.SERVO_RATE_HZ / 3
    assert pytest.approx(7.66, abs=0.1) == picservo.SERVO_RATE_HZ / picservo.SERVO_RATE_DIVISOR_MAX


@item("SV-049", "SV-050", "SV-051")
def test_units_of_velocity_and_acceleration() -> None:
    """SV 4.4: 1 rev/s at 2000 counts/rev is 1.024 counts/tick = 67,109; 4 rev/s2 is 0.0021 counts/tick2 = 137."""
    tick_s = picservo.TICK_NS * 1e-9
    assert round(2000 * tick_s * picservo.FRACTION) == 67_109
    assert int(4 * 2000 * tick_s**2 * picservo.FRACTION) == 137


@item("SV-031", "SV-130", "SV-131", "SV-132", "SV-133")
def test_set_gain_bytes(servo_rig, make_servo_rig) -> None:
    """SV 5.2: 0xE6 and 14 bytes, Kp Kd Ki IL OL CL EL SR deadband; 0xD6 and 13 bytes for versions 1 to 3."""
    servo_rig.servo.set_gain(Gains(0x0102, 0x0304, 0x0506, 0x0708, 9, 10, 0x0B0C, 13, 14))
    assert servo_rig.last() == bytes.fromhex("E6 0201 0403 0605 0807 09 0A 0C0B 0D 0E")
    old = make_servo_rig(ServoModule("x", version=3))
    old.servo.set_gain(GAINS)
    assert old.last()[0] == 0xD6
    assert len(old.last()) == 14
    with pytest.raises(LocalFault, match="version 4"):
        old.servo.set_gain(Gains(1, 1, 1, 1, deadband=1))


@item("SV-130", "X-04")
@pytest.mark.parametrize(
    "bad",
    [
        {"position_gain": 0x8000},
        {"velocity_gain": -1},
        {"integral_gain": 0x8000},
        {"integration_limit": 0x8000},
        {"output_limit": 256},
        {"current_limit": 256},
        {"position_error_limit": 0x4000},
        {"servo_rate_divisor": 0},
        {"servo_rate_divisor": 256},
        {"deadband": 256},
    ],
)
def test_gain_ranges(servo_rig, bad: dict[str, int]) -> None:
    """SV 5.2: gains 0 to 0x7FFF, EL 0 to 0x3FFF, SR 1 to 0xFF."""
    values = {"position_gain": 1, "velocity_gain": 1, "integral_gain": 1, "integration_limit": 1} | bad
    before = servo_rig.count()
    with pytest.raises(LocalFault, match="outside"):
        servo_rig.servo.set_gain(Gains(**values))
    assert servo_rig.count() == before
    with pytest.raises(LocalFault):
        servo_rig.bus.exchange(Exchange(1, 6, bytes(15)))


# -- load trajectory ---------------------------------------------------------------------------------------------------


@item("SV-110", "SV-111", "SV-112", "SV-113", "SV-114", "SV-115", "SV-116", "SV-117", "SV-118", "SV-119", "X-30")
@pytest.mark.parametrize(
    ("values", "packet"),
    [
        ({"position": 0x01020304}, "54 01 04030201"),
        ({"velocity": 0x11}, "54 02 11000000"),
        ({"acceleration": 0x22}, "54 04 22000000"),
        ({"pwm": 0x33}, "24 08 33"),
        ({"servo_mode": 1}, "14 10"),
        ({"velocity_mode": 1}, "14 20"),
        ({"reverse": 1}, "14 40"),
        ({"start_now": 1}, "14 80"),
        ({"position": -1, "velocity": 2, "acceleration": 3, "pwm": 4}, "E4 0F FFFFFFFF 02000000 03000000 04"),
        ({"position": 1, "velocity": 2, "acceleration": 3, "servo_mode": 1, "start_now": 1}, None),
    ],
)
def test_load_trajectory_bytes(values: dict[str, int], packet: str | None) -> None:
    """SV 5.2: 0xn4 with 1 to 14 bytes; 0x97 is what other hosts send for a trapezoid that starts now."""
    code, data = encode(picservo.FACTS, "load_trajectory", values)
    expected = packet or "D4 97 01000000 02000000 03000000"
    assert bytes([len(data) << 4 | code]) + data == bytes.fromhex(expected)


@item("SV-120", "N-017")
def test_the_sheets_example() -> None:
    """SV 5.2: only new position and acceleration, not started: 0x94, 0x15, 4 bytes, 4 bytes."""
    code, data = encode(picservo.FACTS, "load_trajectory", {"position": 1000, "acceleration": 100, "servo_mode": 1})
    assert (len(data) << 4 | code, data[0]) == (0x94, 0x15)
    assert data[1:] == bytes.fromhex("E8030000 64000000")


@item("SV-121", "SV-122", "SV-123")
@pytest.mark.parametrize(
    "bad",
    [
        {"position": -0x80000000},
        {"position": 0x80000000},
        {"velocity": -1},
        {"velocity": 0x80000000},
        {"acceleration": 0x80000000},
        {"pwm": 256},
    ],
)
def test_load_ranges(servo: PicServo, servo_rig, bad: dict[str, int]) -> None:
    """SV 5.2: position +/-0x7FFFFFFF, velocity and acceleration 0 to 0x7FFFFFFF, PWM 0 to 0xFF."""
    before = servo_rig.count()
    with pytest.raises(LocalFault, match="outside"):
        servo.load_trajectory(**bad)
    assert servo_rig.count() == before


@item("SV-121")
def test_the_goal_is_not_too_far(servo: PicServo, servo_rig) -> None:
    """SV 5.2: the goal should not differ from the current position by more than 0x7FFFFFFF."""
    servo.stop_here(-20)
    servo_rig.link.sleep_until(servo_rig.link.now_ns() + S)
    assert servo.position() < 0
    before = servo_rig.count()
    with pytest.raises(LocalFault, match="0x7FFFFFFF"):
        servo.load_trajectory(position=0x7FFFFFFF, velocity=1, acceleration=1)
    with pytest.raises(LocalFault, match="0x7FFFFFFF"):
        servo.stop_here(0x7FFFFFFF)
    assert servo_rig.count() == before


@item("SV-043", "SV-124", "SV-126", "X-07")
def test_a_trapezoid_is_not_changed_while_it_runs(servo: PicServo, servo_rig) -> None:
    """SV 4.4: erratic and potentially damaging; SV 5.1, note 1."""
    servo.load_trajectory(position=20_000, velocity=5 * 65536, acceleration=500, start_now=True)
    before = servo_rig.count()
    for change in ({"position": 100}, {"velocity": 65536}, {"acceleration": 5}, {"servo_mode": False, "pwm": 10}):
        with pytest.raises(LocalFault, match="while moving"):
            servo.load_trajectory(start_now=True, **change)
    assert servo_rig.count() == before
    assert servo_rig.simulation.violations == []


@item("SV-046", "SV-047", "SV-126", "SV-172")
def test_velocity_mode_may_be_entered_and_changed_while_moving(servo: PicServo, servo_rig) -> None:
    """SV 4.4: goal velocity and acceleration may change at any time; velocity mode may be entered in a trapezoid."""
    servo.load_trajectory(position=20_000, velocity=5 * 65536, acceleration=500, start_now=True)
    for velocity in (3 * 65536, 6 * 65536, 65536):
        servo.load_trajectory(velocity=velocity, acceleration=900, velocity_mode=True, start_now=True)
    servo.load_trajectory(position=0, velocity=5)  # buffered: allowed
    servo.stop_motor("smoothly")
    assert servo_rig.simulation.violations == []


@item("SV-125", "SV-127")
def test_start_motion_while_moving_only_for_velocity_mode(servo: PicServo, servo_rig) -> None:
    """SV 5.1, note 2: only if the previously loaded trajectory has the profile mode bit set for velocity mode."""
    with pytest.raises(LocalFault, match="old load"):
        servo.start_motion()
    servo.load_trajectory(velocity=4 * 65536, acceleration=900, velocity_mode=True)
    assert "move_done" in servo.no_operation().flags, "without bit 7 nothing happens yet"
    servo.start_motion()
    servo.load_trajectory(position=100, velocity=65536, acceleration=100)
    with pytest.raises(LocalFault, match="while moving"):
        servo.start_motion()
    servo.load_trajectory(velocity=65536, velocity_mode=True)
    servo.start_motion()
    assert servo_rig.simulation.violations == []


@item("SV-101", "SV-100")
def test_reset_position_not_while_moving(servo: PicServo, servo_rig) -> None:
    """SV 5.1: while moving? no."""
    servo.load_trajectory(position=3000, velocity=5 * 65536, acceleration=900, start_now=True)
    with pytest.raises(LocalFault, match="while moving"):
        servo.reset_position()
    servo.wait_until_done(5 * S)
    servo_rig.link.sleep_until(servo_rig.link.now_ns() + S)
    servo.reset_position()
    assert servo_rig.last() == b"\x00"
    assert abs(servo.position()) <= 3


@item("X-02")
def test_reset_position_carries_no_data(servo_rig) -> None:
    """SV 5.1 says 0 or 1 data bytes, SV 5.2 says 0: the driver sends none."""
    with pytest.raises(LocalFault):
        servo_rig.bus.exchange(Exchange(1, 0, b"\x01"))


@item("X-84")
def test_gains_come_first(servo_rig) -> None:
    """SV 4.5: after a reset all gains and limits are zero, and any error would exceed a limit of zero."""
    for use in (
        lambda: servo_rig.servo.load_trajectory(position=1, velocity=65536, acceleration=65536, start_now=True),
        lambda: servo_rig.servo.stop_here(5),
    ):
        with pytest.raises(LocalFault, match="Set Gain"):
            use()


@item("X-90")
def test_a_trapezoid_has_velocity_and_acceleration(servo: PicServo) -> None:
    """SV 4.5: both are zero after a reset; such a move would never end."""
    with pytest.raises(LocalFault, match="never ends"):
        servo.load_trajectory(position=100, start_now=True)
    with pytest.raises(LocalFault, match="never ends"):
        servo.load_trajectory(position=100, velocity=65536, start_now=True)
