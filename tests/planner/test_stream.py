"""Streams on the simulated wire: ends exact, nothing against the data sheets, pins near the plan, for every profile."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from stream_rig import ClosedForm, Conditions, Outcome, circle, line, random_path, rounded_square, stream

from planner.motors import StepMotor
from planner.stream import make_source

STEPPER_PROFILES = ("group", "adaptive", "exact")
PATHS = {
    "line": lambda: line((30.0, 11.0, 4.0), 20.0),
    "circle": lambda: circle(2.0, 20.0),
    "square": lambda: rounded_square(8.0, 1.0, 40.0),
    "random": lambda: random_path(5, 20.0, duration_s=3.0),
}


def clean(outcome: Outcome) -> None:
    """What holds in every run of every profile."""
    assert set(outcome.contour.end_error_steps.values()) == {0}
    assert outcome.violations == {}


@pytest.mark.parametrize("profile", STEPPER_PROFILES)
@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("jitter_ms", [0.0, 0.2])
def test_steppers_follow_the_path(path: str, profile: str, jitter_ms: float) -> None:
    outcome = stream(PATHS[path](), Conditions(jitter_ms=jitter_ms, seed=3), profile)
    clean(outcome)
    assert outcome.contour.contour_steps.max <= {"adaptive": 3.5, "exact": 2.5, "group": 4.0}[profile]
    assert outcome.contour.contour_steps.rms <= 1.0
    assert outcome.contour.sim_time_s == pytest.approx(PATHS[path]().duration_s, rel=0.01)


@pytest.mark.parametrize("profile", STEPPER_PROFILES)
@pytest.mark.parametrize("seed", range(4))
def test_two_milliseconds_of_jitter_cost_accuracy_but_no_step(profile: str, seed: int) -> None:
    clean(stream(random_path(seed, 60.0, duration_s=2.0), Conditions(jitter_ms=2.0, seed=seed), profile))


@pytest.mark.parametrize("profile", STEPPER_PROFILES)
def test_an_axis_slower_than_the_timer_is_stepped_one_by_one(profile: str) -> None:
    outcome = stream(line((0.06, 0.02), 0.05), Conditions(seed=2), profile)
    clean(outcome)
    assert outcome.contour.contour_steps.max <= 1.5


@pytest.mark.parametrize("profile", STEPPER_PROFILES)
def test_nothing_to_move_is_nothing_to_send(profile: str) -> None:
    outcome = stream(ClosedForm(("X", "Y"), 0.5, lambda t: np.zeros((len(t), 2))), Conditions(), profile)
    clean(outcome)
    assert outcome.packets == 0


def test_the_same_seed_gives_the_same_run() -> None:
    first, second = (stream(circle(2.0, 20.0), Conditions(jitter_ms=0.2, seed=9), "adaptive") for _ in range(2))
    assert first.contour == second.contour
    assert first.packets == second.packets


@pytest.mark.parametrize(("profile", "command_um"), [("smooth", 4.0), ("stop-here", 40.0)])
def test_servos_follow_the_path(profile: str, command_um: float) -> None:
    outcome = stream(circle(2.0, 20.0), Conditions(servos=("X", "Y", "Z")), profile)
    clean(outcome)
    assert outcome.contour.contour_um.max <= command_um
    assert outcome.shaft.contour_um.max <= 60.0


def test_servos_and_a_stepper_share_one_bus() -> None:
    outcome = stream(line((20.0, 8.0, 3.0), 20.0), Conditions(servos=("X", "Y")), "smooth")
    clean(outcome)
    assert outcome.contour.contour_um.max <= 12.0


def test_motors_of_two_buses_and_unknown_profiles_are_refused() -> None:
    trajectory = line((1.0, 1.0), 5.0)
    motors = [StepMotor("X", "X", 0, 1, 200.0, 1), StepMotor("Y", "Y", 1, 1, 200.0, 1)]
    with pytest.raises(ValueError, match="one bus"):
        make_source(trajectory, motors, timing=None, start_ns=0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="not offered"):
        make_source(trajectory, motors[:1], timing=None, start_ns=0, profile="fast")  # type: ignore[arg-type]
