"""A host that dies anywhere in any stream: within the bounds of the path's radius, at rest, inside the job's box.

The whole table is ``python -m benchmarks.hostdeath``; here a few deaths of each kind.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.hostdeath import JOBS, Case, bench_job, die
from benchmarks.paths import circle, random_path
from benchmarks.rig import Conditions, bring_up, timing_of
from nmc.executor import play
from planner.stream import lead_in_ns, make_source

SERVOS = ("X", "Y", "Z")


@pytest.mark.parametrize("name", JOBS)
@pytest.mark.parametrize("seed", range(2))
def test_steppers_stop_near_the_path(name: str, seed: int) -> None:
    path = JOBS[name](seed)
    dice = np.random.default_rng(seed)
    at_s = float(dice.uniform(0.1, min(path.duration_s, 3.0) - 0.1))
    death = die(Case(path, Conditions(0.2, seed=seed), "adaptive", at_s, int(dice.integers(0, 12))))
    assert death is not None
    assert death.good, death
    assert death.rest_ms < 51.6


@pytest.mark.parametrize(("feed", "off_mm"), [(20.0, 0.03), (60.0, 0.2)])
@pytest.mark.parametrize("profile", ["adaptive", "group"])
def test_off_the_circle_by_no_more_than_its_tangent(feed: float, off_mm: float, profile: str) -> None:
    for seed in range(3):
        death = die(Case(circle(25.0, feed), Conditions(seed=seed), profile, 0.8 + 0.37 * seed, seed * 3))  # type: ignore[arg-type]
        assert death is not None
        assert death.good
        assert death.off_mm <= off_mm


@pytest.mark.parametrize("profile", ["smooth", "stop-here"])
def test_servos_stop_near_the_path(profile: str) -> None:
    for at_s in (0.31, 1.73):
        path = random_path(3, 40.0, duration_s=3.0)
        death = die(Case(path, Conditions(seed=2, servos=SERVOS), profile, at_s))  # type: ignore[arg-type]
        assert death is not None
        assert death.good, death
        assert death.rest_ms < 52.0


@pytest.mark.parametrize("last_bytes", range(12))
def test_at_every_byte_of_a_packet(last_bytes: int) -> None:
    path = circle(2.0, 20.0)
    death = die(Case(path, Conditions(0.2, seed=last_bytes), "adaptive", 0.3, last_bytes))
    assert death is not None
    assert death.good, death


@pytest.mark.parametrize("profile", ["adaptive", "group"])
def test_between_a_set_address_and_the_arrival_of_an_axis(profile: str) -> None:
    for seed in range(4):
        path = random_path(seed, 20.0, duration_s=3.0)
        case = Case(path, Conditions(seed=seed), profile, 0.2 + 0.4 * seed, behind_set_address=True)  # type: ignore[arg-type]
        death = die(case)
        if death is not None:  # else no axis changed its group any more
            assert death.good, death


@pytest.mark.parametrize("name", ["circle 50 mm, 20", "square r1, 40", "random 60"])
def test_without_a_watchdog_steppers_end_inside_the_job(name: str) -> None:
    for seed in range(2):
        path = JOBS[name](seed)
        case = Case(path, Conditions(0.2, seed=seed), "adaptive", 0.4 + 0.7 * seed, 4, watchdog=False)
        death = die(case)
        assert death is not None
        assert death.stands
        assert death.inside


def test_without_a_watchdog_a_stop_here_stream_stands() -> None:
    path = random_path(5, 40.0, duration_s=3.0)
    death = die(Case(path, Conditions(seed=3, servos=SERVOS), "stop-here", 0.9, watchdog=False))
    assert death is not None
    assert death.stands
    assert death.inside
    assert death.rest_ms < 5.0


def test_a_bench_job_while_it_speeds_up_on_a_line() -> None:
    for seed in range(2):
        death = die(Case(bench_job("b"), Conditions(0.2, seed=seed), "adaptive", 0.3 + 0.5 * seed, seed))
        assert death is not None
        assert death.good, death


@pytest.mark.parametrize("letter", ["a", "b", "c"])
def test_an_axis_that_sets_out_alone_is_soon_in_the_group_that_stops_first(letter: str) -> None:
    """Axes of one path that are in two groups stop one after the other, and leave it by their speed times that."""
    path, conditions = bench_job(letter), Conditions(0.2, seed=2)
    _, bus, motors = bring_up(path.axes, conditions)
    timing = timing_of(conditions)
    start_ns = bus.link.now_ns() + lead_in_ns(motors, timing)
    parked = {motor.address for motor in motors}
    alone_ns: dict[int, int] = {}
    joined: list[int] = []
    for evidence in play(bus, make_source(path, motors, timing=timing, start_ns=start_ns, profile="adaptive")):
        said = evidence.exchange
        if said.command == 0x1 and said.data[1] | 0x80 == 0x81:
            parked.discard(said.address)
            if said.address in alone_ns:
                joined.append(evidence.sent_ns - alone_ns.pop(said.address))
        elif said.command == 0x1:
            parked.add(said.address)
        elif said.command == 0x4 and said.address in parked and said.data[0] & 0x81 == 0x81:
            alone_ns[said.address] = evidence.sent_ns
        if evidence.sent_ns > start_ns + 1_200_000_000:
            break
    assert len(joined) >= 2, "X and Y of the first rapid set out one by one"
    assert max(joined) < 15_000_000
    assert not alone_ns
