"""PicServo against the simulated chip and motor."""

from __future__ import annotations

import pytest

from nmc.errors import LocalFault, RemoteFault
from nmc.picservo import Gains, PicServo
from sim.spec import ServoModule, ServoPlant, Switch

GAINS = Gains(220, 2640, 150, 4000)
S = 1_000_000_000


def ready(bus, address: int = 1) -> PicServo:
    servo = PicServo(bus, address)
    servo.set_gain(GAINS)
    servo.stop_motor("abruptly")
    servo.clear_sticky_bits()
    servo.require_ready()
    return servo


def test_type_and_power_up_status(simulated) -> None:
    _, bus = simulated(ServoModule("x"))
    servo = PicServo(bus, 1)
    assert servo.type_version() == (0, 4)
    assert {"move_done", "position_error"} <= servo.no_operation().flags
    with pytest.raises(RemoteFault, match="disabled"):
        servo.require_ready()


def test_trapezoid_holds_its_goal(simulated) -> None:
    simulation, bus = simulated(ServoModule("x"))
    servo = ready(bus)
    servo.load_trajectory(position=5000, velocity=10 * 65536, acceleration=2000, start_now=True)
    with pytest.raises(LocalFault, match="while moving"):
        servo.load_trajectory(position=100, start_now=True)
    servo.wait_until_done(5 * S)
    bus.link.sleep_until(bus.link.now_ns() + S // 2)  # move_done is the profile's end, not the motor's
    assert abs(servo.position() - 5000) <= 2
    assert simulation.violations == []


def test_velocity_has_the_sign_of_the_motion(simulated) -> None:
    _, bus = simulated(ServoModule("x"))
    servo = ready(bus)
    servo.load_trajectory(velocity=8 * 65536, acceleration=3000, velocity_mode=True, reverse=True, start_now=True)
    servo.wait_until_done(2 * S)
    assert -11 <= servo.velocity() <= -5
    servo.stop_motor("smoothly")
    servo.wait_until_done(2 * S)
    assert servo.position() < 0


def test_stop_here_stream_is_followed(simulated) -> None:
    simulation, bus = simulated(ServoModule("x"))
    servo = ready(bus)
    for position in range(0, 2000, 20):
        servo.stop_here(position)
        bus.link.sleep_until(bus.link.now_ns() + 5_000_000)
    bus.link.sleep_until(bus.link.now_ns() + S)
    assert abs(servo.position() - 1980) <= 3
    assert simulation.violations == []


def test_index_is_found_and_captured(simulated) -> None:
    _, bus = simulated(ServoModule("x", plant=ServoPlant(index_at_counts=700)))
    servo = ready(bus)
    found = servo.find_home(
        "index", velocity=2 * 65536, acceleration=500, reverse=False, timeout_ns=5 * S, stop="smoothly"
    )
    assert abs(found.home_position - 700) <= 4
    assert found.rest_position > found.home_position


def test_a_limit_switch_as_home(simulated) -> None:
    _, bus = simulated(ServoModule("x", switches=(Switch("limit1", None, -400),)))
    servo = ready(bus)
    found = servo.find_home("limit1", velocity=2 * 65536, acceleration=500, reverse=True, timeout_ns=5 * S)
    assert abs(found.home_position + 400) <= 6


def test_home_that_never_comes(simulated) -> None:
    _, bus = simulated(ServoModule("x", plant=ServoPlant(index=False)))
    servo = ready(bus)
    with pytest.raises(RemoteFault, match="no index"):
        servo.find_home("index", velocity=65536, acceleration=500, reverse=False, timeout_ns=S // 2)


def test_a_jammed_axis_disables_its_servo_and_says_so(simulated) -> None:
    _, bus = simulated(ServoModule("x", plant=ServoPlant(stop_high_counts=300)))
    servo = PicServo(bus, 1)
    servo.set_gain(Gains(220, 2640, 150, 4000, position_error_limit=200))
    servo.stop_motor("abruptly")
    servo.clear_sticky_bits()
    bus.arm_faults(1, high=0x10)
    servo.load_trajectory(position=5000, velocity=10 * 65536, acceleration=2000, start_now=True)
    with pytest.raises(RemoteFault, match="position_error is set"):
        servo.wait_until_done(5 * S)


def test_old_versions_get_what_they_understand(simulated) -> None:
    _, bus = simulated(ServoModule("x", version=3))
    servo = PicServo(bus, 1)
    servo.set_gain(GAINS)
    with pytest.raises(LocalFault, match="version 4"):
        servo.set_gain(Gains(1, 1, 1, 1, deadband=3))


def test_limit_pins_as_outputs(simulated) -> None:
    _, bus = simulated(ServoModule("x"))
    servo = PicServo(bus, 1)
    servo.io_control(limit1_output=True, limit1_is_input=False)
    assert servo.read_status().byte & 2 == 0
