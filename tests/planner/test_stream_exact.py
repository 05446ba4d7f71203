"""Profile ``exact``: all axes in slices, each on its own step at the end of every one, whatever the chip does."""

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks import rig
from benchmarks.paths import ClosedForm, Warped, circle, line, random_path, rounded_square
from benchmarks.rig import Conditions, Outcome, bring_up, stream, timing_of
from nmc.budget import BusTiming
from nmc.executor import play
from nmc.program import Evidence
from planner.motors import Motor, StepMotor
from planner.stream import lead_in_ns, make_source
from planner.stream_axis import LOAD_POSITION, LOAD_TRAJECTORY, MOVING, START_NOW
from planner.stream_base import SET_ADDRESS, START_MOTION, STOP_MOTOR
from planner.stream_error import StreamError
from planner.stream_regroup import STREAMING_GROUP
from sim.spec import StepModule


def good(outcome: Outcome) -> None:
    assert set(outcome.contour.end_error_steps.values()) == {0}
    assert outcome.violations == {}


@pytest.mark.parametrize("jitter_ms", [0.0, 0.2])
@pytest.mark.parametrize("seed", range(4))
def test_random_paths_are_met_within_two_steps(seed: int, jitter_ms: float) -> None:
    path = random_path(seed, 20.0, duration_s=4.0)
    outcome = stream(path, Conditions(jitter_ms, seed=seed + 40), "exact")
    good(outcome)
    assert outcome.contour.contour_steps.max <= 1.8
    assert outcome.contour.contour_steps.p999 <= 1.4
    assert outcome.contour.contour_steps.rms <= 0.62
    assert outcome.contour.sim_time_s == pytest.approx(path.duration_s, abs=0.02)


@pytest.mark.parametrize(
    ("path", "jitter_ms", "steps"),
    [
        (random_path(3, 60.0, duration_s=3.0), 0.0, 3.2),
        (random_path(3, 60.0, duration_s=3.0), 2.0, 4.5),
        (random_path(3, 20.0, duration_s=3.0), 2.0, 2.6),
        (random_path(3, 20.0, 6, duration_s=3.0), 0.2, 2.3),
        (circle(25.0, 60.0), 0.0, 3.3),
        (circle(2.0, 20.0), 0.2, 1.8),
        (rounded_square(8.0, 1.0, 40.0), 0.2, 2.5),
        (line((0.06, 0.02), 0.05), 0.2, 1.0),
    ],
)
def test_what_hesitates_and_hurries_costs_tempo_and_little_else(
    path: ClosedForm, jitter_ms: float, steps: float
) -> None:
    """A pause that all axes make together is no error of the path, however long it is."""
    outcome = stream(path, Conditions(jitter_ms, seed=11), "exact")
    good(outcome)
    assert outcome.contour.contour_steps.max <= steps
    assert outcome.contour.sim_time_s == pytest.approx(path.duration_s, abs=0.02)


def test_near_the_highest_rate_of_a_chip_slices_are_long_enough_to_keep_pace() -> None:
    """12,000 steps a second of 14,205, and a pause in every slice."""
    path = line((45.0, 24.0), 68.0)
    outcome = stream(path, Conditions(0.2, seed=11), "exact")
    good(outcome)
    assert outcome.contour.lag_ms_max < 10.0
    assert outcome.contour.sim_time_s == pytest.approx(path.duration_s, abs=0.02)


def test_it_does_not_matter_when_a_count_acts() -> None:
    path = random_path(2, 20.0, duration_s=2.0)
    outcomes = [
        stream(path, Conditions(0.2, seed=5, count_latch=latch), "exact") for latch in ("rollover", "immediate")
    ]
    assert outcomes[0] == outcomes[1]


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("path", [random_path(2, 20.0, duration_s=2.0), line((0.06, 0.02), 0.05)])
def test_chips_whose_first_step_comes_with_the_start(
    path: ClosedForm, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Known or not it is safe; where it is known the steps are aimed accordingly."""
    module_of, start_bus = rig.module_of, rig.start_bus

    def at_once(name: str, conditions: Conditions) -> StepModule:
        module = module_of(name, conditions)
        assert isinstance(module, StepModule)
        return replace(module, first_pulse="immediate")

    def told(*args: object) -> tuple[object, list[Motor]]:
        bus, motors = start_bus(*args)  # type: ignore[arg-type]
        return bus, [replace(motor, first_at_once=known) for motor in motors if isinstance(motor, StepMotor)]

    monkeypatch.setattr(rig, "module_of", at_once)
    monkeypatch.setattr(rig, "start_bus", told)
    outcome = stream(path, Conditions(0.2, seed=5), "exact")
    good(outcome)
    assert outcome.contour.contour_steps.max <= (2.2 if known else 3.0)


@pytest.mark.parametrize("jitter_ms", [0.7, 2.0, 5.0])
def test_a_host_far_slower_than_assumed_is_late_and_starts_nothing_that_moves(
    jitter_ms: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When an axis stands is counted from the answer to its Start, not from when that should have arrived."""
    monkeypatch.setattr(rig, "timing_of", lambda _: BusTiming.at(115200, jitter_max_ns=100_000))
    outcome = stream(random_path(1, 20.0, duration_s=1.5), Conditions(jitter_ms, seed=6), "exact")
    good(outcome)
    assert outcome.counts.late_slices > 10


@pytest.mark.parametrize("seed", range(4))
def test_held_in_the_middle_the_path_is_kept(seed: int) -> None:
    path = Warped(random_path(seed, 20.0, duration_s=3.0), 20.0)
    at_s = float(np.random.default_rng(seed).uniform(0.3, 1.5))
    outcome = stream(path, Conditions(0.2, seed=seed), "exact", [at_s], [(at_s + 0.6, 0.5), (at_s + 1.0, 1.0)])
    good(outcome)
    assert outcome.contour.contour_steps.max <= 2.3


# --- what goes over the bus -------------------------------------------------------------------------------------------


def sent(path: ClosedForm, conditions: Conditions) -> list[Evidence]:
    _, bus, motors = bring_up(path.axes, conditions)
    timing = timing_of(conditions)
    start_ns = bus.link.now_ns() + lead_in_ns(motors, timing)
    source = make_source(path, motors, timing=timing, start_ns=start_ns, profile="exact")
    return list(play(bus, source))


def test_every_piece_is_loaded_with_its_stop_and_begun_by_a_group_start_of_freshly_loaded_axes() -> None:
    told = sent(random_path(1, 20.0, duration_s=2.0), Conditions(seed=3))
    fresh: set[int] = set()
    members: set[int] = set()
    kept_moving = 0
    for evidence in told:
        exchange = evidence.exchange
        if exchange.command == LOAD_TRAJECTORY:
            assert exchange.data[0] & LOAD_POSITION
            assert not exchange.data[0] & START_NOW
            assert evidence.status is not None
            kept_moving += evidence.status & MOVING
            fresh.add(exchange.address)
        elif exchange.command == STOP_MOTOR:
            fresh.discard(exchange.address)
        elif exchange.command == SET_ADDRESS:
            stays = exchange.data[1] | 0x80 == STREAMING_GROUP
            members = members | {exchange.data[0]} if stays else members - {exchange.data[0]}
        elif exchange.command == START_MOTION:
            assert exchange.address == STREAMING_GROUP
            assert set(exchange.at_rest) == members == fresh
            assert evidence.status is not None
            assert not evidence.status & MOVING
            fresh = set()
    loads = sum(evidence.exchange.command == LOAD_TRAJECTORY for evidence in told)
    assert kept_moving > 0.8 * loads, "most are loaded while the piece before runs"


def test_the_slices_follow_each_other_with_the_plan() -> None:
    told = sent(circle(25.0, 20.0), Conditions(seed=3))
    starts = [evidence.sent_ns for evidence in told if evidence.exchange.command == START_MOTION]
    gaps_ms = np.array([(b - a) * 1e-6 for a, b in pairwise(starts)])
    assert np.median(gaps_ms) == pytest.approx(3.75, abs=0.25)  # two loads and a Start
    assert gaps_ms.max() < 12.0


# --- the guardian -----------------------------------------------------------------------------------------------------


def answered_otherwise(command: int, number: int, status: int) -> None:
    """A stream in which the ``number``-th exchange with ``command`` has another status byte than the module's."""
    path, conditions = line((30.0, 11.0, 4.0), 20.0), Conditions(seed=8)
    _, bus, motors = bring_up(path.axes, conditions)
    timing = timing_of(conditions)
    start_ns = bus.link.now_ns() + lead_in_ns(motors, timing)
    source = make_source(path, motors, timing=timing, start_ns=start_ns, profile="exact")
    exchange, seen = source.next(bus.link.now_ns(), None), 0
    while exchange is not None:
        evidence = bus.exchange(exchange)
        seen += exchange.command == command
        if seen == number and exchange.command == command:
            assert evidence.status is not None
            assert (evidence.status ^ status) & MOVING
            evidence = replace(evidence, status=status)
        exchange = source.next(bus.link.now_ns(), evidence)


def test_a_start_that_finds_its_leader_moving_ends_the_stream() -> None:
    with pytest.raises(StreamError, match="still moves"):
        answered_otherwise(START_MOTION, 20, MOVING)


def test_an_axis_that_stands_where_it_should_run_ends_the_stream() -> None:
    """A switch, say, has stopped it: the next piece must not leave from there."""
    with pytest.raises(StreamError, match="stands although"):
        answered_otherwise(LOAD_TRAJECTORY, 61, 0)
