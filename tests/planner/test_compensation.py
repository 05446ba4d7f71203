"""Backlash and screw errors at the joints: the right places, and never more than the limits."""

import numpy as np
import pytest

from gcode import canon
from planner.compensation import Backlash, Compensation, JointTrajectory, planning_limits, screw_table
from planner.errors import PlanError
from planner.kinematics import gantry
from planner.plan import plan
from planner.types import Limits

LIMITS = Limits(("X", "Y"), np.array([60.0, 60]), np.array([500.0, 500]), 0.010)
PLAIN = gantry(("X", "Y"), {"X": "X", "Y": "Y"}, np.full(2, 60.0), np.full(2, 500.0))


def at(x=0.0, y=0.0):
    return (float(x), float(y), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def joints(commands, compensation):
    limits = planning_limits(LIMITS, compensation)
    return JointTrajectory(plan(commands, limits, start=np.zeros(2)).trajectory, PLAIN, compensation)


def limits_hold(t):
    moments = np.union1d(np.arange(0, t.duration_s, 1e-4), t.junctions_s())
    h = 1e-7
    assert (np.abs(t.v(moments)).max(axis=0) <= LIMITS.velocity * 1.0001).all()
    assert (np.abs(t.a(moments)).max(axis=0) <= LIMITS.acceleration * 1.0001).all()
    inside = moments[(moments > h) & (moments < t.duration_s - h)]
    assert np.abs((t.q(inside + h) - t.q(inside - h)) / (2 * h) - t.v(inside)).max() < 1e-3


GAP = Backlash(0.08, 6.0, 120.0)


def test_the_gap_is_taken_up_after_each_reversal_and_never_on_the_way():
    back_and_forth = [canon.Feed(k, at(x), 40.0) for k, x in enumerate([20, 5, 30, 30, 10])]
    t = joints(back_and_forth, {"X": Compensation(GAP)})
    offset = t.q(t.junctions_s())[:, 0] - t.trajectory.q(t.junctions_s())[:, 0]
    assert set(np.round(offset[np.abs(t.v(t.junctions_s())[:, 0]) > 30], 9)) == {0.0, -0.08}
    end = np.array([t.duration_s])
    assert t.q(end)[0] == pytest.approx([10 - 0.08, 0])
    assert np.abs(t.v(end)).max() < 1e-9
    limits_hold(t)


def test_reversals_quicker_than_the_take_up_keep_the_limits():
    rng = np.random.default_rng(1)
    jitter = [canon.Feed(k, at(*(rng.normal(size=2) * 0.05)), 40.0) for k in range(200)]
    t = joints(jitter, {"X": Compensation(GAP), "Y": Compensation(Backlash(0.3, 2.0, 200.0, homed=-1))})
    limits_hold(t)
    offset = t.q(np.linspace(0, t.duration_s, 20_000)) - t.trajectory.q(np.linspace(0, t.duration_s, 20_000))
    low, high = offset.min(axis=0), offset.max(axis=0)
    assert (low >= np.array([-0.08, 0.0]) - 1e-9).all()
    assert (high <= np.array([0.0, 0.3]) + 1e-9).all()


def test_a_first_move_against_the_homed_direction_takes_the_gap_up_at_once():
    t = joints([canon.Feed(1, at(-20), 40.0)], {"X": Compensation(GAP)})
    assert t.q(np.array([t.duration_s]))[0, 0] == pytest.approx(-20.08)
    limits_hold(t)


def test_a_screw_table_is_followed_between_its_knots_and_smooth_at_them():
    table = screw_table([0, 20, 50, 80], [0.0, 0.05, 0.02, 0.03], 60.0, 80.0)
    t = joints(
        [canon.Feed(1, at(100), 55.0), canon.Feed(2, at(0), 55.0)],
        {"X": Compensation(screw=table, screw_acceleration_mm_s2=80.0)},
    )
    moments = np.linspace(0, t.duration_s, 5000)
    q = t.trajectory.q(moments)[:, 0]
    exact = np.interp(q, [0, 20, 50, 80], [0.0, 0.05, 0.02, 0.03])
    assert np.abs(t.q(moments)[:, 0] - q - exact).max() < 0.03 * table.half_mm.max()
    far = np.abs(q[:, None] - table.position).min(axis=1) > table.half_mm.max()
    assert t.q(moments)[far, 0] - q[far] == pytest.approx(exact[far], abs=1e-12)
    limits_hold(t)


def test_both_motors_of_a_gantry_have_tables_of_their_own():
    motors = gantry(("X", "Y"), {"X": "X", "Y": "Y", "Y2": "Y"}, np.full(3, 60.0), np.full(3, 500.0))
    table = screw_table([0, 100], [0.0, 0.1], 60.0, 50.0)
    path = plan([canon.Feed(1, at(0, 50), 40.0)], LIMITS, start=np.zeros(2)).trajectory
    t = JointTrajectory(path, motors, {"Y2": Compensation(screw=table)})
    assert t.q(np.array([t.duration_s]))[0] == pytest.approx([0, 50, 50.05])


@pytest.mark.parametrize(("position", "correction"), [([0], [0]), ([0, 0], [0, 1]), ([0, 1], [0])])
def test_tables_that_make_no_sense_are_refused(position, correction):
    with pytest.raises(PlanError, match="screw table"):
        screw_table(position, correction, 60.0, 80.0)


def test_knots_too_close_for_the_speed_are_refused():
    with pytest.raises(PlanError, match="0 and 1 mm are too close"):
        screw_table([0, 1, 2], [0, 0.1, 0], 60.0, 80.0)


def test_compensation_that_leaves_nothing_to_plan_with_is_refused():
    with pytest.raises(PlanError, match="takes all"):
        planning_limits(LIMITS, {"X": Compensation(Backlash(0.1, 60.0, 100.0))})
