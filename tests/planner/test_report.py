"""The plan report against hand arithmetic, and the plan file against finite differences."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcode import canon
from planner.plan import plan
from planner.types import Limits

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
ORIGIN = np.zeros(3)


def at(x=0.0, y=0.0, z=0.0):
    return (float(x), float(y), float(z), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def report(commands, **more):
    return plan(commands, LIMITS, start=ORIGIN, **more).report


def test_time_is_told_by_kind():
    r = report([
        canon.Rapid(1, at(60)), canon.Dwell(2, 1.5), canon.Feed(3, at(60, 50), 25.0), canon.ToolChange(4, 2),
        canon.Stop(5, optional=False), canon.Feed(6, at(60, 0), 25.0),
    ])  # fmt: skip
    assert r.rapid_s == pytest.approx(60 / 60 + 60 / 500)
    assert r.cutting_s == pytest.approx(2 * (50 / 25 + 25 / 500))
    assert (r.dwell_s, r.tool_changes, r.waits, r.filter_s) == (1.5, 1, 1, 0.0)
    assert r.duration_s == pytest.approx(r.cutting_s + r.rapid_s + r.dwell_s)


def test_reach_is_told_in_machine_and_work_coordinates():
    r = report([canon.Feed(1, at(30, -5), 25.0)], work_offset=np.array([10.0, 0, 1]))
    x, y, z = r.axes["X"], r.axes["Y"], r.axes["Z"]
    assert (x.least, x.greatest, x.work_least, x.work_greatest) == pytest.approx((0, 30, -10, 20))
    assert (y.least, y.greatest) == pytest.approx((-5, 0))
    assert (z.work_least, z.work_greatest) == pytest.approx((-1, -1))


def test_every_line_that_leaves_the_travel_is_named_with_its_farthest_place():
    commands = [
        canon.Feed(1, at(50), 40.0), canon.Feed(2, at(120), 40.0), canon.Feed(3, at(50, -3), 40.0),
        canon.Arc(4, at(50, 7), (50.0, 2.0), "XY", -1, 40.0),
    ]  # fmt: skip
    found = report(commands, travel={"X": (0.0, 110.0), "Y": (-1.0, 50.0)}).soft_limits
    assert [(v.line, v.axis, v.limit) for v in found] == [
        (2, "X", 110.0), (3, "X", 110.0), (3, "Y", -1.0), (4, "Y", -1.0),
    ]  # fmt: skip
    assert found[0].position == pytest.approx(120.0, abs=0.02)


def test_an_arc_beyond_the_travel_is_seen_though_its_ends_are_inside():
    commands = [canon.Feed(1, at(10, 10), 40.0), canon.Arc(2, at(20, 10), (15.0, 10.0), "XY", -1, 40.0)]
    found = report(commands, travel={"Y": (0.0, 12.0)}).soft_limits
    assert [(v.line, v.axis) for v in found] == [(2, "Y")]
    assert found[0].position == pytest.approx(15.0, abs=0.01)


def test_the_limiting_cause_is_named():
    assert report([canon.Feed(1, at(300), 30.0)]).limited_by["feed"] > 0.98
    assert report([canon.Rapid(1, at(0, 300))]).limited_by["velocity Y"] > 0.9
    by = report([canon.Feed(1, at(0, 0, 0.5), 20.0)]).limited_by
    assert by["acceleration Z"] == pytest.approx(1.0)
    assert sum(
        report([canon.Feed(1, at(5), 40.0), canon.Feed(2, at(5, 5), 40.0)]).limited_by.values()
    ) == pytest.approx(1)


def test_slow_corners_are_listed_slowest_first():
    commands = [canon.Feed(1, at(20), 40.0), canon.Feed(2, at(20, 20), 40.0), canon.Feed(3, at(40, 24), 40.0)]
    slow = report(commands).slow_corners
    assert [c.line for c in slow][:2] in ([1, 2], [2, 1])
    assert slow[0].speed_mm_s <= slow[-1].speed_mm_s < 0.9 * 40
    assert slow[0].feed_mm_s == 40.0


def test_deviation_is_told_by_cause_and_measured():
    commands = [
        canon.Feed(1, at(20), 40.0),
        canon.Feed(2, at(20, 20), 40.0),
        canon.Arc(3, at(20, 30), (20.0, 25.0), "XY", 1, 30),
    ]
    d = report(commands, measured=True, filter_s=0.01).deviation
    assert 0.004 < d.blend_mm < 0.0095
    assert 0 < d.chord_mm < 1e-4
    assert 0.0005 < d.filter_mm < 0.004
    assert max(d.blend_mm, d.filter_mm) <= d.measured_mm <= 0.010
    assert d.measured_mm == pytest.approx(d.sum_mm, rel=0.05)


def test_the_report_is_text_and_json():
    r = report([canon.Feed(1, at(20), 40.0), canon.Rapid(2, at(20, 20)), canon.Feed(3, at(0, 20, 5), 40.0)])
    told = json.loads(r.as_json())
    assert told["axes"]["X"]["velocity"] == pytest.approx(40.0)
    assert told["duration_s"] == r.duration_s
    assert "acceleration 500.0 of 500" in r.text()
    assert "limited by" in r.text()


@settings(max_examples=settings.default.max_examples // 4)
@given(st.integers(0, 2**32 - 1), st.booleans())
def test_finite_differences_of_the_plan_file_keep_uneven_limits(tmp_path_factory, seed, filtered):
    rng = np.random.default_rng(seed)
    limits = Limits(("X", "Y", "Z"), 10.0 ** rng.uniform(0.5, 2.5, 3), 10.0 ** rng.uniform(1.5, 3.5, 3), 0.01)
    points = np.cumsum(rng.normal(size=(30, 3)) * rng.choice([0.1, 5.0], size=(30, 1)), axis=0)
    commands = [canon.Feed(k, at(*p), float(rng.uniform(2, 80))) for k, p in enumerate(points)]
    path = tmp_path_factory.mktemp("plan") / "plan.npz"
    plan(commands, limits, start=ORIGIN, filter_s=0.01 if filtered else 0.0).save(path)
    with np.load(path) as f:
        t, q, v = f["t_s"], f["q"], f["v"]
    dt = np.diff(t)[:, None]
    assert dt.max() <= 1e-3
    slope = np.diff(q, axis=0) / dt
    noise = 1e-9 / dt
    assert (np.abs(slope) <= limits.velocity * 1.0001 + noise).all()
    assert (np.abs(v) <= limits.velocity * 1.0001).all()
    assert (np.abs(np.diff(v, axis=0) / dt) <= limits.acceleration * 1.0001 + noise).all()
    assert np.abs(slope - (v[:-1] + v[1:]) / 2).max() <= (limits.acceleration * dt.max()).max() + noise.max()
