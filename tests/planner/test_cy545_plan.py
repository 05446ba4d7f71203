"""Programs with a CY545 axis: cut at its moves, planned as one trajectory, refused where it would be interpolated."""

from typing import Any

import numpy as np
import pytest

from gcode.canon import ORIGIN, Dwell, Feed, Message, MoveBlock, PathControl, Position, Rapid
from machines.cy545rates import read_rates
from planner.cy545 import Indexer, choose, profile
from planner.cy545_plan import index_moves, plan_indexed
from planner.cy545_sequence import IndexedTrajectory
from planner.cy545_split import Index, Together, refusals, split
from planner.errors import PlanError
from planner.jerk import FilteredTrajectory
from planner.plan import plan
from planner.types import Limits

AXES = ("X", "Y", "Z", "A")
A = Indexer("A", 1, 40.0, read_rates("stand-in"), velocity=90.0, acceleration=400.0, pull_in_velocity=8.0)


def at(x: float = 0, y: float = 0, z: float = 0, a: float = 0) -> Position:
    return (x, y, z, a, 0.0, 0.0, 0.0, 0.0, 0.0)


def limits(jerk: float | None = None) -> Limits:
    return Limits(
        AXES,
        np.array([60.0, 60, 20, 90]),
        np.array([500.0, 500, 200, 400]),
        0.01,
        None if jerk is None else np.full(4, jerk),
    )


PROGRAM = [
    PathControl(1, "continuous", 0.02),
    Rapid(2, at(10, 0, 0)),
    Feed(3, at(10, 10, -1), 10.0),
    Rapid(4, at(10, 10, 5)),
    Rapid(5, at(10, 10, 5, 90)),
    Dwell(6, 0.5),
    Feed(7, at(10, 10, 5, 75), 20.0),
    Feed(8, at(0, 10, 5, 75), 10.0),
    Rapid(9, at(0, 0, 5, 75)),
]


def planned(commands: Any = PROGRAM, **other: Any) -> Any:
    return plan_indexed(commands, limits(**other), [A], start=np.zeros(4))


def test_a_program_is_cut_at_the_index_moves_and_keeps_its_path_mode() -> None:
    stages = split(PROGRAM, AXES, ("A",), np.zeros(4))
    kinds = [type(stage) for stage in stages]
    assert kinds == [Together, Index, Together, Index, Together]
    assert [(s.line, s.start, s.end, s.feed) for s in stages if isinstance(s, Index)] == [
        (5, 0.0, 90.0, None),
        (7, 90.0, 75.0, 20.0),
    ]
    last = stages[-1]
    assert isinstance(last, Together)
    assert last.commands[0] == PROGRAM[0]
    assert last.start.tolist() == [10, 10, 5, 75]


def test_the_trajectory_is_the_stretches_with_the_chips_ramp_between_them() -> None:
    result = planned()
    t = result.trajectory
    assert isinstance(t, IndexedTrajectory)
    assert [stage.index is not None for stage in t.stages] == [False, True, True, False]
    first = plan(PROGRAM[:4], limits_of_xyz(), start=np.zeros(3)).trajectory
    move = t.stages[1].index
    assert move is not None
    assert move.profile.duration_ns == profile(A, choose(A), 3600).duration_ns
    assert t.stages[1].begin_s == pytest.approx(first.duration_s + A.before_s)
    turning = sum(stage.duration_s for stage in t.stages if stage.index is not None)
    rests = 2 * (A.before_s + A.after_s) + turning / 1000  # a crystal may be a thousandth slow
    together = sum(stage.duration_s for stage in t.stages)
    assert t.duration_s == pytest.approx(together + rests + 0.5)
    end = t.q(np.array([t.duration_s]))[0]
    assert end == pytest.approx([0, 0, 5, 75])
    assert result.report.duration_s == t.duration_s


def limits_of_xyz() -> Limits:
    whole = limits()
    return Limits(AXES[:3], whole.velocity[:3], whole.acceleration[:3], 0.01)


def test_while_the_chip_moves_all_others_rest_and_otherwise_it_rests() -> None:
    t = planned().trajectory
    times = np.linspace(0, t.duration_s, 20_001)
    v = t.v(times)
    indexing = np.zeros(len(times), dtype=bool)
    for stage in t.stages:
        if stage.index is not None:
            indexing |= (times >= stage.begin_s) & (times < stage.begin_s + stage.duration_s)
    assert not v[indexing, :3].any()
    assert not v[~indexing, 3].any()
    assert np.abs(v[:, 3]).max() <= 90
    gaps = np.abs(np.diff(t.q(times), axis=0))
    assert gaps.max() < 90 * (times[1] - times[0]) * 1.1
    for stage in t.stages[1:2]:
        inside = stage.begin_s + np.linspace(0, stage.duration_s, 1001)
        wanted = stage.index.profile.steps(inside - stage.begin_s) / 40
        assert t.q(inside)[:, 3] == pytest.approx(wanted, abs=1e-6)


def test_a_feed_of_the_indexer_alone_is_a_cap_on_its_rate() -> None:
    t = planned().trajectory
    slow = t.stages[2]
    middle = np.array([slow.begin_s + slow.duration_s / 2])
    assert 18 < abs(t.v(middle)[0, 3]) <= 20
    assert t.line(middle).tolist() == [7]


def test_events_keep_their_place_between_the_moves() -> None:
    t = planned(
        [Rapid(1, at(5)), Message(2, "turn"), Rapid(3, at(5, a=10)), Dwell(4, 1.0), Rapid(5, at(0, a=10))]
    ).trajectory
    dwell = next(e for e in t.events if isinstance(e.command, Dwell))
    index = next(stage for stage in t.stages if stage.index is not None)
    assert dwell.time_s == pytest.approx(index.begin_s + index.duration_s * 1.001 + A.after_s)


@pytest.mark.parametrize("jerk", [5_000.0, 20_000.0, 100_000.0])
def test_one_jerk_filter_runs_empty_at_the_end_of_every_stretch(jerk: float) -> None:
    t = planned(jerk=jerk).trajectory
    assert isinstance(t, FilteredTrajectory)
    assert isinstance(t.base, IndexedTrajectory)
    ends = np.array([stage.begin_s + stage.duration_s for stage in t.base.stages if stage.index is None])
    assert t.q(ends) == pytest.approx(np.array([[10, 10, 5, 0], [0, 0, 5, 75]]), abs=1e-9)
    assert np.abs(t.v(ends)).max() < 1e-9
    times = np.linspace(0, t.duration_s, 5001)
    assert np.abs(t.a(times))[:, :3].max() <= 500 * (1 + 1e-6)
    assert np.abs(t.j(times))[:, :3].max() <= jerk * (1 + 1e-6)


@pytest.mark.parametrize(
    ("command", "axes"),
    [
        (Rapid(7, at(x=1, a=5)), "with X"),
        (Feed(7, at(y=1, z=2, a=5), 10.0), "with Y, Z"),
    ],
)
def test_interpolation_is_refused_with_line_axis_and_two_ways_out(command: Any, axes: str) -> None:
    with pytest.raises(PlanError) as refused:
        planned([Rapid(2, at(z=1)), Rapid(3, at()), command])
    error = refused.value
    assert (error.line, error.axis) == (7, "A")
    assert "cannot be interpolated" in error.message
    assert axes in error.message
    assert "split the move" in error.hint
    assert "NMC" in error.hint


def test_all_refusals_of_a_program_can_be_had_at_once() -> None:
    bad = [Rapid(2, at(x=1, a=5)), Feed(3, at(x=2, a=5), 10.0), block([(4, 3, 6), (5, 3, 7), (6, 4, 8)])]
    assert [error.line for error in refusals(bad, AXES, ("A",), np.zeros(4))] == [2, 4, 6]
    assert refusals(PROGRAM, AXES, ("A",), np.zeros(4)) == []


def block(rows: list[tuple[int, float, float]]) -> MoveBlock:
    """Feeds over X and A."""
    n = len(rows)
    zero = np.zeros(n, np.uint8)
    return MoveBlock(
        "XA",
        np.ones(n, np.uint8),
        np.array([row[0] for row in rows], np.int32),
        np.array([row[1:] for row in rows]),
        np.full(n, 10.0),
        zero,
        np.zeros((n, 2)),
        np.zeros(n, np.int32),
    )


def test_columns_are_cut_like_commands() -> None:
    rows = [(1, 5, 0), (2, 6, 0), (3, 6, 30), (4, 7, 30), (5, 7, 31), (6, 7, 32)]
    stages = split([block(rows)], AXES, ("A",), np.zeros(4))
    lengths = [len(s.commands[0]) if isinstance(s, Together) else s.line for s in stages]  # type: ignore[arg-type]
    assert lengths == [2, 3, 1, 5, 6]
    with pytest.raises(PlanError) as refused:
        split([block([(1, 5, 0), (2, 6, 1)])], AXES, ("A",), np.zeros(4))
    assert refused.value.line == 2


def test_a_move_below_half_a_step_is_none_and_a_very_long_one_is_several() -> None:
    assert list(index_moves(A, Index(1, "A", 0.0, 0.01, None))) == []
    moves = list(index_moves(A, Index(1, "A", 0.0, 500_000.0, None)))
    assert [move.steps for move in moves] == [16_777_215, 3_222_785]
    assert moves[-1].end_steps == 20_000_000


def test_a_program_without_any_motion_is_a_plan_too() -> None:
    t = planned([]).trajectory
    assert t.duration_s == 0
    assert t.q(np.zeros(1)).tolist() == [[0, 0, 0, 0]]
    assert at() == ORIGIN


def test_the_report_tells_the_index_moves_and_the_stand_in() -> None:
    report = planned().report
    assert report.axes["A"].greatest == 90
    assert 80 < report.axes["A"].velocity <= 90
    assert report.axes["A"].acceleration <= 400
    notes = "\n".join(report.notes)
    assert "2 index moves" in notes
    assert "stand-in" in notes
    assert "stand-in" in report.text()
