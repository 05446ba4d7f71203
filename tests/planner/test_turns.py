"""Reversals and rests of joints from the path alone, against dense samples of the trajectory."""

import numpy as np
import pytest

from gcode import canon
from planner.kinematics import corexy
from planner.plan import plan
from planner.turns import turns_in_time, turns_of
from planner.types import Limits

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
ORIGIN = np.zeros(3)


def at(x=0.0, y=0.0, z=0.0):
    return (float(x), float(y), float(z), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_line_ends_at_rest_and_a_joint_that_others_outlast_rests_before():
    p = plan([canon.Feed(1, at(10), 20.0), canon.Feed(2, at(10, 10), 20.0)], LIMITS, start=ORIGIN).timed.intervals
    x, y, z = (turns_of(p, row) for row in np.eye(3))
    assert x.position == pytest.approx([10.0], abs=1e-9)
    assert not x.reverses.any()
    assert x.interval[0] < len(p) - 1
    assert y.position == pytest.approx([10.0], abs=1e-9)
    assert y.interval[0] == len(p) - 1
    assert len(z) == 0


def test_a_full_circle_reverses_at_its_quadrants():
    p = plan([canon.Arc(1, at(0, 0), (5.0, 0.0), "XY", 1, 20.0)], LIMITS, start=ORIGIN).timed.intervals
    x, y = turns_of(p, np.eye(3)[0]), turns_of(p, np.eye(3)[1])
    assert x.position == pytest.approx([10, 0], abs=2e-4)
    assert x.reverses.tolist() == [True, False]
    assert y.position == pytest.approx([-5, 5, 0], abs=2e-4)


def random_plan(seed, **more):
    rng = np.random.default_rng(seed)
    points = np.round(np.cumsum(rng.normal(size=(60, 3)) * rng.choice([0.05, 2.0], size=(60, 1)), axis=0), 2)
    commands = [canon.Feed(k, at(*q), 30.0) for k, q in enumerate(points)]
    commands.insert(30, canon.Dwell(99, 0.05))
    return plan(commands, LIMITS, start=ORIGIN, solver="kernel", **more)


def extremes(values):
    """Values at which a sampled sequence changes direction, its last one included."""
    step = np.diff(values)
    moving = np.flatnonzero(np.abs(step) > 1e-9)
    change = moving[1:][np.sign(step[moving][1:]) != np.sign(step[moving][:-1])]
    return np.append(values[change], values[-1])


@pytest.mark.parametrize("seed", range(8))
def test_published_turns_are_the_extremes_of_the_trajectory(seed):
    p = random_plan(seed)
    matrix = np.vstack([np.eye(3), corexy(("X", "Y", "Z"), np.ones(3), np.ones(3)).matrix[:2]])
    t = np.union1d(np.arange(0, p.trajectory.duration_s, 1e-5), p.trajectory.junctions_s())
    q = p.trajectory.q(t)
    for row in matrix:
        turns = turns_of(p.timed.intervals, row)
        found = extremes(q @ row)
        for value in found:
            assert np.abs(turns.position - value).min() < 1e-5
        assert len(found) <= len(turns) <= len(found) + 5  # the dwell and rests are turns without a reversal
        assert turns.position[-1] == pytest.approx((q @ row)[-1])


def test_the_next_turn_is_found_from_any_place():
    turns = turns_of(random_plan(3).timed.intervals, np.eye(3)[0])
    for k in range(len(turns)):
        assert turns.next(int(turns.interval[k]), float(turns.offset_mm[k])) == k
        after = turns.next(int(turns.interval[k]), float(turns.offset_mm[k]) + 1e-9)
        assert after == (k + 1 if k + 1 < len(turns) else None)


@pytest.mark.parametrize("tau", [0.0, 0.01])
def test_turns_in_time_are_where_the_velocity_is_zero(tau):
    t = random_plan(5, filter_s=tau).trajectory
    moments = np.arange(0, t.duration_s, 2e-5)
    for row in np.eye(3):
        times, positions = turns_in_time(t, row, 0.0, t.duration_s)
        found = extremes(t.q(moments) @ row)[:-1]
        assert len(times) == len(found)
        assert positions == pytest.approx(found, abs=1e-5)
        assert np.abs(t.v(times) @ row).max() < 1e-6
