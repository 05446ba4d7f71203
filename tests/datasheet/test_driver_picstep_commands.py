"""What the driver says to a PIC-STEP, and what it refuses to say, by section 5.1 of its data sheet."""

from __future__ import annotations

import pytest

from nmc.chips import picstep
from nmc.codec import decode_status, encode
from nmc.errors import LocalFault
from nmc.picstep import PicStep
from nmc.program import Exchange

item = pytest.mark.item


# -- commands ----------------------------------------------------------------------------------------------------------


@item("ST-100", "ST-101")
def test_reset_position_only_at_rest(step: PicStep, rig) -> None:
    """ST 5.1: do not issue this command while the motor is in motion."""
    step.load_trajectory(position=30, timer_count=60000, start_now=True)
    with pytest.raises(LocalFault, match="in motion"):
        step.reset_position()
    step.wait_until_stopped(2_000_000_000)
    step.reset_position()
    assert rig.last() == b"\x00"
    assert step.position() == 0


@item("ST-102", "ST-103", "N-070", "N-071", "N-072", "N-074", "N-075", "N-076")
def test_status_items_in_words(step: PicStep) -> None:
    """ST 5.1: position, A/D, initial timer count, inputs, home position, type and version, in the order of the bits."""
    names = ("position", "ad_value", "timer_count", "inputs", "home_position", "type_version")
    assert step.item_mask(names) == 0x3F
    extra = bytes([1, 0, 0, 0x80, 7, 0x34, 0x12, 0x08, 0xFE, 0xFF, 0xFF, 0xFF, 3, 1])
    values = decode_status(picstep.FACTS, 0x08, 0x3F, extra).values
    assert values["position"] == 1 - (1 << 31)
    assert values["ad_value"] == 7
    assert values["timer_count"] == 0x1234
    assert values["inputs.limit1"] == 1
    assert values["home_position"] == -2
    assert (values["type"], values["version"]) == (3, 1)
    assert decode_status(picstep.FACTS, 0x08, 0x28, b"\x20\x03\x01").values["inputs.home_switch"] == 1


@item("ST-110", "ST-111", "ST-112", "ST-113", "ST-114", "ST-115", "ST-116", "ST-117", "ST-118")
@pytest.mark.parametrize(
    ("values", "data"),
    [
        ({"position": 0x01020304}, "54 01 04030201"),
        ({"speed": 0x55}, "24 02 55"),
        ({"acceleration_time": 7}, "24 04 07"),
        ({"timer_count": 0x1234, "nearest_speed": 9}, "44 08 3412 09"),
        ({"reverse": 1}, "14 10"),
        ({"start_now": 1}, "14 80"),
        ({"position": -1, "speed": 2, "acceleration_time": 3, "timer_count": 4, "nearest_speed": 5}, None),
        ({"position": 6, "timer_count": 0xFF00, "nearest_speed": 250, "reverse": 1, "start_now": 1}, None),
    ],
)
def test_load_trajectory_bytes(values: dict[str, int], data: str | None) -> None:
    """ST 5.1: 0xn4 with 1 to 10 bytes: control byte, then position, speed, acceleration, count with nearest speed."""
    code, body = encode(picstep.FACTS, "load_trajectory", values)
    packet = bytes([len(body) << 4 | code]) + body
    longest = "A4 0F FFFFFFFF 02 03 0400 05" if "speed" in values else "84 99 06000000 00FF FA"
    assert packet == bytes.fromhex(data or longest)
    assert not body[0] & 0x60


@item("ST-119", "ST-120")
def test_position_range_and_distance(step: PicStep, rig) -> None:
    """ST 5.1: +/-0x7FFFFFFF, and not more than 0x7FFFFFFF from the current position."""
    assert step.position() == 0
    step.load_trajectory(position=0x7FFFFFFF, speed=1, acceleration_time=1)
    step.load_trajectory(position=-0x7FFFFFFF, speed=1, acceleration_time=1)
    with pytest.raises(LocalFault, match="outside"):
        step.load_trajectory(position=-0x80000000)
    step.load_trajectory(position=5, speed=50, acceleration_time=1, start_now=True)
    step.wait_until_stopped(1_000_000_000)
    assert step.position() == 5
    before = rig.count()
    with pytest.raises(LocalFault, match="0x7FFFFFFF"):
        step.load_trajectory(position=-0x7FFFFFFF)
    assert rig.count() == before


@item("ST-140", "ST-141", "ST-142", "ST-143", "ST-144", "ST-145")
@pytest.mark.parametrize(("mode", "bits"), [("8x", 0), ("4x", 1), ("2x", 2), ("1x", 3)])
def test_set_parameters_bytes(rig, mode: str, bits: int) -> None:
    """ST 5.1: 0x56, mode, minimum speed, running and holding current, thermal limit; 00 = 8x ... 11 = 1x."""
    rig.step.set_parameters(mode, minimum_speed=9, running_current=200, holding_current=50, thermal_limit=30)
    assert rig.last() == bytes([0x56, bits, 9, 200, 50, 30])
    rig.step.set_parameters(mode, disable_limit_stop=True)
    assert rig.last()[1] == bits | 4
    rig.step.set_parameters(mode, disable_estop=True)
    assert rig.last()[1] == bits | 8
    rig.step.set_parameters(mode, motor_off_on_stop=True)
    assert rig.last()[1] == bits | 16
    with pytest.raises(LocalFault):
        rig.bus.exchange(Exchange(1, 6, bytes([0x20, 1, 0, 0, 0])))


@item("ST-146")
def test_no_motion_before_set_parameters(rig) -> None:
    """ST 5.1: this command must be issued before any motions can be executed."""
    before = rig.count()
    with pytest.raises(LocalFault, match="Set Parameters"):
        rig.step.load_trajectory(speed=10)
    assert rig.count() == before


@item("ST-150", "ST-151", "ST-152", "ST-156")
def test_stop_motor_bytes(rig) -> None:
    """ST 5.1: bit 0 amplifier, bit 2 abruptly, bit 3 smoothly; the amplifier alone may be set."""
    for manner, amplifier, byte in (
        (None, True, 0x01),
        (None, False, 0x00),
        ("abruptly", True, 0x05),
        ("smoothly", True, 0x09),
        ("abruptly", False, 0x04),
    ):
        rig.step.stop_motor(manner, amplifier=amplifier)  # type: ignore[arg-type]
        assert rig.last() == bytes([0x17, byte])


@item("ST-153")
@pytest.mark.parametrize("byte", [0x02, 0x0C, 0x10, 0x20, 0x40, 0x80])
def test_stop_motor_bits_that_must_not_be_set(rig, byte: int) -> None:
    """ST 5.1: only one of bits 2 and 3; the others are clear."""
    before = rig.count()
    with pytest.raises(LocalFault):
        rig.bus.exchange(Exchange(1, 7, bytes([byte])))
    assert rig.count() == before


@item("ST-154", "ST-155")
def test_after_a_smooth_stop_the_speed_is_loaded_again(step: PicStep) -> None:
    """ST 5.1, Stop Motor: the goal velocity has been set to zero."""
    step.load_trajectory(speed=30, acceleration_time=2, start_now=True)
    step.stop_motor("smoothly")
    step.wait_until_stopped(1_000_000_000)
    with pytest.raises(LocalFault, match="speed"):
        step.load_trajectory(position=5000)
    step.load_trajectory(position=5000, speed=30)


@item("ST-160")
def test_set_outputs_bytes(rig) -> None:
    """ST 5.1: 0x18, bits 0 to 4 are OUT1 to OUT5."""
    rig.step.set_outputs(0b10101)
    assert rig.last() == b"\x18\x15"
    with pytest.raises(LocalFault):
        rig.step.set_outputs(0x20)


@item("ST-161", "ST-162", "X-41")
def test_other_commands(rig) -> None:
    """ST 5.1: 0x0C, 0x0E, 0x0F; 0xB and 0xD are not defined for a PIC-STEP."""
    rig.step.save_current_position_as_home()
    assert rig.last() == b"\x0c"
    rig.step.no_operation()
    assert rig.last() == b"\x0e"
    for command in (0xB, 0xD):
        with pytest.raises(LocalFault, match="not defined"):
            rig.bus.exchange(Exchange(1, command))
    rig.step.hard_reset()
    assert rig.last() == b"\x0f"
