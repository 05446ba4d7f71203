"""Planning while running: windows without a seam, and hold, resume and override from any state."""

import numpy as np
import pytest

from gcode import canon
from planner.live import live
from planner.plan import plan
from planner.timing import Rate
from planner.types import Limits

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
ORIGIN = np.zeros(3)


def at(x=0.0, y=0.0, z=0.0):
    return (float(x), float(y), float(z), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def winding(count=150, seed=1):
    """Lines, arcs, rapids, a dwell and a message on a winding path."""
    rng = np.random.default_rng(seed)
    out = [canon.Rapid(1, at(z=2))]
    point = np.array([0.0, 0, 2])
    for k in range(count):
        line = k + 2
        kind = rng.integers(0, 12)
        if kind == 0:
            out.append(canon.Dwell(line, 0.05))
        elif kind == 1:
            out.append(canon.Message(line, f"at {line}"))
        elif kind == 2:
            point = point + rng.normal(size=3) * 5
            out.append(canon.Rapid(line, at(*point)))
        elif kind == 3:
            radius = rng.uniform(1, 4)
            center = (point[0] + radius, point[1])
            point = point + np.array([2 * radius, 0, 0.5])
            out.append(canon.Arc(line, at(*point), center, "XY", -1, 30.0))
        else:
            point = point + rng.normal(size=3) * rng.choice([0.2, 3.0])
            out.append(canon.Feed(line, at(*point), float(rng.uniform(5, 55))))
    return out


def limits_hold(trajectory, end_s):
    t = np.arange(0, end_s, 2e-4)
    j = trajectory.junctions_s()
    for moments in (t, j, np.nextafter(j, 0.0)):
        assert (np.abs(trajectory.v(moments)).max(axis=0) <= LIMITS.velocity * 1.0001).all()
        assert (np.abs(trajectory.a(moments)).max(axis=0) <= LIMITS.acceleration * 1.0001).all()


def path_points(trajectory, end_s):
    q = trajectory.q(np.arange(0, end_s, 1e-3))
    return q[np.concatenate([[True], np.linalg.norm(np.diff(q, axis=0), axis=1) > 1e-9])]


def off_path(points, reference):
    """Largest distance of points to the fine samples' polyline of a reference, followed in order."""
    from planner.follow import follow

    return follow(points, reference, 0, 0.3, 1e-4)[0].max()


@pytest.fixture(scope="module")
def whole():
    return plan(winding(), LIMITS, start=ORIGIN, solver="kernel").trajectory


@pytest.fixture(scope="module")
def reference(whole):
    q = whole.q(np.arange(0, whole.duration_s, 5e-4))
    return q[np.concatenate([[True], np.linalg.norm(np.diff(q, axis=0), axis=1) > 1e-7])]


@pytest.mark.parametrize("moves", [5, 40, 1000])
def test_undisturbed_it_is_the_plan(whole, moves):
    t = live(winding(), LIMITS, start=ORIGIN, moves=moves)
    assert t.duration_s == pytest.approx(whole.duration_s, rel=1e-9)
    moments = np.linspace(0, whole.duration_s, 5000)
    assert np.abs(t.q(moments) - whole.q(moments)).max() < 1e-6
    assert [(e.time_s, e.command) for e in t.events] == [(pytest.approx(e.time_s), e.command) for e in whole.events]


def test_only_what_is_asked_for_is_read():
    read = []

    def source():
        for k, c in enumerate(winding(2000)):
            read.append(k)
            yield c

    t = live(source(), LIMITS, start=ORIGIN, moves=50)
    t.q(np.array([1.0]))
    assert len(read) < 400


def test_forgetting_the_past_changes_nothing_later(whole):
    t = live(winding(), LIMITS, start=ORIGIN, moves=20)
    for second in np.arange(0.5, whole.duration_s, 0.5):
        moments = np.linspace(second - 0.5, second, 50)
        assert np.abs(t.q(moments) - whole.q(moments)).max() < 1e-6
        t.forget(second)
    assert t.duration_s == pytest.approx(whole.duration_s)


def test_a_hold_rests_where_and_when_it_says_and_resume_ends_on_the_end(whole, reference):
    for sent in np.random.default_rng(3).uniform(0, whole.duration_s, 20):
        t = live(winding(), LIMITS, start=ORIGIN, moves=20)
        before = t.q(np.linspace(0, sent, 200))
        said = t.rest_if_held(sent)
        rest = t.hold(sent)
        assert (said.time_s, said.distance_mm) == (rest.time_s, rest.distance_mm)
        assert np.abs(t.v(np.array([rest.time_s, rest.time_s + 1]))).max() < 1e-9
        assert t.q(np.array([rest.time_s + 5]))[0] == pytest.approx(rest.q)
        assert rest.time_s - sent < 0.25
        t.resume(rest.time_s + 0.1)
        assert np.array_equal(t.q(np.linspace(0, sent, 200)), before)
        end = t.duration_s
        assert t.q(np.array([end]))[0] == pytest.approx(whole.q(np.array([whole.duration_s]))[0], abs=1e-9)
        assert len(t.events) == len(whole.events)
        assert off_path(path_points(t, end), reference) < 5e-5
        limits_hold(t, end)


def test_a_hold_during_a_dwell_keeps_the_rest_of_it(whole):
    dwell = next(e for e in whole.events if isinstance(e.command, canon.Dwell))
    t = live(winding(), LIMITS, start=ORIGIN, moves=20)
    rest = t.hold(dwell.time_s + 0.02)
    assert rest.time_s == pytest.approx(dwell.time_s + 0.02)
    assert rest.distance_mm == 0
    t.resume(rest.time_s + 1.0)
    assert t.duration_s == pytest.approx(whole.duration_s + 1.0, abs=1e-6)


def test_random_overrides_holds_and_resumes_keep_limits_path_and_events(whole, reference):
    rng = np.random.default_rng(7)
    for _ in range(12):
        t = live(winding(), LIMITS, start=ORIGIN, moves=15)
        now = 0.0
        while True:
            now += rng.exponential(0.4)
            if not t.held and t.complete and now >= t.settled_s:
                break
            action = rng.integers(0, 3)
            if action == 0:
                t.hold(now)
            elif action == 1:
                t.resume(now)
            else:
                t.override(now, Rate(float(rng.uniform(0.1, 2)), float(rng.uniform(0.1, 1))))
            if rng.random() < 0.3:
                t.resume(now)
        t.resume(now)
        end = t.duration_s
        assert t.q(np.array([end]))[0] == pytest.approx(reference[-1], abs=1e-3)
        assert [e.command for e in t.events] == [e.command for e in whole.events]
        assert off_path(path_points(t, end), reference) < 5e-5
        limits_hold(t, end)


def test_override_scales_feed_and_rapids_apart():
    commands = [canon.Feed(1, at(40), 20.0), canon.Dwell(2, 0.1), canon.Rapid(3, at(100))]
    t = live(commands, LIMITS, start=ORIGIN)
    t.override(0.0, Rate(1.5, 0.5))
    end = t.duration_s
    q, v = t.q(np.linspace(0, end, 4000))[:, 0], t.v(np.linspace(0, end, 4000))[:, 0]
    assert v[q < 39.9].max() == pytest.approx(30.0)
    assert v[q > 40.1].max() == pytest.approx(30.0)


DWELLS_S = 0.05 * sum(isinstance(command, canon.Dwell) for command in winding())


@pytest.mark.parametrize("share", [0.8, 0.3])
def test_a_slower_bus_stretches_time_and_so_lowers_accelerations_by_the_square(whole, reference, share):
    slower = live(winding(), LIMITS, start=ORIGIN)
    slower.override(0.0, Rate(bus=share))
    duration_s = slower.duration_s
    assert share * (duration_s - DWELLS_S) == pytest.approx(whole.duration_s - DWELLS_S)
    t = np.arange(0, duration_s, 2e-4)
    assert (np.abs(slower.a(t)).max(axis=0) <= share**2 * LIMITS.acceleration * 1.0001).all()
    assert (np.abs(slower.v(t)).max(axis=0) <= share * LIMITS.velocity * 1.0001).all()
    assert off_path(path_points(slower, duration_s), reference) < 1e-3


@pytest.mark.parametrize("share", [0.8, 0.3])
def test_a_bus_that_becomes_slower_brakes_as_planned_and_is_soon_inside_its_limits(whole, reference, share):
    for sent_s in np.linspace(0.1, whole.duration_s * 0.9, 12):
        moving = live(winding(), LIMITS, start=ORIGIN)
        moving.override(sent_s, Rate(bus=share))
        end_s = moving.duration_s
        limits_hold(moving, end_s)
        t = np.arange(sent_s + 0.2, end_s, 1e-3)
        assert (np.abs(moving.a(t)).max(axis=0) <= share**2 * LIMITS.acceleration * 1.0001).all()
        assert off_path(path_points(moving, end_s), reference) < 1e-3


def test_a_bus_that_is_quick_again_gives_the_limits_back(whole):
    moving = live(winding(), LIMITS, start=ORIGIN)
    moving.override(1.0, Rate(bus=0.5))
    moving.override(2.0, Rate())
    end_s = moving.duration_s
    limits_hold(moving, end_s)
    assert whole.duration_s < end_s < whole.duration_s + 1.0
    late = np.abs(moving.a(np.arange(2.5, end_s, 1e-3))).max(axis=0)
    assert (late > 0.99 * LIMITS.acceleration).all()


def test_a_filtered_hold_drains_before_it_says_rest():
    t = live(winding(), LIMITS, start=ORIGIN, moves=20, filter_s=0.02)
    whole = plan(winding(), LIMITS, start=ORIGIN, solver="kernel", filter_s=0.02).trajectory
    before = t.q(np.linspace(0, 2.0, 500))
    rest = t.hold(2.0)
    assert np.abs(t.v(np.array([rest.time_s]))).max() < 1e-9
    t.resume(rest.time_s + 0.3)
    assert np.abs(t.q(np.linspace(0, 2.0, 500)) - before).max() < 1e-9
    end = t.duration_s
    assert t.q(np.array([end]))[0] == pytest.approx(whole.q(np.array([whole.duration_s]))[0], abs=1e-6)
    limits_hold(t, end)
