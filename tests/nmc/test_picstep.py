"""PicStep against the simulated chip."""

from __future__ import annotations

import pytest

from nmc.errors import LocalFault, RemoteFault
from nmc.picstep import PicStep
from sim.spec import StepModule, Switch


def ready(bus, address: int = 1, **parameters) -> PicStep:
    step = PicStep(bus, address)
    step.set_parameters("2x", minimum_speed=5, running_current=200, holding_current=50, **parameters)
    step.stop_motor()
    return step


def test_type_and_version(steppers) -> None:
    _, bus = steppers()
    assert PicStep(bus, 1).type_version() == (3, 1)


def test_trapezoid_ends_on_its_goal(steppers) -> None:
    simulation, bus = steppers()
    step = ready(bus)
    step.load_trajectory(position=1234, speed=50, acceleration_time=5, start_now=True)
    step.wait_until_stopped(10_000_000_000)
    assert step.position() == 1234
    step.load_trajectory(position=-66)
    step.start_motion()
    step.wait_until_stopped(10_000_000_000)
    assert step.position() == -66
    assert simulation.violations == []


def test_unprofiled_run_ends_on_its_stop_position(steppers) -> None:
    simulation, bus = steppers()
    step = ready(bus)
    step.load_trajectory(position=100, timer_count=64000, nearest_speed=16, start_now=True)
    step.load_trajectory(timer_count=64500, nearest_speed=24, start_now=True)
    step.wait_until_stopped(2_000_000_000)
    assert step.position() == 100
    assert simulation.violations == []


def test_velocity_mode_and_smooth_stop(steppers) -> None:
    _, bus = steppers()
    step = ready(bus)
    step.load_trajectory(speed=40, acceleration_time=2, reverse=True, start_now=True)
    with pytest.raises(RemoteFault, match="still moving"):
        step.wait_until_stopped(100_000_000)
    step.stop_motor("smoothly")
    step.wait_until_stopped(1_000_000_000)
    assert step.position() < 0


def test_endless_count_must_be_meant(steppers) -> None:
    _, bus = steppers()
    step = ready(bus)
    with pytest.raises(LocalFault, match="for ever"):
        step.load_trajectory(timer_count=60000, start_now=True)
    step.load_trajectory(timer_count=60000, start_now=True, endless=True)
    assert "moving" in step.poll(50_000_000).flags
    step.stop_motor("abruptly")
    assert "moving" not in step.no_operation().flags


def test_home_is_captured_at_the_switch(steppers) -> None:
    _, bus = steppers(StepModule("x", switches=(Switch("home", None, -500),)))
    step = ready(bus)
    found = step.find_home("home_switch", speed=20, acceleration_time=5, reverse=True, timeout_ns=5_000_000_000)
    assert found.home_position == -500
    assert abs(found.rest_position - found.home_position) <= 1
    assert step.inputs()["home_switch"]
    found = step.find_home(
        "home_switch", speed=20, acceleration_time=1, reverse=False, timeout_ns=5_000_000_000, stop="smoothly"
    )
    assert found.home_position == -499
    assert found.rest_position > -499


def test_a_limit_before_home_is_a_fault(steppers) -> None:
    _, bus = steppers(StepModule("x", switches=(Switch("limit2", None, -200),)))
    step = ready(bus)
    with pytest.raises(RemoteFault, match="stopped before home_switch"):
        step.find_home("home_switch", speed=20, acceleration_time=5, reverse=True, timeout_ns=5_000_000_000)


def test_home_that_never_comes_is_a_fault_and_the_motor_stands(steppers) -> None:
    _, bus = steppers()
    step = ready(bus)
    with pytest.raises(RemoteFault, match="did not change"):
        step.find_home("home_switch", speed=20, acceleration_time=5, reverse=True, timeout_ns=300_000_000)
    assert "moving" not in step.no_operation().flags


def test_status_items_by_name(steppers) -> None:
    _, bus = steppers()
    step = ready(bus)
    status = step.define_status("position", "inputs")
    assert set(status.values) >= {"position", "inputs", "inputs.limit1"}
    assert "position" in step.no_operation().values
    with pytest.raises(LocalFault, match="no status item"):
        step.define_status("velocity")


def test_the_goal_is_never_too_far(steppers) -> None:
    _, bus = steppers()
    step = ready(bus)
    step.load_trajectory(position=-10, speed=50, acceleration_time=1, start_now=True)
    step.wait_until_stopped(1_000_000_000)
    assert step.position() == -10
    with pytest.raises(LocalFault, match="0x7FFFFFFF"):
        step.load_trajectory(position=0x7FFFFFFF)
