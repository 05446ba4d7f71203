"""The six reference jobs: time against the optimum of the blend family, deviation, limits, agreement, jerk, rate
control."""

import numpy as np
import pytest

from benchmarks.planning_jobs import LIMIT_II_S, text
from gcode.interp import interpret
from gcode.setup import Setup
from planner.constraints import constraints_of
from planner.follow import Follower
from planner.live import live
from planner.measure import measure
from planner.plan import plan, windows
from planner.reader import MoveReader
from planner.timing import Rate, schedule
from planner.types import Limits

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
START = np.zeros(3)
JOBS = "abcdef"


@pytest.fixture(scope="module")
def programs():
    return {job: interpret(text(job), Setup()).commands for job in JOBS}


@pytest.fixture(scope="module")
def plans(programs):
    return {job: plan(c, LIMITS, start=START, solver="kernel") for job, c in programs.items()}


def measured(commands, trajectory, step_s=1e-4):
    reader = MoveReader(LIMITS.axes, START, LIMITS.tolerance_mm)
    for command in commands:
        reader.read(command)
    return measure(trajectory, reader.take()[0], LIMITS.velocity, LIMITS.acceleration, step_s)


@pytest.mark.parametrize("job", JOBS)
def test_job_time_deviation_and_limits(programs, plans, job):
    trajectory = plans[job].trajectory
    assert trajectory.duration_s <= 1.005 * LIMIT_II_S[job]
    m = measured(programs[job], trajectory)
    assert m.deviation_mm <= 0.010
    assert m.miss_mm <= 0.010
    assert m.velocity.max() <= 1.0001
    assert m.acceleration.max() <= 1.0001


@pytest.mark.parametrize("job", JOBS)
def test_windows_and_toppra_agree_with_one_global_solve(programs, plans, job):
    constraints = constraints_of(LIMITS)
    whole = plans[job].trajectory.duration_s
    for moves in (200, 1000, 5000):
        parts = windows(programs[job], LIMITS, start=START, moves=moves)
        assert sum(schedule(w, constraints)[0].duration_s.sum() for w in parts) == pytest.approx(whole, rel=1e-9)
    reference = plan(programs[job], LIMITS, start=START, solver="toppra").trajectory
    assert reference.duration_s == pytest.approx(whole, rel=1e-6)


@pytest.mark.parametrize("job", JOBS)
def test_a_filter_of_ten_milliseconds_costs_little_and_stays_within_tolerance(programs, plans, job):
    t = plan(programs[job], LIMITS, start=START, solver="kernel", filter_s=0.010).trajectory
    assert t.duration_s <= 1.015 * plans[job].trajectory.duration_s
    m = measured(programs[job], t, 2e-4)
    assert max(m.deviation_mm, m.miss_mm) <= 0.010
    assert (m.jerk <= 2 * LIMITS.acceleration / 0.010 * 1.0001).all()


@pytest.mark.parametrize("job", JOBS)
def test_random_holds_resumes_and_overrides(programs, plans, job):
    whole = plans[job].trajectory
    q = whole.q(np.arange(0, whole.duration_s, 5e-4))
    line = q[np.concatenate([[True], np.linalg.norm(np.diff(q, axis=0), axis=1) > 1e-7])]
    rng = np.random.default_rng(11)
    t = live(programs[job], LIMITS, start=START, moves=500)
    now, checked_to, follower = 0.0, 0.0, Follower(line, 0.5, 1e-3)
    for _ in range(25):
        now += rng.uniform(0.01, 0.6)
        moments = np.arange(checked_to, now, 1e-3)
        checked_to = now
        assert follower.take(t.q(moments))[0].max(initial=0.0) < 1e-3
        assert (np.abs(t.v(moments)).max(axis=0) <= LIMITS.velocity * 1.0001).all()
        assert (np.abs(t.a(moments)).max(axis=0) <= LIMITS.acceleration * 1.0001).all()
        if rng.random() < 0.5:
            said = t.rest_if_held(now)
            t.hold(now)
            assert t.q(np.array([said.time_s, said.time_s + 1]))[1] == pytest.approx(said.q, abs=1e-6)
            now = said.time_s + 0.01
            t.resume(now)
        else:
            t.override(now, Rate(float(rng.uniform(0.1, 2)), float(rng.uniform(0.1, 1))))
    t.override(now, Rate())
    end = t.duration_s
    assert t.q(np.array([end]))[0] == pytest.approx(whole.q(np.array([whole.duration_s]))[0], abs=1e-6)
