"""Every canonical command is planned, or refused with its line: none is passed over in silence."""

import math

import numpy as np
import pytest

from gcode import canon
from gcode.canon import Command, Position
from planner.errors import PlanError
from planner.plan import plan
from planner.types import Limits

LINE = 7


def at(x: float, y: float, z: float = 0.0) -> Position:
    return (x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


SPLINE = ((10.0, 0.0, 1.0), (10.0, 10.0, 1.0), (20.0, 10.0, 1.0))
PLANNED: dict[type[Command], Command] = {
    canon.Rapid: canon.Rapid(LINE, at(20, 10)),
    canon.Feed: canon.Feed(LINE, at(20, 10), 10.0),
    canon.Arc: canon.Arc(LINE, at(20, 10), (10.0, 10.0), "XY", 1, 10.0),
    canon.TiltedArc: canon.TiltedArc(LINE, at(30, 0), at(20, 0), "ZX", 0.0, 1, 10.0),
    canon.Nurbs: canon.Nurbs(LINE, at(20, 10), SPLINE, 3, 10.0),
    canon.Probe: canon.Probe(LINE, at(20, 10), 10.0, away=False, required=True),
    canon.Dwell: canon.Dwell(LINE, 0.25),
    canon.PathControl: canon.PathControl(LINE, "exact_stop"),
    canon.Spindle: canon.Spindle(LINE, 1, 1000.0),
    canon.Coolant: canon.Coolant(LINE, mist=False, flood=True),
    canon.ToolChange: canon.ToolChange(LINE, 1),
    canon.Stop: canon.Stop(LINE, optional=False),
    canon.End: canon.End(LINE),
    canon.Output: canon.Output(LINE, 0, 1.0, analog=False, synchronised=False),
    canon.InputWait: canon.InputWait(LINE, 0, analog=False, mode=3, timeout_s=1.0),
    canon.UserCommand: canon.UserCommand(LINE, 110, 1.0),
    canon.Message: canon.Message(LINE, "look"),
    canon.Text: canon.Text(LINE, "COMMENT(x)"),
    canon.Printed: canon.Printed(LINE, "x"),
}
REFUSED: dict[type[Command], Command] = {
    canon.RigidTap: canon.RigidTap(LINE, at(10, 0, -5), 1.0),
    canon.SpindleSynch: canon.SpindleSynch(LINE, 1.0),
}
MOVES = (canon.Rapid, canon.Feed, canon.Arc, canon.TiltedArc, canon.Nurbs, canon.Probe)
WITHOUT_REST = (canon.Message, canon.Text, canon.Printed, canon.PathControl)
UNTOLD = (canon.Text, canon.Printed, canon.PathControl)
"""What the axes need not be told: it moves nothing, switches nothing and waits for nothing."""


def limits() -> Limits:
    return Limits(("X", "Y", "Z"), np.full(3, 50.0), np.full(3, 500.0), 0.01)


def planned(*middle: Command):  # type: ignore[no-untyped-def]
    first, last = canon.Feed(1, at(10, 0), 20.0), canon.Feed(9, at(40, 20), 20.0)
    return plan([first, *middle, last], limits(), start=np.zeros(3), solver="kernel").trajectory


def kinds() -> set[type[Command]]:
    """All commands of canon.py."""
    found = {value for value in vars(canon).values() if isinstance(value, type) and issubclass(value, Command)}
    return found - {Command}


def test_every_kind_of_command_is_in_one_of_the_tables() -> None:
    assert set(PLANNED) | set(REFUSED) == kinds()
    assert not set(PLANNED) & set(REFUSED)


@pytest.mark.parametrize("kind", REFUSED, ids=lambda kind: kind.__name__)
def test_is_refused_with_its_line(kind: type[Command]) -> None:
    with pytest.raises(PlanError) as refusal:
        planned(REFUSED[kind])
    assert refusal.value.line == LINE
    assert "spindle encoder" in refusal.value.message
    assert refusal.value.hint


def test_the_end_of_a_synchronised_stretch_is_none_by_itself() -> None:
    assert planned(canon.SpindleSynch(LINE, None)).duration_s == pytest.approx(planned().duration_s)


@pytest.mark.parametrize("kind", MOVES, ids=lambda kind: kind.__name__)
def test_a_move_is_made(kind: type[Command]) -> None:
    trajectory = planned(PLANNED[kind])
    t = np.linspace(0.0, trajectory.duration_s, 4000)
    on_it = trajectory.q(t)[trajectory.line(t) == LINE]
    end = np.array(PLANNED[kind].end[:3])  # type: ignore[attr-defined]
    assert len(on_it) > 10
    assert np.linalg.norm(on_it - end, axis=1).min() < 0.1
    if kind is canon.TiltedArc:
        assert np.abs(np.hypot(on_it[20:-20, 0] - 20, on_it[20:-20, 2]) - 10).max() < 0.02
    if kind is canon.Arc:
        assert np.abs(np.hypot(on_it[20:-20, 0] - 10, on_it[20:-20, 1] - 10) - 10).max() < 0.02


@pytest.mark.parametrize("kind", [kind for kind in PLANNED if kind not in MOVES], ids=lambda kind: kind.__name__)
def test_what_moves_nothing_is_an_event_at_rest_unless_it_need_not(kind: type[Command]) -> None:
    command = PLANNED[kind]
    trajectory = planned(command)
    events = [event for event in trajectory.events if event.command is command]
    assert len(events) == (0 if kind in UNTOLD else 1)
    speed = np.linalg.norm(trajectory.v(np.array([event.time_s for event in events])), axis=1) if events else []
    assert all(value < 1e-9 for value in speed) or kind in WITHOUT_REST


def test_a_dwell_lasts_as_long_as_it_says() -> None:
    rest = planned(canon.Stop(LINE, optional=False)).duration_s
    assert planned(PLANNED[canon.Dwell]).duration_s - rest == pytest.approx(0.25)
    assert math.isfinite(rest)
