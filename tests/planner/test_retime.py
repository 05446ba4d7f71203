"""A finished plan that is timed anew while it runs: the same path, the same end, the same limits."""

import numpy as np
import pytest

from gcode import canon
from planner.follow import follow
from planner.plan import Plan, plan
from planner.retime import RetimablePlan
from planner.timing import Rate
from planner.types import Limits

VELOCITY, ACCELERATION = np.array([60.0, 60, 20]), np.array([500.0, 500, 200])
LIMITS = Limits(("X", "Y", "Z"), VELOCITY, ACCELERATION, 0.010)
SMOOTH = Limits(("X", "Y", "Z"), VELOCITY, ACCELERATION, 0.010, jerk=np.array([20e3, 20e3, 10e3]))


def at(x=0.0, y=0.0, z=0.0):
    return (float(x), float(y), float(z), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def program(extra=()):
    """Lines, an arc, rapids, dwells, a stop in the middle."""
    return [
        canon.Rapid(1, at(5, 5, 2)),
        canon.Feed(2, at(5, 5, 0), 10.0),
        *extra,
        canon.Feed(3, at(25, 5), 40.0),
        canon.Arc(4, at(25, 15), (25.0, 10.0), "XY", 1, 30.0),
        canon.Dwell(5, 0.1),
        canon.Message(5, "halfway"),
        canon.Feed(6, at(5, 15, 1), 40.0),
        canon.Stop(7, False),
        canon.Feed(8, at(5, 5, 0), 30.0),
        canon.Feed(9, at(9, 5.5, 0), 30.0),
        canon.Rapid(10, at()),
    ]


def retimable(limits=LIMITS, commands=None) -> tuple[Plan, RetimablePlan]:
    made = plan(program() if commands is None else commands, limits, start=np.zeros(3), solver="kernel")
    return made, RetimablePlan(made)


def within_limits(trajectory, end_s: float) -> None:
    t = np.concatenate([np.arange(0, end_s, 2e-4), trajectory.junctions_s()])
    assert (np.abs(trajectory.v(t)).max(axis=0) <= VELOCITY * 1.0001).all()
    assert (np.abs(trajectory.a(t)).max(axis=0) <= ACCELERATION * 1.0001).all()


def on_path(trajectory, whole) -> None:
    q, wanted = (each.q(np.arange(0, each.duration_s, 5e-4)) for each in (trajectory, whole))
    q, wanted = (p[np.append(True, np.linalg.norm(np.diff(p, axis=0), axis=1) > 1e-7)] for p in (q, wanted))
    assert follow(q, wanted, 0, 0.3, 1e-4)[0].max() < 2e-4


def test_undisturbed_it_is_the_plan_itself() -> None:
    made, again = retimable()
    t = np.linspace(0, made.trajectory.duration_s, 999)
    assert np.array_equal(again.q(t), made.trajectory.q(t))
    assert again.streamed() is made.trajectory
    assert not again.disturbed


@pytest.mark.parametrize("limits", [LIMITS, SMOOTH], ids=["as it is", "jerk filter"])
def test_held_and_resumed_it_keeps_path_limits_end_and_events(limits) -> None:
    made, _ = retimable(limits)
    whole = made.trajectory
    for sent_s in np.random.default_rng(1).uniform(0, whole.duration_s, 25):
        again = RetimablePlan(made)
        rest = again.hold(sent_s)
        before = np.linspace(0, sent_s, 50)
        assert np.abs(again.q(before) - whole.q(before)).max() < 1e-9
        assert np.abs(again.v(np.array([rest.time_s + 1e-6]))).max() < 1e-9
        again.resume(rest.time_s + 0.2)
        streamed = again.streamed()
        assert streamed.duration_s > whole.duration_s
        assert np.abs(streamed.q(np.array([streamed.duration_s])) - whole.q(np.array([whole.duration_s]))).max() < 1e-9
        assert [event.command for event in streamed.events] == [event.command for event in whole.events]
        within_limits(streamed, streamed.duration_s)
        if limits is LIMITS:
            on_path(streamed, whole)


def test_a_hold_before_the_beginning_keeps_everything_for_the_resume() -> None:
    made, again = retimable()
    assert again.hold(-0.04).time_s == 0.0
    again.resume(1.0)
    assert again.duration_s == pytest.approx(made.trajectory.duration_s + 1.0)


def test_half_the_feed_takes_longer_and_the_whole_one_not() -> None:
    made, again = retimable()
    again.override(0.0, Rate(feed=0.5))
    on_path(again, made.trajectory)
    assert again.duration_s > 1.4 * made.trajectory.duration_s
    again.override(0.5, Rate())
    assert again.duration_s < 1.15 * made.trajectory.duration_s


def test_a_stretch_is_timed_anew_by_itself() -> None:
    from machines.parts import parts_of

    for limits in (LIMITS, SMOOTH):
        made, _ = retimable(limits)
        first, second = parts_of(made.trajectory)
        for each in (first, second):
            for sent_s in np.random.default_rng(2).uniform(0, each.duration_s, 12):
                again = RetimablePlan(made, each, each.begin_s)
                t = np.linspace(0, sent_s, 50)
                rest = again.hold(sent_s)
                assert np.abs(again.q(t) - each.q(t)).max() < 1e-9
                again.resume(rest.time_s + 0.1)
                end = again.duration_s
                assert np.abs(again.q(np.array([end])) - each.q(np.array([each.duration_s]))).max() < 1e-9
                assert [e.command for e in again.events] == [e.command for e in each.events]


def test_where_the_program_forbids_overrides_only_the_bus_slows() -> None:
    forbidden = [canon.Text(2, "DISABLE_FEED_OVERRIDE()")]
    free, fixed = retimable()[1], retimable(commands=program(forbidden))[1]
    whole_s = free.duration_s
    for each in (free, fixed):
        each.override(0.0, Rate(feed=0.5, rapid=0.5))
    only_before_s = fixed.duration_s
    assert free.duration_s > 1.5 * whole_s
    assert whole_s < only_before_s < whole_s + 0.5  # the rapid of line 1 and the plunge of line 2 come before
    assert np.abs(fixed.v(np.arange(1.0, 2.0, 0.01))).max() > 39.0
    fixed.override(0.0, Rate(bus=0.5))
    assert fixed.duration_s > 1.5 * whole_s


def test_where_it_allows_them_again_they_act() -> None:
    again = [canon.Text(2, "DISABLE_FEED_OVERRIDE()"), canon.Text(3, "ENABLE_FEED_OVERRIDE()")]
    switched, free = retimable(commands=program(again))[1], retimable()[1]
    for each in (switched, free):
        each.override(0.0, Rate(feed=0.5))
    assert switched.duration_s == pytest.approx(free.duration_s, rel=1e-6)


def test_random_holds_and_overrides_of_one_run_end_on_the_end() -> None:
    made, _ = retimable()
    dice = np.random.default_rng(5)
    for _ in range(10):
        again, now, held = RetimablePlan(made), 0.0, False
        while held or now < again.duration_s:
            now += float(dice.exponential(0.3))
            if held:
                again.resume(now)
            elif dice.random() < 0.4:
                again.hold(now)
                held = True
                continue
            else:
                again.override(now, Rate(float(dice.uniform(0.3, 1.6)), float(dice.uniform(0.3, 1.0))))
            held = False
        streamed = again.streamed()
        within_limits(streamed, streamed.duration_s)
        on_path(streamed, made.trajectory)
        assert np.abs(streamed.q(np.array([streamed.duration_s]))).max() < 1e-9


def test_a_slower_feed_acts_at_once_on_a_long_line() -> None:
    _, again = retimable(commands=[canon.Feed(1, at(60), 40.0)])
    again.override(0.5, Rate(feed=0.5))
    speed = again.v(np.array([0.49, 0.501, 0.52, 0.545, 0.6, 1.0]))[:, 0]
    assert speed == pytest.approx([40.0, 39.5, 30.0, 20.0, 20.0, 20.0])
