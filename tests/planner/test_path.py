"""The path stage: merge, splines, rotary axes and their feed rules, kinematics, exact path, tiny moves."""

import numpy as np
import pytest

from gcode import canon
from planner.errors import PlanError
from planner.follow import follow
from planner.kinematics import corexy, gantry
from planner.measure import measure
from planner.nurbs import evaluate
from planner.plan import plan
from planner.reader import MoveReader
from planner.types import Limits

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
ORIGIN = np.zeros(3)


def at(x=0.0, y=0.0, z=0.0, a=0.0, b=0.0, c=0.0, u=0.0, v=0.0, w=0.0):
    return tuple(float(k) for k in (x, y, z, a, b, c, u, v, w))


def moves_of(commands, limits, start):
    reader = MoveReader(limits.axes, start, limits.tolerance_mm)
    for command in commands:
        reader.read(command)
    return reader.take()[0]


def wavy(n=2000, step=0.05):
    """A smooth curve in short segments with coordinates of three decimals."""
    s = np.arange(1, n + 1) * step
    points = np.round(np.column_stack([s, 3 * np.sin(s / 6), 0.5 * np.cos(s / 2) - 0.5]), 3)
    return [canon.Feed(k + 1, at(*p), 40.0) for k, p in enumerate(points)]


@pytest.mark.parametrize("merge_mm", [0.0005, 0.002, 0.05])
def test_merged_moves_stay_within_q_and_all_within_p(merge_mm):
    commands = [canon.PathControl(0, "continuous", 0.010, merge_mm), *wavy()]
    p = plan(commands, LIMITS, start=ORIGIN, solver="kernel")
    plain = plan(wavy(), LIMITS, start=ORIGIN, solver="kernel")
    assert len(p.timed.intervals) < 0.8 * len(plain.timed.intervals)
    assert 0 < p.report.deviation.merge_mm <= min(merge_mm, 0.003)
    measured = measure(p.trajectory, moves_of(wavy(), LIMITS, ORIGIN), LIMITS.velocity, LIMITS.acceleration)
    assert measured.deviation_mm <= 0.010
    assert measured.miss_mm <= 0.010


def test_merge_never_crosses_a_mark_a_feed_change_or_a_reversal():
    commands = [
        canon.PathControl(0, "continuous", 0.010, 0.003),
        canon.Feed(1, at(1), 20.0), canon.Feed(2, at(2), 20.0), canon.Feed(3, at(3), 30.0), canon.Feed(4, at(4), 30.0),
        canon.Dwell(5, 0.1), canon.Feed(6, at(5), 30.0), canon.Feed(7, at(4.5), 30.0), canon.Feed(8, at(6), 30.0),
    ]  # fmt: skip
    t = plan(commands, LIMITS, start=ORIGIN).trajectory
    q = t.q(np.linspace(0, t.duration_s, 20_001))[:, 0]
    stops = [4.0, 5.0, 4.5]
    for stop in stops:
        assert np.abs(q - stop).min() < 1e-5
    assert t.q(np.array([t.events[0].time_s]))[0, 0] == pytest.approx(4.0)
    assert set(t.line(np.linspace(0, t.duration_s, 20_001))) == {2, 4, 6, 7, 8}


def test_chains_of_tiny_moves_neither_vanish_nor_divide_by_zero():
    tiny = [canon.Feed(k + 1, at(1e-7 * (k + 1), 0), 10.0) for k in range(1000)]
    t = plan([*tiny, canon.Feed(1001, at(1e-4, 1), 10.0), canon.Feed(1002, at(1e-4, 1), 10.0)], LIMITS, start=ORIGIN)
    end = t.trajectory.q(np.array([t.trajectory.duration_s]))[0]
    assert end == pytest.approx([1e-4, 1, 0], abs=1e-9)
    assert np.isfinite(t.trajectory.duration_s)


SPLINE = ((0.0, 0.0, 1.0), (10.0, 20.0, 1.0), (25.0, -10.0, 2.0), (30.0, 15.0, 1.0), (45.0, 5.0, 0.5), (50.0, 0.0, 1.0))


@pytest.mark.parametrize("order", [3, 4])
def test_splines_are_followed_within_a_micron_of_the_curve(order):
    spline = canon.Nurbs(3, at(50, 0), SPLINE, order, 40.0)
    p = plan([spline], LIMITS, start=ORIGIN, solver="kernel")
    assert p.report.stops == 2
    curve = evaluate(np.array(SPLINE), order, np.linspace(0, len(SPLINE) - order + 1, 20_001))
    q = p.trajectory.q(np.linspace(0, p.trajectory.duration_s, 20_001))
    distance, _ = follow(q[:, :2].copy(), curve, 0, 0.2, 1.0)
    assert distance.max() < 1e-3
    assert q[-1] == pytest.approx([50, 0, 0])
    assert set(p.trajectory.line(np.array([0.1, 0.5]))) == {3}


def test_an_order_two_spline_is_its_own_polyline():
    t = plan([canon.Nurbs(3, at(50, 0), SPLINE, 2, 40.0)], LIMITS, start=ORIGIN).trajectory
    q = t.q(np.linspace(0, t.duration_s, 50_001))
    for x, y, _ in SPLINE:
        assert np.linalg.norm(q[:, :2] - [x, y], axis=1).min() < 0.05


ROTARY = Limits(
    ("X", "Y", "Z", "A", "C"), np.array([60.0, 60, 20, 90, 180]), np.array([500.0, 500, 200, 900, 1800]), 0.01
)


def top_speed(commands, limits):
    t = plan(commands, limits, start=np.zeros(len(limits.axes))).trajectory
    return np.abs(t.v(np.linspace(0, t.duration_s, 4001))).max(axis=0)


def test_feed_with_linear_and_rotary_axes_is_that_of_the_linear_axes():
    speed = top_speed([canon.Feed(1, at(30, 40, a=20), 25.0)], ROTARY)
    assert np.hypot(speed[0], speed[1]) == pytest.approx(25.0)
    assert speed[3] == pytest.approx(25.0 * 20 / 50)


def test_feed_of_rotary_axes_alone_is_degrees_per_second():
    assert top_speed([canon.Feed(1, at(a=90), 30.0)], ROTARY)[3] == pytest.approx(30.0)
    speed = top_speed([canon.Feed(1, at(a=30, c=40), 50.0)], ROTARY)
    assert np.hypot(speed[3], speed[4]) == pytest.approx(50.0)


def test_uvw_feed_counts_only_when_xyz_rest():
    limits = Limits(("X", "U", "W"), np.full(3, 60.0), np.full(3, 500.0), 0.01)
    assert np.linalg.norm(top_speed([canon.Feed(1, at(u=30, w=40), 25.0)], limits)) == pytest.approx(25.0)
    assert top_speed([canon.Feed(1, at(x=30, u=60), 20.0)], limits)[0] == pytest.approx(20.0)


def test_a_fast_rotary_axis_slows_the_whole_move():
    speed = top_speed([canon.Feed(1, at(1, a=360), 50.0)], ROTARY)
    assert speed[3] == pytest.approx(90.0, rel=1e-6)


def test_nine_axes_move_together():
    limits = Limits(tuple("XYZABCUVW"), np.linspace(10, 90, 9), np.linspace(100, 900, 9), 0.01)
    rng = np.random.default_rng(2)
    commands = [canon.Feed(k, tuple(p), 20.0) for k, p in enumerate(np.cumsum(rng.normal(size=(50, 9)), axis=0))]
    p = plan(commands, limits, start=np.zeros(9))
    m = measure(p.trajectory, moves_of(commands, limits, np.zeros(9)), limits.velocity, limits.acceleration)
    assert m.deviation_mm <= 0.01
    assert m.velocity.max() <= 1.0001
    assert m.acceleration.max() <= 1.0001


def test_a_helix_with_a_rotary_axis_turns_in_proportion():
    command = canon.Arc(1, at(0, 0, 5, c=180), (10.0, 0.0), "XY", 1, 30.0)
    t = plan([command], ROTARY, start=np.zeros(5)).trajectory
    q = t.q(np.linspace(0, t.duration_s, 2001))
    angle = np.unwrap(np.arctan2(q[:, 1], q[:, 0] - 10))
    assert (q[:, 4] / 180) == pytest.approx((angle - angle[0]) / (2 * np.pi), abs=1e-4)
    assert np.abs(np.hypot(q[:, 0] - 10, q[:, 1]) - 10).max() < 1.1e-4


def test_corexy_belts_keep_their_own_limits():
    belts = corexy(("X", "Y", "Z"), np.array([50.0, 50, 20]), np.array([300.0, 300, 200]))
    square = [canon.Rapid(k, at(*p)) for k, p in enumerate([(40, 0), (40, 40), (0, 40), (0, 0), (30, 30)])]
    t = plan(square, LIMITS, start=ORIGIN, kinematics=belts).trajectory
    moments = np.linspace(0, t.duration_s, 40_001)
    v, a = belts.position(t.v(moments)), belts.position(t.a(moments))
    assert np.abs(v).max(axis=0)[:2] == pytest.approx([50, 50], rel=1e-6)
    assert np.abs(a).max(axis=0)[:2] == pytest.approx([300, 300], rel=1e-4)
    assert np.abs(t.a(moments)).max() <= 300 * 1.0001
    assert belts.axes_of(belts.position(t.q(moments))) == pytest.approx(t.q(moments))


def test_a_gantry_gives_both_motors_the_same_axis_and_the_slower_motor_rules():
    motors = gantry(
        ("X", "Y", "Z"), {"X": "X", "Y": "Y", "Y2": "Y", "Z": "Z"}, np.array([60, 60, 40, 20.0]), np.full(4, 400.0)
    )
    t = plan([canon.Rapid(1, at(0, 50))], LIMITS, start=ORIGIN, kinematics=motors).trajectory
    joints = motors.position(t.q(np.linspace(0, t.duration_s, 100)))
    assert np.array_equal(joints[:, 1], joints[:, 2])
    assert np.abs(t.v(np.linspace(0, t.duration_s, 1000))).max() == pytest.approx(40.0)


def test_exact_path_passes_tangent_arcs_with_rounded_coordinates_without_stopping():
    c = np.round(5 * np.sin(np.radians(37.0)), 3), np.round(5 * np.cos(np.radians(37.0)), 3)
    commands = [
        canon.PathControl(0, "exact_path"),
        canon.Arc(1, at(c[0], 5 - c[1]), (0.0, 5.0), "XY", 1, 20.0),
        canon.Arc(2, at(2 * c[0], 2 * (5 - c[1])), (2 * c[0], 2 * (5 - c[1]) - 5), "XY", -1, 20.0),
    ]  # fmt: skip
    p = plan(commands, LIMITS, start=ORIGIN)
    assert p.report.stops == 2
    m = measure(p.trajectory, moves_of(commands, LIMITS, ORIGIN), LIMITS.velocity, LIMITS.acceleration)
    assert m.deviation_mm < 3e-4
    assert m.acceleration.max() <= 1.0001


@pytest.mark.parametrize("plane", ["ZX", "YZ"])
def test_arcs_in_a_rotated_plane_stay_on_their_circle(plane):
    turn = np.radians(30)
    across = np.array([np.cos(turn), np.sin(turn), 0]) if plane == "ZX" else np.array([-np.sin(turn), np.cos(turn), 0])
    end = tuple(10 * across) + (0.0,) * 6
    center = tuple(5 * across) + (0.0,) * 6
    turns = 1 if plane == "ZX" else -1
    arc = canon.TiltedArc(2, end, center, plane, 30.0, turns, 15.0)
    p = plan([arc], LIMITS, start=ORIGIN, solver="kernel")
    q = p.trajectory.q(np.linspace(0, p.trajectory.duration_s, 5001))
    assert p.report.stops == 2
    assert np.abs(np.linalg.norm(q - 5 * across, axis=1) - 5).max() < 5e-4
    assert q[:, 2].max() == pytest.approx(5.0, abs=1e-3)
    assert q[-1] == pytest.approx(end[:3], abs=1e-9)


def test_what_needs_a_spindle_encoder_is_refused_with_its_line():
    for command in (canon.RigidTap(5, at(0, 0, -5), 1.0), canon.SpindleSynch(5, 1.0)):
        with pytest.raises(PlanError, match="line 5"):
            plan([command], LIMITS, start=ORIGIN)


def test_an_allowed_jump_passes_corners_on_their_vertex_and_is_reported():
    jump = np.array([4.0, 3.0, 0.0])
    limits = Limits(LIMITS.axes, LIMITS.velocity, LIMITS.acceleration, 0.001, velocity_jump=jump)
    commands = [canon.Feed(1, at(20), 40.0), canon.Feed(2, at(20, 20), 40.0), canon.Feed(3, at(20, 20, 2), 15.0)]
    p = plan(commands, limits, start=ORIGIN)
    plain = plan(commands, Limits(LIMITS.axes, LIMITS.velocity, LIMITS.acceleration, 0.001), start=ORIGIN)
    assert p.trajectory.duration_s < plain.trajectory.duration_s
    assert p.report.velocity_jumps == {"X": pytest.approx(3.0), "Y": pytest.approx(3.0)}
    assert plain.report.velocity_jumps == {}
    q = p.trajectory.q(p.trajectory.junctions_s())
    assert np.linalg.norm(q - [20, 0, 0], axis=1).min() < 1e-9
    assert "jumps" in p.report.text()
    t = p.trajectory.junctions_s()
    before, after = p.trajectory.v(np.nextafter(t[1:-1], 0.0)), p.trajectory.v(t[1:-1])
    assert (np.abs(after - before).max(axis=0) <= jump + 1e-6).all()


def test_toppra_and_windows_keep_the_corner_speeds_of_jumps():
    from planner.constraints import constraints_of
    from planner.plan import windows
    from planner.timing import schedule

    limits = Limits(LIMITS.axes, LIMITS.velocity, LIMITS.acceleration, 0.002, velocity_jump=np.full(3, 2.0))
    rng = np.random.default_rng(8)
    commands = [canon.Feed(k, at(*p), 40.0) for k, p in enumerate(np.cumsum(rng.normal(size=(80, 3)), axis=0))]
    whole = plan(commands, limits, start=ORIGIN, solver="kernel").trajectory.duration_s
    assert plan(commands, limits, start=ORIGIN, solver="toppra").trajectory.duration_s == pytest.approx(whole, rel=1e-6)
    parts = windows(commands, limits, start=ORIGIN, moves=7)
    assert sum(schedule(w, constraints_of(limits))[0].duration_s.sum() for w in parts) == pytest.approx(whole)
