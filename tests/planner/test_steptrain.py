"""Step trains: every step once, at the rounding instant, cut where the axis turns or waits."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from stream_rig import ClosedForm, circle, line

from nmc.budget import BusTiming
from planner.motors import StepMotor
from planner.steptrain import Leg, StepTrain, longest_gap_s

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


@pytest.mark.parametrize(
    ("baud", "jitter_ms", "mode", "together", "gap_ms"),
    [
        (115200, 0, 2, 0, 12.0),
        (115200, 2, 2, 0, 12.0),
        (115200, 5, 2, 0, 19.0),  # 4.8 exchanges of 1.2 ms, and 2.75 on average
        (115200, 0, 8, 0, 11.8),  # nine tenths of 13.1 ms
        (9600, 0, 2, 0, 47.2),  # the same of 52.4
        (57600, 0, 2, 0, 21.8),  # nine loads of fourteen bytes
        (115200, 0, 2, 3, 12.0),
        (115200, 0, 2, 8, 28.1),  # 2.4 exchanges for each of eight
        (9600, 0, 2, 3, 106.8),  # longer than the timer can wait: each of them is begun anew
    ],
)
def test_a_gap_leaves_the_bus_to_others(baud: int, jitter_ms: int, mode: int, together: int, gap_ms: float) -> None:
    motor, timing = StepMotor("X", "X", 0, 1, 200.0, mode), BusTiming.at(baud, jitter_max_ns=jitter_ms * 1_000_000)
    assert longest_gap_s(motor, timing, together) * 1e3 == pytest.approx(gap_ms, abs=0.1)
    assert longest_gap_s(motor) * 1e3 == pytest.approx(min(gap_ms, 12.0), abs=0.1)


def test_what_is_overdue_becomes_one_leg() -> None:
    train = StepTrain(line((0.5,), 0.25), MOTOR)  # a step every 20 ms: each is a leg
    alone = train.peek()
    assert alone is not None
    assert len(alone) == 1
    begin_ns = alone.instants_ns[0]
    train.join(begin_ns)
    assert train.peek() is alone
    train.join(begin_ns + 70_000_000)
    joined = train.pop()
    assert len(joined) == 4
    assert (joined.start_steps, joined.stop_steps) == (alone.start_steps, alone.start_steps + 4)
    assert joined.gaps_ns == pytest.approx([20_000_000] * 3, abs=1000)
    rest = train.peek()
    assert rest is not None
    assert rest.start_steps == joined.stop_steps
    train.join(10**12)
    assert len(train.pop()) == 96
    assert train.peek() is None
    train.join(10**12)


def test_legs_that_turn_are_not_joined() -> None:
    train = StepTrain(circle(0.05, 0.5), MOTOR)
    train.join(10**12)
    first = train.pop()
    second = train.peek()
    assert second is not None
    assert second.direction == -first.direction
