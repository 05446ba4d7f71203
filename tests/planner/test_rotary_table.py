"""Programs on a turning table: the tool follows the work, at F over the work, within the machine's own limits."""

import numpy as np
import pytest

from gcode import canon
from planner.errors import PlanError
from planner.follow import follow
from planner.live import live
from planner.measure import programmed
from planner.plan import plan
from planner.reader import MoveReader
from planner.rotary_table import RotaryTable
from planner.types import Limits

AXES = ("X", "Y", "Z", "C")
LIMITS = Limits(AXES, np.array([60.0, 60, 20, 90]), np.array([500.0, 500, 200, 900]), 0.010)
TABLE = RotaryTable("C", (50.0, 40.0))


def at(x=0.0, y=0.0, z=0.0, c=0.0):
    return (float(x), float(y), float(z), 0.0, 0.0, float(c), 0.0, 0.0, 0.0)


def planned(commands, **more):
    return plan(commands, LIMITS, start=np.array([60.0, 40, 0, 0]), kinematics=TABLE, solver="kernel", **more)


def off_the_work(commands, trajectory):
    """Largest distance of the tool, seen from the work, from the program; linear axes only."""
    reader = MoveReader(AXES, np.array([60.0, 40, 0, 0]), LIMITS.tolerance_mm)
    for command in commands:
        reader.read(command)
    polyline, _ = programmed(reader.take()[0], AXES)
    q = TABLE.axes_of(trajectory.q(np.arange(0, trajectory.duration_s, 5e-4)), AXES)
    scale = np.array([1, 1, 1, 0.0])
    return follow(q * scale, polyline * scale + np.arange(len(polyline))[:, None] * 1e-13, 0, 0.5, 0.009)[0].max()


def limits_hold(trajectory):
    t = np.union1d(np.arange(0, trajectory.duration_s, 2e-4), trajectory.junctions_s())
    assert (np.abs(trajectory.v(t)).max(axis=0) <= LIMITS.velocity * 1.0001).all()
    assert (np.abs(trajectory.a(t)).max(axis=0) <= LIMITS.acceleration * 1.0001).all()


def test_positions_turn_there_and_back():
    q = np.random.default_rng(1).normal(size=(50, 4)) * 100
    assert TABLE.axes_of(TABLE.joints(q, AXES), AXES) == pytest.approx(q)
    quarter = TABLE.joints(np.array([[60.0, 40, 0, 90]]), AXES)[0]
    assert quarter == pytest.approx([50, 50, 0, 90])


def test_turning_the_table_alone_carries_the_tool_round_its_centre():
    commands = [canon.Feed(1, at(60, 40, 0, 180), 30.0)]
    t = planned(commands).trajectory
    q = t.q(np.linspace(0, t.duration_s, 4001))
    assert np.abs(np.hypot(q[:, 0] - 50, q[:, 1] - 40) - 10).max() < 1e-3
    assert q[-1] == pytest.approx([40, 40, 0, 180], abs=1e-9)
    assert np.abs(t.v(np.linspace(0, t.duration_s, 4001))[:, 3]).max() == pytest.approx(30.0, rel=1e-3)
    limits_hold(t)


def test_a_straight_cut_over_turning_work_keeps_f_over_the_work():
    commands = [canon.Feed(1, at(60, 60, 0, 60), 10.0)]
    t = planned(commands).trajectory
    assert off_the_work(commands, t) < 2e-3
    assert t.duration_s == pytest.approx(20 / 10, rel=0.03)
    limits_hold(t)


def test_corners_arcs_and_lines_on_a_tilted_table_stay_within_tolerance():
    commands = [
        canon.Feed(1, at(60, 40, 0, 30), 40.0),
        canon.Feed(2, at(70, 40, 1, 30), 30.0),
        canon.Arc(3, at(70, 50, 1, 30), (70.0, 45.0), "XY", 1, 30.0),
        canon.Arc(4, at(70, 60, 3, 75), (70.0, 55.0), "XY", -1, 20.0),
        canon.Arc(5, at(60, 60, 3, 75), (3.0, 65.0), "ZX", 1, 20.0),
        canon.Rapid(6, at(60, 40, 0, 0)),
    ]  # fmt: skip
    p = planned(commands)
    assert off_the_work(commands, p.trajectory) < 0.012
    assert p.trajectory.q(np.array([p.trajectory.duration_s]))[0] == pytest.approx([60, 40, 0, 0], abs=1e-9)
    limits_hold(p.trajectory)


def test_events_keep_their_places_and_live_planning_is_the_same():
    commands = [
        canon.Feed(1, at(60, 40, 0, 90), 40.0), canon.Dwell(2, 0.3), canon.Feed(3, at(70, 40, 0, 90), 30.0),
        canon.Spindle(4, 1, 100.0), canon.Feed(5, at(70, 45, 0, 0), 30.0), canon.End(6),
    ]  # fmt: skip
    p = planned(commands).trajectory
    assert [type(e.command).__name__ for e in p.events] == ["Dwell", "Spindle", "End"]
    for event in p.events:
        assert np.abs(p.v(np.array([event.time_s]))).max() < 1e-6
    t = live(commands, LIMITS, start=np.array([60.0, 40, 0, 0]), kinematics=TABLE, moves=2)
    assert t.duration_s == pytest.approx(p.duration_s)


def test_a_machine_without_the_axes_of_the_table_is_refused():
    with pytest.raises(PlanError, match="needs axis A"):
        plan([canon.Feed(1, at(1), 5.0)], LIMITS, start=np.zeros(4), kinematics=RotaryTable("A", (0.0, 0.0)))
