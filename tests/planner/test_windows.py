"""Windows, one global solve and toppra agree, and no plan breaks a limit: on random paths of one to six axes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcode import canon
from planner.constraints import constraints_of
from planner.plan import plan, windows
from planner.timing import schedule
from planner.types import Limits

AXES = "XYZABC"


@st.composite
def programs(draw):
    """Commands over 1 to 6 axes: reversals, micro-noise, equal points, tiny and huge segments, with uneven limits."""
    n = draw(st.integers(1, 6))
    count = draw(st.integers(2, 60))
    seed = draw(st.integers(0, 2**32 - 1))
    kind = draw(st.sampled_from(["walk", "noise", "reversals", "scales", "equal"]))
    rng = np.random.default_rng(seed)
    step = rng.normal(size=(count, n))
    if kind == "noise":
        step = np.tile(rng.normal(size=(1, n)), (count, 1)) * 0.05 + rng.normal(size=(count, n)) * 5e-4
    elif kind == "reversals":
        step = np.tile(rng.normal(size=(1, n)), (count, 1)) * rng.choice([-1.0, 1.0], size=(count, 1))
    elif kind == "scales":
        step *= 10.0 ** rng.uniform(-4, 2.5, size=(count, 1))
    elif kind == "equal":
        step *= rng.integers(0, 2, size=(count, 1))
    points = np.round(np.cumsum(step, axis=0), 3 if draw(st.booleans()) else 9)
    limits = Limits(tuple(AXES[:n]), 10.0 ** rng.uniform(0.5, 2, n), 10.0 ** rng.uniform(1.5, 3, n), 0.01)
    commands = [
        canon.Rapid(k + 1, tuple(p) + (0.0,) * (9 - n))
        if rng.random() < 0.1
        else canon.Feed(k + 1, tuple(p) + (0.0,) * (9 - n), float(10.0 ** rng.uniform(0, 2)))
        for k, p in enumerate(points)
    ]
    return commands, limits


def streamed(commands, limits, moves):
    """Total time of the windows, their x and the worst use of a limit."""
    constraints = constraints_of(limits)
    seconds, speeds = 0.0, []
    for window in windows(commands, limits, start=np.zeros(len(limits.axes)), moves=moves):
        pieces, _ = schedule(window, constraints)
        seconds += float(pieces.duration_s.sum())
        speeds.append(window.x[1:])
    return seconds, np.concatenate(speeds)


@settings(max_examples=2 * settings.default.max_examples)
@given(programs())
def test_windows_kernel_and_toppra_agree_and_keep_the_limits(program):
    commands, limits = program
    start = np.zeros(len(limits.axes))
    whole = plan(commands, limits, start=start, solver="kernel")
    for moves in (3, 17, 1000):
        seconds, x = streamed(commands, limits, moves)
        assert seconds == pytest.approx(whole.trajectory.duration_s, rel=1e-9)
        assert x == pytest.approx(whole.timed.x[1:], rel=1e-9, abs=1e-12)
    t = whole.trajectory
    moments = np.union1d(np.linspace(0, t.duration_s, 3000), t.junctions_s())
    for at in (moments, np.nextafter(t.junctions_s(), 0.0)):
        assert (np.abs(t.v(at)).max(axis=0) <= limits.velocity * 1.0001).all()
        assert (np.abs(t.a(at)).max(axis=0) <= limits.acceleration * 1.0001).all()
    reference = plan(commands, limits, start=start, solver="toppra").trajectory.duration_s
    assert reference == pytest.approx(t.duration_s, rel=1e-4)


def test_memory_of_the_stages_does_not_grow_with_the_program():
    from planner.plan import setting_of
    from planner.stages import TimingStage, chunks

    limits = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
    setting = setting_of(limits, np.zeros(3))

    def endless(count):
        for k in range(count):
            angle = k * 0.02
            yield canon.Feed(k + 1, (10 * np.cos(angle), 10 * np.sin(angle), 0.0, 0, 0, 0, 0, 0, 0), 40.0)

    most = []
    for count in (3000, 12_000):
        stage = TimingStage(setting.constraints)
        for chunk, last in chunks(endless(count), setting.start, setting.rules, 500):
            stage.push(chunk, last)
        most.append(stage.most_held)
    assert most[1] < most[0] * 1.05
