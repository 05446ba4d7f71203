"""Step trains: every step once, at the rounding instant, cut where the axis turns or waits."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from stream_rig import ClosedForm, circle, line

from planner.motors import StepMotor
from planner.steptrain import Leg, StepTrain

MOTOR = StepMotor("X", "X", 0, 1, 200.0, 2)


def legs(trajectory: ClosedForm, motor: StepMotor = MOTOR) -> list[Leg]:
    train, result = StepTrain(trajectory, motor), []
    while train.peek() is not None:
        result.append(train.pop())
    return result


def test_a_line_is_one_leg_with_every_step_on_its_rounding_instant() -> None:
    trajectory = line((10.0,), 20.0)
    (leg,) = legs(trajectory)
    assert (leg.direction, leg.start_steps, leg.stop_steps) == (1, 0, 2000)
    at = trajectory.q(leg.times_ns * 1e-9)[:, 0] * 200.0
    assert at == pytest.approx(np.arange(2000) + 0.5, abs=2e-3)


def test_a_circle_turns_each_axis_where_its_coordinate_turns() -> None:
    def turns(motor: StepMotor) -> list[tuple[int, int]]:
        found = legs(circle(25.0, 60.0), motor)
        last = [
            leg
            for leg, after in zip(found, [*found[1:], None], strict=True)
            if not after or after.direction != leg.direction
        ]
        return [(leg.direction, leg.stop_steps) for leg in last]

    assert turns(MOTOR) == [(1, 10_000), (-1, 0)]
    assert turns(StepMotor("Y", "Y", 0, 2, 200.0, 2)) == [(1, 5_000), (-1, -5_000), (1, 0)]


def test_an_apex_that_overshoots_by_less_than_half_a_step_is_left_out() -> None:
    def q(t: np.ndarray) -> np.ndarray:
        return ((100.7 - 4e4 * (t - 0.05) ** 2) / 200.0)[:, None]  # apex 0.2 past the middle of a step

    up, down = legs(ClosedForm(("X",), 0.1, q))
    assert up.stop_steps == down.start_steps == 100


def test_a_coordinate_at_rest_on_a_rounding_border_does_not_chatter() -> None:
    rng = np.random.default_rng(7)
    trajectory = ClosedForm(("X",), 5.0, lambda t: (0.5 + rng.normal(0.0, 1e-12, len(t)))[:, None] / 200.0)
    assert sum(len(leg) for leg in legs(trajectory)) <= 1


def test_slow_steps_at_a_turn_are_moves_of_their_own() -> None:
    gaps = [gap for leg in legs(circle(25.0, 60.0)) for gap in leg.gaps_ns]
    assert max(gaps) <= 12_000_000


def test_a_wait_longer_than_the_timer_begins_a_new_leg() -> None:
    def q(t: np.ndarray) -> np.ndarray:
        return (np.clip(t, 0.0, 0.5) + np.clip(t - 1.5, 0.0, 0.5))[:, None]

    first, second = legs(ClosedForm(("X",), 2.0, q))
    assert (len(first), len(second)) == (100, 100)
    assert first.stop_steps == second.start_steps == 100


def test_a_slow_axis_becomes_single_steps() -> None:
    slow = legs(line((0.02,), 0.01))  # 2 steps/s, below the 19 steps/s of 2x
    assert [len(leg) for leg in slow] == [1, 1, 1, 1]


def test_legs_do_not_depend_on_where_chunks_end(monkeypatch: pytest.MonkeyPatch) -> None:
    trajectory = circle(2.0, 20.0)
    whole = legs(trajectory)
    monkeypatch.setattr("planner.steptrain.CHUNK_S", 0.037)
    chunked = legs(trajectory)
    assert [leg.times_ns.tolist() for leg in whole] == [leg.times_ns.tolist() for leg in chunked]
