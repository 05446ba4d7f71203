"""Splines and arcs of turned planes: the path that the verdict measures from, and the travel that they need."""

import numpy as np
import pytest

from gcode.canon import Nurbs, TiltedArc
from gcode.interp import interpret
from gcode.setup import Setup
from machines.job import read_job
from machines.load import read_machine
from machines.programmed import programmed_path, tilted_points
from machines.travel import bounds, check_travel

SPLINE = "G21 G17 F600\nG0 X10 Y10\nG5.2 X10 Y20 P1 L3\nX30 Y30 P1\nX40 Y10 P1\nG5.3\nG1 X50\nM2\n"
TILTED = "G21 G90 F600\nG10 L2 P1 X20 Y20 R30\nG18\nG0 X5 Y5 Z10\nG3 X25 Z10 I10 K0\nM2\n"


def test_the_programmed_path_follows_a_spline() -> None:
    commands = interpret(SPLINE).commands
    path = programmed_path(commands, ("X", "Y"))
    assert any(isinstance(command, Nurbs) for command in commands)
    assert len(path) > 100
    assert np.hypot(*np.diff(path[2:], axis=0).T)[:-1].max() < 0.1
    assert path[-1].tolist() == [50, 10]


def test_points_of_an_arc_of_a_turned_plane_lie_on_it() -> None:
    commands = interpret(TILTED).commands
    arc = next(command for command in commands if isinstance(command, TiltedArc))
    start = commands[commands.index(arc) - 1].end  # type: ignore[attr-defined]
    points = tilted_points(start, arc)
    turn = np.radians(arc.rotation_deg)
    away = points[:, :3] - np.array(arc.center[:3])
    across = away @ np.array([-np.sin(turn), np.cos(turn), 0.0])
    assert np.abs(across).max() < 1e-9
    assert np.hypot(away @ np.array([np.cos(turn), np.sin(turn), 0.0]), away[:, 2]) == pytest.approx(10.0)
    assert points[-1].tolist() == list(arc.end)
    assert points[:, 2].max() == pytest.approx(20.0, abs=1e-3)


def test_an_arc_of_a_turned_plane_that_leaves_the_travel_is_refused() -> None:
    commands = interpret(TILTED).commands
    assert bounds(commands).greatest[2] == pytest.approx(20.0, abs=1e-3)
    [excess] = check_travel(commands, {"X": (0, 100), "Y": (0, 100), "Z": (0, 15)})
    assert (excess.axis, excess.line) == ("Z", 5)
    far = TILTED.replace("G3 X25 Z10 I10", "G3 X225 Z10 I110")
    job = read_job(far, Setup(file="a.nc"), read_machine("mill3-step").config)
    assert "TR001" in {error.code for error in job.errors}
