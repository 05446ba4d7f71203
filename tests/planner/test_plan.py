"""plan(): lines, arcs, rests and modes against hand arithmetic and common expectations of every plan."""

import numpy as np
import pytest

from gcode import canon
from planner.errors import PlanError
from planner.plan import plan
from planner.types import Limits

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
ORIGIN = np.zeros(3)


def at(x=0.0, y=0.0, z=0.0):
    return (x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def verify_common(trajectory, limits, start):
    """What holds of every plan: starts and ends at rest, joints meet, limits hold at 0.1 ms and at all piece ends."""
    t = np.union1d(np.arange(0, trajectory.duration_s, 1e-4), trajectory.junctions_s())
    assert trajectory.q(np.array([0.0]))[0] == pytest.approx(start, abs=1e-9)
    for moment in (0.0, trajectory.duration_s):
        assert np.abs(trajectory.v(np.array([moment]))).max() < 1e-6
    ends = np.concatenate((trajectory.junctions_s(), [-1.0, trajectory.duration_s + 1.0]))
    assert [int(trajectory.line(ends[i : i + 1])[0]) for i in range(len(ends))] == trajectory.line(ends).tolist()
    eps = 1e-9
    junctions = trajectory.junctions_s()[1:-1]
    assert np.abs(trajectory.q(junctions - eps) - trajectory.q(junctions + eps)).max(initial=0) < 1e-5
    assert np.abs(trajectory.v(junctions - eps) - trajectory.v(junctions + eps)).max(initial=0) < 1e-4
    for moments in (t, np.nextafter(trajectory.junctions_s()[1:], 0.0)):
        assert (np.abs(trajectory.v(moments)).max(axis=0) <= limits.velocity * 1.0001).all()
        assert (np.abs(trajectory.a(moments)).max(axis=0) <= limits.acceleration * 1.0001).all()


@pytest.mark.parametrize("solver", ["kernel", "toppra"])
def test_one_line_is_the_trapezoid_of_the_textbook(solver):
    p = plan([canon.Feed(1, at(x=30), 50.0)], LIMITS, start=ORIGIN, solver=solver)
    assert p.trajectory.duration_s == pytest.approx(30 / 50 + 50 / 500, abs=1e-7)
    assert p.trajectory.q(np.array([p.trajectory.duration_s]))[0] == pytest.approx([30, 0, 0], abs=1e-9)
    verify_common(p.trajectory, LIMITS, ORIGIN)


def test_a_short_line_never_reaches_its_feed():
    p = plan([canon.Feed(1, at(z=0.5), 20.0)], LIMITS, start=ORIGIN)
    assert p.trajectory.duration_s == pytest.approx(2 * np.sqrt(0.5 / 200), abs=1e-7)


def test_rapids_are_bound_by_the_axes_alone():
    p = plan([canon.Rapid(1, at(x=60, z=20))], LIMITS, start=ORIGIN)
    speed = np.abs(p.trajectory.v(np.array([p.trajectory.duration_s / 2])))[0]
    assert speed == pytest.approx([60, 0, 20], rel=1e-9)
    verify_common(p.trajectory, LIMITS, ORIGIN)


def corner(angle_deg, mode="continuous", tolerance=0.01):
    a = np.radians(angle_deg)
    end = at(20 + 20 * np.cos(a), 20 * np.sin(a))
    return [canon.PathControl(1, mode, tolerance), canon.Feed(2, at(20), 50.0), canon.Feed(3, end, 50.0)]


@pytest.mark.parametrize("angle", [1, 30, 90, 149])
def test_a_corner_misses_its_vertex_by_at_most_the_tolerance(angle):
    p = plan(corner(angle), LIMITS, start=ORIGIN)
    q = p.trajectory.q(np.linspace(0, p.trajectory.duration_s, 200_001))
    miss = np.linalg.norm(q - [20, 0, 0], axis=1).min()
    assert 0.009 < miss <= 0.010
    assert p.report.stops == 2
    verify_common(p.trajectory, LIMITS, ORIGIN)


@pytest.mark.parametrize(
    ("angle", "mode"), [(151, "continuous"), (180, "continuous"), (90, "exact_path"), (90, "exact_stop")]
)
def test_corners_that_may_not_be_rounded_are_stops_on_the_vertex(angle, mode):
    p = plan(corner(angle, mode), LIMITS, start=ORIGIN)
    assert p.report.stops == 3
    t = p.trajectory.junctions_s()
    q, v = p.trajectory.q(t), p.trajectory.v(t)
    k = np.linalg.norm(q - [20, 0, 0], axis=1).argmin()
    assert q[k] == pytest.approx([20, 0, 0], abs=1e-9)
    assert np.abs(v[k]).max() < 1e-6


@pytest.mark.parametrize("plane", ["XY", "ZX", "YZ"])
@pytest.mark.parametrize("turns", [1, -1, 3, -2])
def test_helices_stay_on_their_cylinder_and_end_on_their_end(plane, turns):
    i, j = {"XY": (0, 1), "ZX": (2, 0), "YZ": (1, 2)}[plane]
    k = 3 - i - j
    end = np.zeros(3)
    end[i], end[j], end[k] = 5.0, 5.0, 2.0
    command = canon.Arc(4, at(*end), (0.0, 5.0), plane, turns, 10.0)
    p = plan([command], LIMITS, start=ORIGIN)
    q = p.trajectory.q(np.linspace(0, p.trajectory.duration_s, 20_001))
    radius = np.hypot(q[:, i], q[:, j] - 5.0)
    assert np.abs(radius - 5.0).max() <= 1.1e-4
    assert q[-1] == pytest.approx(end, abs=1e-9)
    angle = np.unwrap(np.arctan2(q[:, j] - 5.0, q[:, i]))
    sweep = angle[-1] - angle[0]
    quarter = np.pi / 2 if turns > 0 else -3 * np.pi / 2
    assert sweep == pytest.approx(quarter + 2 * np.pi * (turns - np.sign(turns)), abs=1e-6)
    assert q[:, k] == pytest.approx(2.0 * (angle - angle[0]) / sweep, abs=1e-3)
    verify_common(p.trajectory, LIMITS, ORIGIN)


def test_sharp_corners_between_line_and_arc_are_blended_within_tolerance():
    commands = [
        canon.Feed(1, at(10), 50.0),
        canon.Arc(2, at(20), (15.0, 0.0), "XY", -1, 50.0),
        canon.Arc(3, at(30), (25.0, 0.0), "XY", -1, 50.0),
        canon.Feed(4, at(40), 50.0),
    ]
    p = plan(commands, LIMITS, start=ORIGIN)
    assert p.report.stops == 3  # the cusp of 180 degrees between the two arcs is a stop
    q = p.trajectory.q(np.linspace(0, p.trajectory.duration_s, 400_001))
    for vertex in ([10, 0, 0], [30, 0, 0]):
        assert np.linalg.norm(q - vertex, axis=1).min() <= 0.010
    upper = (q[:, 0] > 10) & (q[:, 0] < 20)
    off = np.minimum(np.abs(np.hypot(q[upper, 0] - 15, q[upper, 1]) - 5), np.abs(q[upper, 1]))
    assert off.max() <= 0.010
    verify_common(p.trajectory, LIMITS, ORIGIN)


def test_events_happen_at_rest_and_dwells_take_their_time():
    commands = [
        canon.Feed(1, at(10), 50.0), canon.Dwell(2, 0.5), canon.Spindle(3, 1, 1000.0),
        canon.Feed(4, at(20), 50.0), canon.End(5),
    ]  # fmt: skip
    t = plan(commands, LIMITS, start=ORIGIN).trajectory
    one = 10 / 50 + 50 / 500
    assert [(type(e.command).__name__, pytest.approx(e.time_s, abs=1e-6)) for e in t.events] == [
        ("Dwell", one), ("Spindle", one + 0.5), ("End", 2 * one + 0.5),
    ]  # fmt: skip
    assert t.duration_s == pytest.approx(2 * one + 0.5, abs=1e-6)
    assert t.q(np.array([one + 0.25]))[0] == pytest.approx([10, 0, 0])
    assert np.abs(t.v(np.array([one + 0.25]))).max() == 0


def test_a_program_without_motion_is_a_plan_of_no_time():
    t = plan(
        [canon.Spindle(1, 1, 100.0), canon.Dwell(2, 0.25), canon.End(3)], LIMITS, start=np.array([1.0, 2, 3])
    ).trajectory
    assert t.duration_s == pytest.approx(0.25)
    assert t.q(np.array([0.1]))[0] == pytest.approx([1, 2, 3])
    assert [e.time_s for e in t.events] == pytest.approx([0, 0, 0.25])


def test_blocks_and_single_commands_plan_alike():
    rng = np.random.default_rng(5)
    end = np.cumsum(rng.normal(size=(200, 2)), axis=0)
    singles = [canon.Feed(k + 1, at(*e), 30.0) for k, e in enumerate(end)]
    n = len(end)
    block = canon.MoveBlock(
        "XY", np.full(n, canon.KIND_FEED, np.uint8), np.arange(1, n + 1, dtype=np.int32), end, np.full(n, 30.0),
        np.zeros(n, np.uint8), np.zeros((n, 2)), np.zeros(n, np.int32),
    )  # fmt: skip
    a = plan(singles, LIMITS, start=ORIGIN, solver="kernel").trajectory
    b = plan([block], LIMITS, start=ORIGIN, solver="kernel").trajectory
    t = np.linspace(0, a.duration_s, 5000)
    assert a.duration_s == b.duration_s
    assert np.array_equal(a.q(t), b.q(t))
    verify_common(a, LIMITS, ORIGIN)


def test_moving_a_missing_axis_is_refused_with_its_line():
    with pytest.raises(PlanError, match="line 7: axis A moves") as caught:
        plan([canon.Feed(6, at(1), 5.0), canon.Feed(7, (1, 0, 0, 9.0, 0, 0, 0, 0, 0), 5.0)], LIMITS, start=ORIGIN)
    assert caught.value.axis == "A"


def test_a_feed_of_zero_is_refused():
    with pytest.raises(PlanError, match="line 3: feed move"):
        plan([canon.Feed(3, at(1), 0.0)], LIMITS, start=ORIGIN)


def test_plan_file_has_the_arrays_of_the_design(tmp_path):
    p = plan(corner(90), LIMITS, start=ORIGIN)
    p.save(tmp_path / "plan.npz")
    with np.load(tmp_path / "plan.npz") as f:
        assert sorted(f.files) == ["axes", "line", "q", "t_s", "v"]
        assert f["axes"].tolist() == ["X", "Y", "Z"]
        t, q, v, line = f["t_s"], f["q"], f["v"], f["line"]
    assert (t[0], t[-1]) == (0, p.trajectory.duration_s)
    assert np.diff(t).min() > 0
    assert np.diff(t).max() <= 1e-3 + 1e-9
    assert np.isin(p.trajectory.junctions_s(), t).all()
    assert q[-1] == pytest.approx([20, 20, 0], abs=1e-9)
    assert v.shape == q.shape == (len(t), 3)
    assert line.dtype == np.int32
    assert set(line) == {2, 3}


def test_walk_and_search_sample_the_same(monkeypatch):
    p = plan(corner(40), LIMITS, start=ORIGIN).trajectory
    t = np.linspace(-0.1, p.duration_s + 0.1, 25_000)
    walked = p.q(t)
    monkeypatch.setattr("planner.trajectory.WALK_FROM", 10**9)
    assert np.abs(walked - p.q(t)).max() < 1e-12
