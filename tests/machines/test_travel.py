import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcode.canon import Arc, Command, Feed, MoveBlock, Position, Rapid
from machines.programmed import CHORD_MM, arc_points, programmed_path
from machines.travel import bounds, check_travel, offset_that_fits

TRAVEL = {"X": (-5.0, 115.0), "Y": (-5.0, 115.0), "Z": (-20.0, 40.0)}


def at(x: float = 0, y: float = 0, z: float = 0, a: float = 0) -> Position:
    return (x, y, z, a, 0, 0, 0, 0, 0)


def test_a_program_inside_its_travel_passes() -> None:
    assert check_travel([Rapid(1, at(115, -5, 40)), Feed(2, at(-5, 115, -20), 10)], TRAVEL) == []


def test_each_axis_and_side_is_reported_once_with_first_line_count_and_farthest() -> None:
    program = [Rapid(1, at(116)), Feed(2, at(120), 10), Feed(3, at(50), 10), Feed(4, at(50, -6), 10)]
    x, y = check_travel(program, TRAVEL)
    assert (x.axis, x.limit, x.line, x.moves, x.farthest, x.farthest_line) == ("X", 115, 1, 3, 120, 2)
    assert (y.axis, y.limit, y.line, y.moves, y.farthest) == ("Y", -5, 4, 1, -6)


def test_an_axis_that_the_machine_does_not_have() -> None:
    [found] = check_travel([Rapid(3, at(a=90))], TRAVEL)
    assert (found.axis, found.limit, found.line) == ("A", None, 3)


@pytest.mark.parametrize(
    ("turns", "beyond"),
    [(1, []), (-1, ["X"]), (2, ["X"]), (-2, ["X"])],
)
def test_an_arc_is_checked_at_the_extremes_of_its_sweep(turns: int, beyond: list[str]) -> None:
    # from (100, 10) to (100, -10) about (100, 0) is half a circle: bulging to 90 counter-clockwise, to 110 clockwise
    travel = {"X": (80.0, 105.0), "Y": (-20.0, 20.0)}
    arc = Arc(5, at(100, -10), (100.0, 0.0), "XY", turns, 10.0)
    assert [item.axis for item in check_travel([arc], travel, at(100, 10))] == beyond


def test_a_full_circle_reaches_all_four_sides() -> None:
    circle = Arc(1, at(10, 0), (0.0, 0.0), "XY", 1, 10.0)
    extent = bounds([circle], at(10, 0))
    assert (extent.least[:2], extent.greatest[:2]) == (pytest.approx((-10, -10)), pytest.approx((10, 10)))


def test_planes_zx_and_yz_name_their_own_axes() -> None:
    zx = Arc(1, at(0, 0, 10), (0.0, 0.0), "ZX", -1, 10.0)
    yz = Arc(2, at(0, 10, 0), (0.0, 0.0), "YZ", 1, 10.0)
    assert bounds([zx], at(0, 0, 10)).greatest[:3] == pytest.approx((10, 0, 10))
    assert bounds([yz], at(0, 10, 0)).greatest[:3] == pytest.approx((0, 10, 10))


def block(*rows: tuple[int, float, float, float], kind: int = 1) -> MoveBlock:
    count = len(rows)
    return MoveBlock(
        "XYZ",
        np.full(count, kind, "u1"),
        np.array([row[0] for row in rows], "i4"),
        np.array([row[1:] for row in rows]),
        np.full(count, 10.0),
        np.zeros(count, "u1"),
        np.zeros((count, 2)),
        np.ones(count, "i4"),
    )


def test_columns_of_moves_are_checked_like_single_ones() -> None:
    rows = [(1, 116.0, 0.0, 0.0), (2, 120.0, 0.0, 0.0), (3, 50.0, -6.0, 0.0)]
    single: list[Command | MoveBlock] = [Feed(line, at(x, y, z), 10) for line, x, y, z in rows]
    assert check_travel([block(*rows)], TRAVEL) == check_travel(single, TRAVEL)
    assert bounds([block(*rows)]) == bounds(single)


def test_arcs_in_columns_are_swept_too() -> None:
    columns = [block((1, 10.0, 0.0, 0.0)), block((2, 10.0, 0.0, 0.0), kind=2)]
    single: list[Command | MoveBlock] = [Feed(1, at(10), 10), Arc(2, at(10), (0.0, 0.0), "XY", 1, 10)]
    assert bounds(columns) == bounds(single)
    assert np.array_equal(programmed_path(columns, ("X", "Y")), programmed_path(single, ("X", "Y")))


def test_an_offset_is_proposed_in_whole_millimetres_where_that_fits() -> None:
    extent = bounds([Rapid(1, at(0.7, -50.7, 3)), Feed(2, at(57.7, 0.7, -0.1), 10)])
    assert offset_that_fits(extent, TRAVEL) == {"X": 0.0, "Y": 46.0, "Z": 0.0}
    far = bounds([Rapid(1, at(200, 0)), Feed(2, at(319.5, 0), 10)])
    assert offset_that_fits(far, TRAVEL) == {"X": -205.0, "Y": 0.0, "Z": 0.0}
    tight = bounds([Rapid(1, at(200.25, 0)), Feed(2, at(320.25, 0), 10)])
    assert offset_that_fits(tight, TRAVEL) == {"X": pytest.approx(-205.25), "Y": 0.0, "Z": 0.0}
    assert offset_that_fits(bounds([Rapid(1, at(200, 0)), Feed(2, at(330, 0), 10)]), TRAVEL) is None


@given(
    st.floats(0.01, 50), st.floats(-7, 7), st.floats(-7, 7), st.sampled_from([-3, -2, -1, 1, 2, 3]), st.floats(-5, 5)
)
def test_arc_points_lie_on_the_helix_and_its_chords_within_tolerance(
    radius: float, begin: float, end: float, turns: int, rise: float
) -> None:
    start = at(radius * math.cos(begin), radius * math.sin(begin), 0)
    goal = at(radius * math.cos(end), radius * math.sin(end), rise)
    points = np.vstack((start, arc_points(start, Arc(1, goal, (0.0, 0.0), "XY", turns, 10))))
    assert tuple(points[-1]) == goal
    assert np.hypot(points[:, 0], points[:, 1]) == pytest.approx(radius, rel=1e-9)
    middles = 0.5 * (points[1:-1, :2] + points[:-2, :2])
    assert radius - np.hypot(middles[:, 0], middles[:, 1]).min(initial=radius) <= CHORD_MM * 1.001
    turned = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    whole = abs(turned[-1] - turned[0]) / math.tau
    assert np.sign(turned[-1] - turned[0]) == np.sign(turns)
    assert abs(turns) - 1 - 1e-6 <= whole <= abs(turns) + 1e-6
    assert np.allclose(np.diff(points[:, 2]), rise / (len(points) - 1))
