"""Point-to-point moves: ruckig against the closed form, straightness, limits, and rapids of whole plans."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcode import canon
from planner.plan import plan
from planner.point import closed_form, point_to_point, rest_to_rest
from planner.types import Limits

positive = st.floats(1e-3, 1e3)


@settings(max_examples=2 * settings.default.max_examples)
@given(positive, positive, positive, st.one_of(st.just(np.inf), st.floats(1.0, 1e6)))
def test_ruckig_and_the_closed_form_take_the_same_time(length, speed, acceleration, jerk):
    a, b = rest_to_rest(length, speed, acceleration, jerk), closed_form(length, speed, acceleration, jerk)
    assert a.begin_s[-1] == pytest.approx(b.begin_s[-1], rel=1e-6)
    for p in (a, b):
        assert p.s[-1] == pytest.approx(length, rel=1e-9, abs=1e-8)
        assert abs(p.v[-1]) < 1e-6 * max(speed, 1)
        assert np.abs(p.v).max() <= speed * (1 + 1e-6)
        assert np.abs(p.a).max() <= acceleration * (1 + 1e-6)


def test_the_move_that_ruckig_refuses_is_done_in_closed_form():
    a = 320.156211871645
    p = rest_to_rest(0.06403124237432907, 32.0156211881645, a, 32015.6211871645)
    assert p.s[-1] == pytest.approx(0.06403124237432907)
    assert p.begin_s[-1] == pytest.approx(4 * a / 32015.6211871645, rel=1e-6)


def test_moves_are_straight_and_within_the_limits_of_uneven_axes():
    rng = np.random.default_rng(4)
    for jerk in (None, np.array([8000.0, 300, 40_000])):
        limits = Limits(("X", "Y", "Z"), np.array([80.0, 7, 20]), np.array([900.0, 50, 4000]), 0.01, jerk)
        for _ in range(100):
            start, end = rng.normal(size=3) * 20, rng.normal(size=3) * 20
            t = point_to_point(start, end, limits)
            moments = np.linspace(0, t.duration_s, 500)
            q = t.q(moments)
            along = (end - start) / np.linalg.norm(end - start)
            assert np.abs((q - start) - ((q - start) @ along)[:, None] * along).max() < 1e-9
            assert (np.abs(t.v(moments)).max(axis=0) <= limits.velocity * 1.000001).all()
            assert (np.abs(t.a(moments)).max(axis=0) <= limits.acceleration * 1.000001).all()
            assert q[-1] == pytest.approx(end, abs=1e-7)
            slope = np.gradient(q, moments, axis=0)
            assert (np.abs(slope - t.v(moments))[1:-1].max(axis=0) <= limits.acceleration * moments[1] * 1.01).all()


def test_a_speed_below_the_axes_limits_is_kept():
    limits = Limits(("X",), np.array([60.0]), np.array([500.0]), 0.01)
    t = point_to_point(np.zeros(1), np.array([10.0]), limits, speed_mm_s=2.0)
    assert t.duration_s == pytest.approx(10 / 2 + 2 / 500)


def test_no_move_takes_no_time():
    limits = Limits(("X",), np.array([60.0]), np.array([500.0]), 0.01)
    t = point_to_point(np.ones(1), np.ones(1), limits)
    assert t.duration_s == 0
    assert t.q(np.array([0.0, 1.0])).tolist() == [[1.0], [1.0]]


@settings(max_examples=settings.default.max_examples // 3)
@given(st.integers(0, 2**32 - 1))
def test_a_rapid_of_a_plan_is_ruckigs(seed):
    rng = np.random.default_rng(seed)
    limits = Limits(("X", "Y", "Z"), 10 ** rng.uniform(0, 2, 3), 10 ** rng.uniform(1, 3, 3), 0.01)
    end = rng.normal(size=3) * 10 ** rng.uniform(-2, 2)
    t = plan([canon.Rapid(1, (*end, 0, 0, 0, 0, 0, 0))], limits, start=np.zeros(3), solver="kernel").trajectory
    reference = point_to_point(np.zeros(3), end, limits)
    assert t.duration_s == pytest.approx(reference.duration_s, rel=1e-7)
    moments = np.linspace(0, t.duration_s, 200)
    assert np.abs(t.q(moments) - reference.q(moments)).max() < 1e-5 * np.abs(end).max()
