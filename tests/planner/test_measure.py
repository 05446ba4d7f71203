"""The measuring tools see deviation where there is some, and none where a path goes over itself."""

import numpy as np
import pytest

from gcode import canon
from planner.measure import measure
from planner.plan import plan
from planner.point import point_to_point
from planner.reader import MoveReader
from planner.types import Limits

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
ORIGIN = np.zeros(3)


def at(x=0.0, y=0.0, z=0.0):
    return (float(x), float(y), float(z), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def moves_of(commands):
    reader = MoveReader(LIMITS.axes, ORIGIN, LIMITS.tolerance_mm)
    for command in commands:
        reader.read(command)
    return reader.take()[0]


def measured(trajectory, commands):
    return measure(trajectory, moves_of(commands), LIMITS.velocity, LIMITS.acceleration)


def test_peck_drilling_over_the_same_line_is_no_deviation():
    deep = [5, -1, 5, -0.8, -2, 5, -1.8, -3, 5]
    commands = [canon.Rapid(1, at(10, 0, 5)), *(canon.Feed(2 + k, at(10, 0, z), 10.0) for k, z in enumerate(deep))]
    m = measured(plan(commands, LIMITS, start=ORIGIN).trajectory, commands)
    assert max(m.deviation_mm, m.miss_mm) <= 0.010


def test_a_straight_line_instead_of_a_corner_is_seen():
    corner = [canon.Feed(1, at(10), 10.0), canon.Feed(2, at(10, 10), 10.0)]
    m = measured(point_to_point(ORIGIN, np.array([10.0, 10, 0]), LIMITS), corner)
    assert m.deviation_mm == pytest.approx(5.0, abs=0.01)
    assert m.miss_mm > 5


def test_a_plan_for_a_wider_tolerance_is_seen():
    corner = [canon.Feed(1, at(10), 10.0), canon.Feed(2, at(10, 10), 10.0)]
    wide = [canon.PathControl(0, "continuous", 0.05), *corner]
    m = measured(plan(wide, LIMITS, start=ORIGIN).trajectory, corner)
    assert m.deviation_mm > 0.03


def test_limits_that_are_broken_are_seen():
    commands = [canon.Rapid(1, at(50))]
    fast = Limits(LIMITS.axes, LIMITS.velocity * 1.1, LIMITS.acceleration * 1.2, 0.01)
    m = measured(plan(commands, fast, start=ORIGIN).trajectory, commands)
    assert m.velocity[0] == pytest.approx(1.1)
    assert m.acceleration[0] == pytest.approx(1.2)


def test_a_program_that_never_moves_deviates_by_nothing():
    commands = [canon.Rapid(1, at()), canon.Dwell(2, 0.0)]
    m = measured(plan(commands, LIMITS, start=ORIGIN).trajectory, commands)
    assert (m.deviation_mm, m.miss_mm) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.0, abs=1e-9))
