"""One trajectory on several buses: as near the path as on one, held and overridden together, ends exact."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.paths import Warped, circle, random_path
from benchmarks.rig import Conditions, stream, timing_of
from benchmarks.rig_buses import SharedOutcome, bring_up_buses, stream_buses
from gcode.canon import Dwell, Feed
from planner.live import live
from planner.motors import StepMotor
from planner.stream_buses import BusStreams, lead_in_of_buses_ns, make_sources
from planner.types import Limits

XY_Z = (("X", "Y"), ("Z",))
SPLITS = {
    1: (("X",),),
    2: (("X",), ("Y",)),
    3: XY_Z,
    4: (("X", "Y"), ("Z", "A")),
    5: (("X", "Y"), ("Z", "A"), ("B",)),
    6: (("X", "Y", "Z"), ("A", "B", "C")),
    7: (("X", "Y", "Z"), ("A", "B"), ("C", "U")),
    8: (("X", "Y", "Z", "A"), ("B", "C", "U", "V")),
}


def good(outcome: SharedOutcome) -> None:
    assert set(outcome.contour.end_error_steps.values()) == {0}
    assert outcome.violations == {}


@pytest.mark.parametrize("axes", SPLITS)
def test_one_to_eight_axes_on_several_buses_end_exact(axes: int) -> None:
    path = random_path(axes, 20.0, axes, duration_s=1.5)
    outcome = stream_buses(path, SPLITS[axes], Conditions(seed=axes))
    assert path.axes == sum(SPLITS[axes], ())
    good(outcome)
    assert outcome.counts.late_slices == 0
    assert outcome.contour.contour_steps.p999 <= 1.25 + 0.15 * max(axes - 3, 0)


@pytest.mark.parametrize("jitter_ms", [0.0, 0.2, 2.0])
@pytest.mark.parametrize("profile", ["adaptive", "group"])
def test_every_profile_ends_exact_and_no_worse_than_on_one_bus(profile: str, jitter_ms: float) -> None:
    conditions = Conditions(jitter_ms, seed=7)
    path = random_path(3, 20.0, duration_s=2.0)
    outcome = stream_buses(path, XY_Z, conditions, profile)  # type: ignore[arg-type]
    alone = stream(path, conditions, profile)  # type: ignore[arg-type]
    good(outcome)
    assert outcome.contour.contour_steps.rms <= 1.5 * alone.contour.contour_steps.rms + 0.1


@pytest.mark.parametrize(("jitter_ms", "rms"), [(0.0, 1.0), (0.2, 1.1), (2.0, 2.5)])
def test_axes_that_pause_on_two_buses_pause_each_at_its_own_time(jitter_ms: float, rms: float) -> None:
    """What all axes of one bus do together is no error there (0.6 steps rms), but it is one between two buses."""
    outcome = stream_buses(random_path(3, 20.0, duration_s=2.0), XY_Z, Conditions(jitter_ms, seed=7), "exact")
    good(outcome)
    assert outcome.contour.contour_steps.rms <= rms


def test_two_buses_of_three_axes_are_better_than_one_of_six_with_a_slow_host() -> None:
    spreads = []
    for seed in (1, 2, 3):
        path, conditions = random_path(seed, 20.0, 6, duration_s=2.0), Conditions(2.0, seed=seed + 1)
        both = stream_buses(path, SPLITS[6], conditions)
        alone = stream(path, conditions, "adaptive")
        good(both)
        spreads.append([each.contour.contour_steps for each in (both, alone)])
        assert both.packets > 1.2 * alone.packets
        assert both.overlap > 0.25
    assert sum(both.p999 for both, _ in spreads) < 0.7 * sum(alone.p999 for _, alone in spreads)
    # of the root mean square most is the rounding to steps
    assert sum(both.rms for both, _ in spreads) < 0.95 * sum(alone.rms for _, alone in spreads)


@pytest.mark.parametrize("profile", ["smooth", "stop-here"])
def test_servos_on_one_bus_and_steppers_on_another(profile: str) -> None:
    conditions = Conditions(0.2, seed=5, servos=("X", "Y"))
    outcome = stream_buses(random_path(4, 20.0, duration_s=2.0), XY_Z, conditions, profile)  # type: ignore[arg-type]
    good(outcome)
    if profile == "smooth":
        assert outcome.contour.contour_um.p999 < 15.0


def test_a_servo_whose_plan_ends_just_beyond_half_a_count_ends_on_the_count_beyond() -> None:
    path = random_path(2, 20.0)
    assert 0.5 < float(400 * path.q(np.array([path.duration_s]))[0, 0]) % 1 < 0.52
    good(stream_buses(path, XY_Z, Conditions(2.0, servos=("X", "Y"), seed=102), "smooth"))


def test_buses_set_out_together() -> None:
    outcome = stream_buses(random_path(1, 20.0, duration_s=1.0), XY_Z, Conditions(seed=2))
    assert outcome.skew is not None
    assert outcome.skew.motions >= 1
    assert outcome.skew.worst_ns == 0, "in virtual time every Start leaves when it is due"


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("feed", "jitter_ms"), [(20.0, 0.0), (60.0, 0.0), (60.0, 2.0)])
def test_hold_and_resume_of_all_buses_at_once(feed: float, jitter_ms: float, seed: int) -> None:
    base = random_path(seed, feed, duration_s=2.5)
    first = float(np.random.default_rng(seed).uniform(0.2, 0.9))
    holds = [first, first + 0.9]  # the second one when the resume from the first is over
    outcome = stream_buses(Warped(base, feed), XY_Z, Conditions(jitter_ms, seed=seed), "adaptive", holds)
    good(outcome)
    assert outcome.contour.contour_steps.max <= (4.5 if not jitter_ms else 12.0)
    assert outcome.contour.sim_time_s > base.duration_s


@pytest.mark.parametrize("profile", ["group", "smooth", "stop-here"])
def test_other_profiles_hold_on_several_buses_too(profile: str) -> None:
    servos = () if profile == "group" else ("X", "Y")
    path = Warped(circle(2.0, 20.0), 20.0)
    outcome = stream_buses(path, XY_Z, Conditions(servos=servos), profile, [0.3])  # type: ignore[arg-type]
    good(outcome)


@pytest.mark.parametrize("jitter_ms", [0.0, 2.0])
def test_overrides_reach_all_buses(jitter_ms: float) -> None:
    path = Warped(random_path(5, 20.0, duration_s=3.0), 20.0)
    rates = [(0.5, 0.4), (1.5, 1.0), (2.0, 0.1), (3.0, 1.0)]
    outcome = stream_buses(path, XY_Z, Conditions(jitter_ms, seed=2), "adaptive", overrides=rates)
    good(outcome)
    if not jitter_ms:
        assert outcome.contour.contour_steps.max <= 3.0


DWELLING = [
    Feed(1, (10.0, 0.0, *(0.0,) * 7), 25.0),
    Dwell(2, 1.0),
    Feed(3, (10.0, 0.0, 4.0, *(0.0,) * 6), 15.0),
    Dwell(4, 1.0),
    Feed(5, (0.0, 8.0, 0.0, *(0.0,) * 6), 25.0),
]


@pytest.mark.parametrize("at_s", [0.2, 0.9, 1.35, 1.45, 1.9, 2.6])
def test_a_hold_in_a_dwell_takes_back_the_starts_that_wait(at_s: float) -> None:
    limits = Limits(("X", "Y", "Z"), np.array([60.0, 60.0, 20.0]), np.array([500.0, 500.0, 200.0]), 0.01)
    trajectory = live(DWELLING, limits, start=np.zeros(3))
    outcome = stream_buses(trajectory, XY_Z, Conditions(seed=4), "adaptive", [at_s])
    good(outcome)
    assert outcome.contour.contour_steps.max <= 4.5


def streams_of(profile: str = "adaptive") -> tuple[BusStreams, Warped]:
    conditions = Conditions(seed=1)
    several = bring_up_buses(XY_Z, conditions)
    timings = dict.fromkeys((0, 1), timing_of(conditions))
    trajectory = Warped(circle(2.0, 20.0), 20.0)
    now_ns = several.buses[0].link.now_ns()
    start_ns = now_ns + lead_in_of_buses_ns(several.motors, timings)
    profiles = dict.fromkeys((0, 1), profile)
    streams = make_sources(trajectory, several.motors, timings=timings, start_ns=start_ns, profiles=profiles)  # type: ignore[arg-type]
    return streams, trajectory


@pytest.mark.parametrize("profile", ["group", "adaptive", "exact"])
def test_a_trajectory_that_cannot_be_timed_anew_says_so_before_any_bus_is_held(profile: str) -> None:
    streams, trajectory = streams_of(profile)
    for each in streams.streams:
        each.trajectory = trajectory.base
    with pytest.raises(ValueError, match="cannot be timed anew"):
        streams.hold()
    assert not streams.held


@pytest.mark.parametrize("profile", ["group", "exact"])
def test_every_profile_of_steppers_can_be_held(profile: str) -> None:
    outcome = stream_buses(Warped(circle(2.0, 10.0), 10.0), XY_Z, Conditions(seed=6), profile, [0.5])  # type: ignore[arg-type]
    good(outcome)


def test_what_is_due_late_is_kept_back_and_the_bus_is_asked_meanwhile() -> None:
    streams, trajectory = streams_of()
    lane = streams.lanes[1]  # Z stands on this path, so nothing of it is ever due
    assert lane.next(0, None) is None
    assert lane.finished
    lane = streams.lanes[0]
    exchange = lane.next(0, None)
    assert exchange is not None
    assert exchange.bus == 0
    progress = streams.progress()
    assert progress.time_s == 0.0
    assert progress.duration_s == pytest.approx(trajectory.duration_s)


def test_the_lead_in_is_that_of_the_slowest_bus() -> None:
    motors = [StepMotor(name, name, bus, 1, 200.0, 2) for bus, name in enumerate("XY")]
    quick, slow = timing_of(Conditions(0.0)), timing_of(Conditions(2.0))
    assert lead_in_of_buses_ns(motors, {0: quick, 1: slow}) == lead_in_of_buses_ns(motors, {0: slow, 1: slow})


def test_a_start_that_waits_is_taken_back() -> None:
    limits = Limits(("X", "Y", "Z"), np.array([60.0, 60.0, 20.0]), np.array([500.0, 500.0, 200.0]), 0.01)
    outcome = stream_buses(live(DWELLING, limits, start=np.zeros(3)), XY_Z, Conditions(seed=4), "adaptive", [1.0])
    good(outcome)
    assert outcome.counts.late_slices == 0
