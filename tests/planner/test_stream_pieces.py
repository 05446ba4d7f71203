"""Pieces of legs for slices of profile ``exact``: nothing lost, as near as one rate can be, never in haste."""

import sys
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.paths import random_path
from planner.motors import StepMotor
from planner.steptrain import StepTrain
from planner.stream_pieces import HASTE, PieceTrain, Slice, best_end_ns, period_for, steps_in

PART = Slice(100_000_000, 105_000_000, 4_600_000)


def train() -> StepTrain:
    return StepTrain(random_path(1, 20.0, duration_s=0.3), StepMotor("X", "X", 0, 1, 200.0, 2))


@given(st.lists(st.integers(1, 12), min_size=1, max_size=40))
def test_pieces_are_the_train_whatever_they_are_cut_to(sizes: list[int]) -> None:
    whole, pieces = train(), PieceTrain(train())
    instants, place = [], pieces.start_steps
    for size in cycle(sizes):
        left = pieces.due(10**12)
        if not left:
            break
        size = min(size, len(left))
        following = pieces.after(size)
        piece = pieces.cut(size)
        assert pieces.pop() is piece
        assert piece.start_steps == place
        assert len(piece) == size
        place = piece.stop_steps
        instants += piece.instants_ns
        ahead = pieces.peek()
        assert following == (None if ahead is None else (ahead.instants_ns[0], ahead.direction))
    assert pieces.peek() is None
    legs = []
    while whole.peek() is not None:
        legs.append(whole.pop())
    assert instants == [ns for leg in legs for ns in leg.instants_ns]
    assert place == legs[-1].stop_steps


@given(st.floats(0.501, 1.499), st.integers(100_000, 2_400_000))
def test_steps_at_a_steady_rate_are_met_within_little_more_than_half_a_gap(phase: float, gap_ns: int) -> None:
    """The step before the slice was taken from half a gap early to half a gap late: so it is at its end again."""
    instants = [PART.from_ns + int((phase + k) * gap_ns) for k in range(200)]
    count = steps_in(PART, instants, at_once=False)
    assert abs(instants[count] - PART.until_ns - gap_ns) <= gap_ns / 2 + 1
    period_ns = period_for(PART, instants[:count], at_once=False)
    off = [k * period_ns - PART.since_start_ns(ns) for k, ns in enumerate(instants[:count], 1)]
    assert max(map(abs, off)) <= 0.55 * gap_ns
    assert count * period_ns <= PART.run_ns


@given(st.floats(0.0, 0.999), st.integers(100_000, 2_000_000))
def test_a_chip_that_steps_at_once_is_met_as_well(phase: float, gap_ns: int) -> None:
    instants = [PART.from_ns + int((phase - 0.5 + k) * gap_ns) for k in range(200)]
    count = steps_in(PART, instants, at_once=True)
    period_ns = period_for(PART, instants[:count], at_once=True)
    off = [k * period_ns - PART.since_start_ns(ns) for k, ns in enumerate(instants[:count])]
    assert max(map(abs, off)) <= 0.6 * gap_ns
    assert (count - 1) * period_ns <= PART.run_ns


@given(st.lists(st.tuples(st.integers(60_000, 900_000), st.floats(0.0, 1.0)), min_size=1, max_size=3))
def test_a_slice_ends_where_most_axes_are_about_to_step(axes: list[tuple[int, float]]) -> None:
    trains = [[PART.until_ns - int((20 + phase - k) * gap) for k in range(40)] for gap, phase in axes]
    earliest_ns = PART.until_ns - 1_000_000

    def off(ns: int) -> float:
        return sum(
            ((ns - steps[0]) / gap - round((ns - steps[0]) / gap)) ** 2
            for steps, (gap, _) in zip(trains, axes, strict=True)
        )

    best_ns = best_end_ns(trains, earliest_ns, PART.until_ns)
    assert best_ns is not None
    inside = [ns for steps in trains for ns in steps if earliest_ns <= ns <= PART.until_ns]
    assert best_ns in inside
    assert off(best_ns) == pytest.approx(min(map(off, inside)), abs=1e-3)


def test_a_slice_without_steady_steps_ends_where_it_would() -> None:
    near = PART.until_ns - 1000
    assert best_end_ns([[near - 5_000_000, near], []], PART.until_ns - 1_000_000, PART.until_ns) is None
    assert best_end_ns([[1, 2, 3, 4]], PART.until_ns - 1_000_000, PART.until_ns) is None


def test_a_single_step_comes_at_its_instant() -> None:
    instants = [PART.from_ns + 2_000_000, PART.from_ns + 11_000_000]
    assert steps_in(PART, instants, at_once=False) == 1
    assert period_for(PART, instants[:1], at_once=False) == round(2_000_000 * 4.6 / 5.0)


@pytest.mark.parametrize("count", [2, 5, 12])
def test_steps_that_are_late_are_not_made_in_a_burst(count: int) -> None:
    gap_ns = 250_000
    instants = [PART.from_ns - 8_000_000 + k * gap_ns for k in range(count)]
    assert steps_in(PART, instants, at_once=False) == count
    period_ns = period_for(PART, instants, at_once=False)
    assert period_ns == pytest.approx(gap_ns * 4.6 / 5.0 / HASTE, rel=1e-3)


def test_a_step_that_is_late_alone_waits_a_little() -> None:
    assert period_for(PART, [PART.from_ns - 3_000_000], at_once=False) > 200_000


def test_a_slice_has_room_for_all_its_steps() -> None:
    rng = np.random.default_rng(4)
    for _ in range(300):
        instants = np.sort(rng.integers(PART.from_ns - 3_000_000, PART.until_ns + 2_000_000, rng.integers(1, 60)))
        count = steps_in(PART, instants.tolist(), at_once=False)
        if count:
            assert count * period_for(PART, instants[:count].tolist(), at_once=False) <= PART.run_ns
