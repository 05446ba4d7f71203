"""Random programs of lines, arcs, helices, modes and rests: within tolerance and limits, windows and live as one
solve."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gcode import canon
from planner.live import live
from planner.measure import measure
from planner.plan import plan, setting_of, windows
from planner.reader import MoveReader
from planner.timing import schedule
from planner.types import Limits

START = np.zeros(3)
PLANES = {"XY": (0, 1, 2), "ZX": (2, 0, 1), "YZ": (1, 2, 0)}


def program(rng, count):
    """Up to ``count`` commands; arcs of one turn at most and of radius 2 mm at least, so that none lies over itself."""
    out, q = [], np.zeros(3)
    for line in range(count):
        kind, feed = rng.random(), float(10 ** rng.uniform(0.5, 2))
        if kind < 0.12:
            mode = str(rng.choice(["continuous", "exact_path", "exact_stop"]))
            tolerance = None if rng.random() < 0.3 else float(10 ** rng.uniform(-2.5, -1))
            out.append(canon.PathControl(line, mode, tolerance, 0.002 if rng.random() < 0.3 else None))
        elif kind < 0.18:
            out.append(canon.Dwell(line, float(rng.uniform(0, 0.1))))
        elif kind < 0.5:
            plane = str(rng.choice(list(PLANES)))
            i, j, k = PLANES[plane]
            radius, angle, sweep = (
                rng.uniform(2, 10),
                rng.uniform(0, 6.28),
                rng.uniform(0.05, 6.0) * rng.choice([-1, 1]),
            )
            center = np.round([q[i] - radius * np.cos(angle), q[j] - radius * np.sin(angle)], 3)
            radius, angle = np.hypot(q[i] - center[0], q[j] - center[1]), np.arctan2(q[j] - center[1], q[i] - center[0])
            q = q.copy()
            q[i], q[j] = center + radius * np.array([np.cos(angle + sweep), np.sin(angle + sweep)])
            q[k] += rng.choice([0.0, rng.normal()])
            q = np.round(q, 3)
            turns = 1 if sweep > 0 else -1
            end = (*map(float, q), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            out.append(canon.Arc(line, end, (float(center[0]), float(center[1])), plane, turns, feed))
        else:
            q = np.round(q + rng.normal(size=3) * rng.choice([0.2, 8.0]) * rng.integers(0, 2, 3), 3)
            end = (*map(float, q), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            out.append(canon.Feed(line, end, feed) if kind < 0.85 else canon.Rapid(line, end))
    return out


@settings(max_examples=settings.default.max_examples // 2)
@example(21448, 0.0)  # a line of 1e-7 mm at full speed: s'' was the rounding of x
@example(41, 0.015)  # a narrow spike: the measurement went ahead of the samples
@example(13021, 0.004)  # a long line before short chords used up the reach of the measurement
@example(1034, 0.015)  # braking into a bend lets it be taken faster than its own direction allows
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.0, 0.004, 0.015]))
def test_random_programs(seed, tau):
    rng = np.random.default_rng(seed)
    commands = program(rng, int(rng.integers(2, 25)))
    limits = Limits(("X", "Y", "Z"), 10 ** rng.uniform(1, 2.3, 3), 10 ** rng.uniform(2, 3.5, 3), 0.010)
    whole = plan(commands, limits, start=START, solver="kernel", filter_s=tau).trajectory
    reader = MoveReader(limits.axes, START, limits.tolerance_mm)
    for command in commands:
        reader.read(command)
    moves = reader.take()[0]
    constraints = setting_of(limits, START, None, tau).constraints
    parts = windows(commands, limits, start=START, moves=int(rng.integers(1, 9)), filter_s=tau)
    seconds = sum(float(schedule(w, constraints)[0].duration_s.sum()) for w in parts)
    assert seconds == pytest.approx(whole.duration_s, rel=1e-9)
    t = live(commands, limits, start=START, moves=3, filter_s=tau)
    moments = np.linspace(0, whole.duration_s, 300)
    assert np.abs(t.q(moments) - whole.q(moments)).max() < 1e-5
    assert [(e.time_s, e.command) for e in t.events] == [(pytest.approx(e.time_s), e.command) for e in whole.events]
    if not len(moves):
        return
    assert whole.q(moments[-1:])[0] == pytest.approx(moves.end[-1], abs=1e-7)
    m = measure(whole, moves, limits.velocity, limits.acceleration, 2e-3)
    allowed = max(moves.tolerance_mm.max(), limits.tolerance_mm)
    assert m.deviation_mm <= allowed * 1.001 + 1e-4
    assert m.velocity.max() <= 1.0001
    assert m.acceleration.max() <= 1.0001
