"""The jerk filter: limits kept, jerk bounded, q twice differentiable, ends exact, tolerance shared."""

import numpy as np
import pytest

from gcode import canon
from planner.measure import measure
from planner.plan import plan
from planner.reader import MoveReader
from planner.types import Limits

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
ORIGIN = np.zeros(3)


def at(x=0.0, y=0.0, z=0.0):
    return (float(x), float(y), float(z), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def program():
    """Corners, a circle, dense segments, a reversal and a dwell."""
    s = np.arange(1, 400) * 0.1
    dense = np.round(np.column_stack([10 + s, 3 * np.sin(s), 0.3 * np.cos(3 * s)]), 3)
    return [
        canon.Rapid(1, at(z=1)),
        canon.Feed(2, at(5, 0, 1), 40.0),
        canon.Feed(3, at(5, 5, 0), 40.0),
        canon.Arc(4, at(5, 5, 0), (5.0, 8.0), "XY", 1, 40.0),
        canon.Dwell(5, 0.1),
        canon.Feed(6, at(10, 0, 0.3), 40.0),
        *(canon.Feed(7 + k, at(*p), 40.0) for k, p in enumerate(dense)),
        canon.Rapid(500, at(0, 0, 0)),
        canon.Rapid(501, at(20, 0, 0)),
        canon.Rapid(502, at(0, 0, 0)),
    ]


@pytest.mark.parametrize("tau", [0.005, 0.010, 0.020, 0.040])
def test_filtered_plans_keep_limits_tolerance_and_jerk(tau):
    commands = program()
    t = plan(commands, LIMITS, start=ORIGIN, solver="kernel", filter_s=tau).trajectory
    reader = MoveReader(LIMITS.axes, ORIGIN, LIMITS.tolerance_mm)
    for command in commands:
        reader.read(command)
    m = measure(t, reader.take()[0], LIMITS.velocity, LIMITS.acceleration)
    assert m.deviation_mm <= 0.010
    assert m.miss_mm <= 0.010
    assert m.velocity.max() <= 1.0001
    assert m.acceleration.max() <= 1.0001
    assert (m.jerk <= 2 * LIMITS.acceleration / tau * 1.001).all()
    end = np.array([t.duration_s])
    assert t.q(end)[0] == pytest.approx([0, 0, 0], abs=1e-8)
    assert np.abs(t.v(end)).max() < 1e-9


def test_position_velocity_and_acceleration_are_continuous_and_each_others_derivatives():
    t = plan(program(), LIMITS, start=ORIGIN, solver="kernel", filter_s=0.01).trajectory
    moments = np.concatenate([np.linspace(0.001, t.duration_s - 0.001, 20_000), t.junctions_s()[1:-1]])
    h = 1e-6
    jerk = 2 * LIMITS.acceleration.max() / 0.01
    assert np.abs(t.a(moments + h) - t.a(moments - h)).max() <= jerk * 2 * h * 1.01
    assert np.abs(t.v(moments + h) - t.v(moments - h) - 2 * h * t.a(moments)).max() <= jerk * h * h * 1.1 + 1e-9
    assert np.abs(t.q(moments + h) - t.q(moments - h) - 2 * h * t.v(moments)).max() < 1e-7
    assert np.abs(t.j(moments)).max() <= jerk * 1.0001


def test_the_filter_runs_empty_before_a_dwell_and_costs_its_width_a_stop():
    one = [canon.Feed(1, at(30), 50.0)]
    tau = 0.02
    plain = plan(one, LIMITS, start=ORIGIN).trajectory.duration_s
    assert plan(one, LIMITS, start=ORIGIN, filter_s=tau).trajectory.duration_s == pytest.approx(plain + tau)
    t = plan([*one, canon.Dwell(2, 0.5), canon.Feed(3, at(0), 50.0)], LIMITS, start=ORIGIN, filter_s=tau).trajectory
    assert t.events[0].time_s == pytest.approx(plain + tau)
    during = t.events[0].time_s + np.linspace(0, 0.5, 50)
    assert t.q(during)[:, 0] == pytest.approx(30.0, abs=1e-9)
    assert t.duration_s == pytest.approx(2 * (plain + tau) + 0.5)


def test_the_width_follows_from_the_jerk_limits():
    limits = Limits(LIMITS.axes, LIMITS.velocity, LIMITS.acceleration, 0.010, np.array([1e5, 2e5, 5e4]))
    t = plan([canon.Feed(1, at(30, 0, 3), 50.0)], limits, start=ORIGIN).trajectory
    assert t.tau_s == pytest.approx(0.01)
    moments = np.arange(0, t.duration_s, 1e-5)
    assert (np.abs(t.j(moments)).max(axis=0) <= limits.jerk * 1.0001).all()


@pytest.mark.parametrize("jerk", [np.array([1e4, 1e4, 4e3]), np.array([5e4, 1e5, 3e4])])
def test_jerk_limits_hold_with_the_width_that_suits_the_program(jerk):
    limits = Limits(LIMITS.axes, LIMITS.velocity, LIMITS.acceleration, 0.010, jerk)
    commands = program()
    p = plan(commands, limits, start=ORIGIN, solver="kernel")
    moments = np.union1d(np.arange(0, p.trajectory.duration_s, 2e-4), p.trajectory.junctions_s())
    assert (np.abs(p.trajectory.j(moments)).max(axis=0) <= jerk * 1.0001).all()
    assert (np.abs(p.trajectory.a(moments)).max(axis=0) <= LIMITS.acceleration * 1.0001).all()
    full = float((2 * LIMITS.acceleration / jerk).max())
    at_full = plan(commands, LIMITS, start=ORIGIN, solver="kernel", filter_s=full).trajectory.duration_s
    assert p.trajectory.duration_s <= at_full * 1.000001
    assert p.report.axes["X"].jerk_limit == jerk[0]
    reader = MoveReader(LIMITS.axes, ORIGIN, LIMITS.tolerance_mm)
    for command in commands:
        reader.read(command)
    m = measure(p.trajectory, reader.take()[0], LIMITS.velocity, LIMITS.acceleration, 2e-4)
    assert max(m.deviation_mm, m.miss_mm) <= 0.010
