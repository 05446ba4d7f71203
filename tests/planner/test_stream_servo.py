"""Servo lanes: how near the command comes to the path, and what Stop Here points are taken at."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from stream_rig import Conditions, Outcome, circle, helix, random_path, stream

from benchmarks.pwm import signed_pwm
from benchmarks.rig import bring_up, travelling
from benchmarks.servo_floor import driven, pwm_floor
from planner.stream_servo import Pace
from sim.picservo import PicServo

ALL = ("X", "Y", "Z")


def clean(outcome: Outcome) -> None:
    assert not outcome.violations
    assert all(end == 0 for end in outcome.contour.end_error_steps.values())


@pytest.mark.parametrize(("jitter_ms", "command_um"), [(0.0, 0.6), (2.0, 1.6)])
def test_a_smooth_command_keeps_to_the_circle_without_shaking_the_motor(jitter_ms: float, command_um: float) -> None:
    outcome = stream(circle(2.0, 20.0), Conditions(jitter_ms, servos=ALL, seed=100), "smooth")
    clean(outcome)
    assert outcome.contour.contour_um.max <= command_um
    assert outcome.shaft.contour_um.max <= 25.0
    *moving, resting = outcome.pwm_changes
    assert all(0.0 < change.value < change.signed <= 20.0 for change in moving)
    assert resting.value == resting.signed == 0.0


@pytest.mark.parametrize(("seed", "jitter_ms", "command_um"), [(3, 0.0, 2.5), (20, 0.0, 1.8), (7, 2.0, 5.0)])
def test_a_smooth_command_follows_where_the_acceleration_jumps(seed: int, jitter_ms: float, command_um: float) -> None:
    """Seed 20 was off by 3.5 um where three axes begin to move at once, loaded one after the other."""
    outcome = stream(random_path(seed, 20.0), Conditions(jitter_ms, servos=ALL, seed=100 + seed), "smooth")
    clean(outcome)
    assert outcome.contour.contour_um.max <= command_um


def test_the_pwm_is_as_calm_as_under_the_plan_itself() -> None:
    """What is left is the whole counts of encoder and command, which no stream can take away."""
    conditions = Conditions(servos=ALL, seed=104)
    path = random_path(4, 20.0)
    for least, found in zip(pwm_floor(path, conditions), stream(path, conditions, "smooth").pwm_changes, strict=True):
        assert 15.0 < least.signed < found.signed + 0.5
        assert found.signed <= min(least.signed + 0.5, 20.0)
        assert 10.0 < found.value <= least.value + 0.5


def test_the_pwm_reckoned_from_a_trace_is_what_the_chip_puts_out() -> None:
    conditions = Conditions(servos=("X",), seed=3)
    simulation, _, _ = bring_up(("X",), conditions)
    steps = (5 * 65536 * np.sin(np.arange(6000) * 0.004)).astype(np.int64)
    steps[3000:3010] = 60 * 65536  # a jump, so that the output limit is met
    chip = simulation.modules["X"]
    assert isinstance(chip, PicServo)
    pwm, error = driven(chip, steps)
    assert np.abs(pwm).max() == 255
    assert (signed_pwm(error, conditions.gains) == pwm).all()


@pytest.mark.parametrize(("jitter_ms", "command_um"), [(0.0, 31.0), (2.0, 65.0)])
def test_stop_here_points_keep_even_where_a_slow_axis_comes_between(jitter_ms: float, command_um: float) -> None:
    """The fast axes then stood for three exchanges once; had they jumped for as long again: 36 and 71 um."""
    outcome = stream(random_path(5, 20.0), Conditions(jitter_ms, servos=ALL, seed=105), "stop-here")
    clean(outcome)
    assert outcome.contour.contour_um.max <= command_um


@pytest.mark.parametrize(("jitter_ms", "command_um"), [(0.0, 17.0), (2.0, 32.0)])
def test_stop_here_points_make_even_stairs(jitter_ms: float, command_um: float) -> None:
    outcome = stream(circle(2.0, 20.0), Conditions(jitter_ms, servos=ALL, seed=100), "stop-here")
    clean(outcome)
    assert outcome.contour.contour_um.max <= command_um


@pytest.mark.parametrize(("jitter_ms", "command_um"), [(0.0, 4.0), (2.0, 7.0)])
def test_a_helix_of_two_servos_and_a_stepper(jitter_ms: float, command_um: float) -> None:
    outcome = stream(helix(2.0, 2.0, 5.0, 20.0), Conditions(jitter_ms, servos=("X", "Y"), seed=101), "smooth")
    clean(outcome)
    assert outcome.contour.contour_um.max <= command_um


def test_the_pace_is_even_where_executions_are_not_and_stays_with_them() -> None:
    rng = np.random.default_rng(3)
    executions = 1e9 + 2e6 * np.arange(400) + rng.uniform(-1e6, 1e6, 400)
    pace, taken = Pace(), []
    for ns in executions:
        taken.append(pace.next_ns(ns))
        pace.take(ns)
    assert np.std(np.diff(taken[50:])) < 0.3 * np.std(np.diff(executions[50:]))
    assert np.max(np.abs(np.array(taken) - executions)) < 3e6
    assert abs(np.mean(np.array(taken[50:]) - executions[50:])) < 0.1e6


def test_the_pace_begins_anew_after_a_rest() -> None:
    pace = Pace()
    for ns in (1e9, 1.002e9, 1.004e9):
        pace.take(ns)
    assert pace.next_ns(2e9) == 2e9


def test_a_count_that_stands_for_long_is_a_rest() -> None:
    time_ns = np.arange(0, 400_000_000, 500_000)
    counts = np.where(time_ns < 200_000_000, 0, (time_ns - 200_000_000) // 50_000_000 + 1).clip(0, 3).astype(np.int32)
    moving = travelling(time_ns, counts)
    assert not moving[0]
    assert moving[counts == 1].all()
    assert moving[counts == 2].all()
    assert not moving[-1]
    assert not travelling(time_ns, np.zeros_like(counts)).any()


@pytest.mark.parametrize(("jitter_ms", "um"), [(0.0, 45.0), (2.0, 90.0)])
def test_a_stepper_beside_stop_here_servos_gets_its_turns(jitter_ms: float, um: float) -> None:
    """A point always mends more than a count: left to that alone the stepper starves, and is 0.2 to 8 mm off."""
    outcome = stream(helix(2.0, 2.0, 5.0, 20.0), Conditions(jitter_ms, seed=101, servos=("X", "Y")), "stop-here")
    clean(outcome)
    assert outcome.contour.contour_um.max <= um
