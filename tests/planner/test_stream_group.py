"""Profile ``group``: one Start a slice, all members freshly loaded, counters read back, no slice longer than needed."""

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from stream_rig import Conditions, bring_up, line, random_path, said, stream

from benchmarks.rig import timing_of
from nmc.executor import play, stop_all
from planner.stream import lead_in_ns, make_source
from planner.stream_axis import LOAD_TRAJECTORY, START_NOW
from planner.stream_base import COUNT_BYTES, SET_ADDRESS, START_MOTION, STOP_MOTOR
from planner.stream_error import StreamError
from planner.stream_feedback import READ_STATUS, SAVE_HOME
from planner.stream_regroup import STREAMING_GROUP


@pytest.mark.parametrize(
    ("feed_mm_s", "jitter_ms", "most", "p999", "rms"),
    [
        (20.0, 0.0, 3.0, 1.9, 0.58),
        (60.0, 0.2, 4.4, 2.5, 0.66),
        (20.0, 2.0, 8.5, 5.5, 0.75),
        (60.0, 2.0, 13.0, 11.0, 1.4),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_random_paths_are_met(
    feed_mm_s: float, jitter_ms: float, most: float, p999: float, rms: float, seed: int
) -> None:
    outcome = stream(random_path(seed, feed_mm_s, duration_s=4.0), Conditions(jitter_ms, seed=seed + 40), "group")
    assert set(outcome.contour.end_error_steps.values()) == {0}
    assert outcome.violations == {}
    steps = outcome.contour.contour_steps
    assert steps.max <= most
    assert steps.p999 <= p999
    assert steps.rms <= rms


@pytest.mark.parametrize("jitter_ms", [0.0, 2.0])
def test_every_member_of_a_start_is_freshly_loaded(jitter_ms: float) -> None:
    fresh: set[int] = set()
    members: set[int] = set()
    starts = 0
    for evidence in said(random_path(1, 40.0, duration_s=2.0), Conditions(jitter_ms, seed=3), "group"):
        exchange = evidence.exchange
        if not evidence.sent:
            continue
        if exchange.command == LOAD_TRAJECTORY:
            started = exchange.data[0] & START_NOW
            fresh = fresh - {exchange.address} if started else fresh | {exchange.address}
        elif exchange.command == STOP_MOTOR:
            fresh.discard(exchange.address)
        elif exchange.command == SET_ADDRESS:
            stays = exchange.data[1] | 0x80 == STREAMING_GROUP
            members = members | {exchange.data[0]} if stays else members - {exchange.data[0]}
        elif exchange.command == START_MOTION:
            assert exchange.address == STREAMING_GROUP
            assert members == fresh != set()
            fresh = set()
            starts += 1
    assert starts > 50


def test_counters_are_latched_together_between_two_slices_and_read_one_by_one() -> None:
    told = said(random_path(1, 20.0, duration_s=2.0), Conditions(seed=3), "group")
    pending = latches = reads = 0
    for evidence in told:
        exchange = evidence.exchange
        if exchange.command == LOAD_TRAJECTORY:
            pending += not exchange.data[0] & START_NOW
        elif exchange.command == START_MOTION:
            pending = 0
        elif exchange.command == SAVE_HOME:
            assert exchange.address == STREAMING_GROUP
            assert not pending, "what is loaded must not wait longer for its Start"
            latches += 1
        elif exchange.command == READ_STATUS:
            assert not pending
            reads += 1
    assert latches >= 2.0 / 0.03
    assert reads > latches


def test_slices_take_what_exchanges_take_on_average() -> None:
    conditions = Conditions(2.0, seed=5)
    told = said(line((40.0, 25.0, 15.0), 40.0), conditions, "group")
    starts = [evidence.sent_ns for evidence in told if evidence.exchange.command == START_MOTION]
    timing = timing_of(conditions)
    mean_ns = 3 * timing.mean_exchange_ns(COUNT_BYTES) + timing.mean_exchange_ns(0)
    worst_ns = 3 * timing.worst_ns(COUNT_BYTES) + timing.worst_ns(0)
    gaps_ns = np.array([b - a for a, b in pairwise(starts)])
    assert np.median(gaps_ns) <= 1.25 * mean_ns < 0.8 * worst_ns


@pytest.mark.parametrize("seed", range(5))
def test_counts_that_act_at_once_are_found_out(seed: int) -> None:
    path = random_path(seed, 20.0, duration_s=3.0)
    conditions = Conditions(seed=seed, count_latch="immediate")
    _, bus, motors = bring_up(path.axes, conditions)
    timing = timing_of(conditions)
    start_ns = bus.link.now_ns() + lead_in_ns(motors, timing)
    source = make_source(path, motors, timing=timing, start_ns=start_ns, profile="group")
    with pytest.raises(StreamError, match="axis"):
        for _ in play(bus, source):
            pass
    stop_all(bus)
    assert bus.link.now_ns() - start_ns < 150_000_000
