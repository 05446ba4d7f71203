"""An axis of which too little is known is asked for its counter; one that is far off is not left waiting."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from stream_rig import Conditions, brought_up, random_path, stream

from nmc.executor import play, stop_all
from nmc.program import Evidence
from planner.stream_error import StreamError
from planner.stream_feedback import DOUBT_STEPS, POSITION_ITEM, READ_STATUS


def is_look(evidence: Evidence) -> bool:
    return evidence.exchange.command == READ_STATUS and evidence.exchange.data == POSITION_ITEM


def test_who_is_doubtful_is_asked_and_known_then() -> None:
    path, conditions = random_path(3, 60.0, duration_s=3.0), Conditions(2.0, seed=4)
    bus, source = brought_up(path, conditions, "adaptive")
    axes = {axis.motor.address: axis for axis in source._stream.axes}
    looks = surer = 0
    asked: tuple[int, float] | None = None
    for evidence in play(bus, source):  # what it says is taken in when the next exchange is asked for
        if asked is not None:
            address, before = asked
            surer += axes[address].doubt_steps < before
        asked = None
        if is_look(evidence):
            looks += 1
            asked = evidence.exchange.address, axes[evidence.exchange.address].doubt_steps
            assert asked[1] > DOUBT_STEPS
    assert looks > 20
    assert surer > 0.8 * looks


def test_a_counter_that_no_chip_could_have_ends_the_stream() -> None:
    path, conditions = random_path(3, 60.0, duration_s=3.0), Conditions(2.0, seed=4)
    bus, source = brought_up(path, conditions, "adaptive")
    axes = {axis.motor.address: axis for axis in source._stream.axes}

    evidences = play(bus, source)
    while bus.link.now_ns() < source.plan_start_ns + 1_000_000_000:
        next(evidences)
    for axis in axes.values():  # what was believed is forty steps off all of a sudden
        axis.twin.fast.left += 40
        axis.twin.slow.left += 40
    with pytest.raises(StreamError, match="where its twins exclude it"):
        list(evidences)
    stop_all(bus)
    assert bus.link.now_ns() < source.plan_start_ns + 1_100_000_000


@pytest.mark.parametrize("seed", [22, 30])
def test_nobody_starves_on_a_full_bus(seed: int) -> None:
    # 60 mm/s and delays of 2 ms: a slow axis was 24 steps off here because two fast ones always mended more at once
    outcome = stream(random_path(seed, 60.0), Conditions(2.0, seed=seed + 100), "adaptive")
    assert outcome.contour.contour_steps.max <= 6.0
    assert outcome.contour.contour_steps.p999 <= 4.0
    assert set(outcome.contour.end_error_steps.values()) == {0}
    assert outcome.violations == {}
