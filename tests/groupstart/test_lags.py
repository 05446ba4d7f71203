"""Lag by axis and by line in the verdict, against what the trace shows to a second pair of eyes."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groupstart import verify
from groupstart.report.limits import broken_limits
from machines.lags import LagUse, MotorLag, by_line
from machines.load import read_machine
from machines.wiring import every_motor, scale_of

Cli = Callable[..., Any]
PROGRAM = "G21 G90 G61\nG0 X5 Y5\nG1 X25 Y5 F1200\nG1 X25 Y9\nG1 X5 Y5\nM2\n"


def test_lag_of_a_shaft_is_what_the_trace_shows_on_a_straight_move() -> None:
    """X goes one way: each of its places has one time in the plan, found by interpolation."""
    result = verify("G21 G90\nG1 X40 Y4 F1800\nM2\n", "mill3-servo")
    verdict, trace, trajectory = result.verdict, result.trace, result.plan.trajectory
    assert verdict is not None
    assert verdict.shaft_lags is not None
    assert trace is not None
    scale = {motor.name: scale_of(motor) for motor in every_motor(read_machine("mill3-servo").config)}
    mine = (trace.servo_axis == trace.axes.index("X")) & (trace.servo_ns >= trace.plan_start_ns)
    time_s = (trace.servo_ns[mine] - trace.plan_start_ns) * 1e-9
    counts = trace.servo_position[mine]
    place = (counts + 0.5 * (np.diff(counts, prepend=counts[0]) != 0)) / scale["X"]
    t_s = np.linspace(0.0, trajectory.duration_s, 20_001)
    q = trajectory.q(t_s)[:, 0]
    moving = np.interp(time_s, t_s, np.gradient(q, t_s)) > 0.5
    moving &= (time_s <= trajectory.duration_s) & (place >= q[0]) & (place <= q[-1])  # beyond it is shape
    lag_ms = 1e3 * (time_s - np.interp(place, q, t_s))[moving]
    found = verdict.shaft_lags.motors["X"]
    assert found.rms_ms == pytest.approx(np.sqrt(np.mean(lag_ms**2)), rel=0.05)
    assert found.max_ms == pytest.approx(np.abs(lag_ms).max(), abs=0.6)  # a tick is half a millisecond
    commanded = verdict.lags
    assert commanded is not None
    assert commanded.motors["X"].rms_ms < 0.2 * found.rms_ms  # the command is on time, its shaft is not


def test_the_axis_that_is_slow_is_named_and_the_lines_in_which_it_moves(tmp_path: Path) -> None:
    """Y with a quarter of the gain lags more than X, and only in the lines that move it."""
    head, x, rest = read_machine("mill3-servo").text.partition("[axis.Y.servo]")
    slow = tmp_path / "slow.toml"
    slow.write_text(head + x + rest.replace("kp = 220", "kp = 60", 1))
    verdict = verify(PROGRAM, str(slow)).verdict
    assert verdict is not None
    use = verdict.shaft_lags
    assert use is not None
    assert use.worst_motor == "Y"
    assert use.motors["Y"].rms_ms > 1.5 * use.motors["X"].rms_ms
    assert use.motors["Y"].worst_line in (2, 4, 5)
    column = 1 + list(use.motors).index("Y")
    assert use.lines[3][column] == 0.0  # line 3 moves X only
    assert max(row[column] for row in use.lines.values()) == pytest.approx(use.motors["Y"].max_ms)
    assert use.lines[use.worst_line][0] == max(row[0] for row in use.lines.values())


def test_json_and_report_tell_axes_and_lines_of_commands_and_of_shafts(tmp_path: Path, cli: Cli) -> None:
    program, report = tmp_path / "p.nc", tmp_path / "report.json"
    program.write_text(PROGRAM)
    answer = cli("verify", str(program), "-m", "mill3-mixed", "--json", "--report", str(report))
    verdict, told = json.loads(answer.out), json.loads(report.read_text())
    for prefix, name in (("", "lag_by_line"), ("shaft_", "shaft_lag_by_line")):
        axes, lines = verdict[f"{prefix}lag_axis_ms"], told[name]
        assert set(axes) == {"X", "Y", "Z"}
        assert list(lines) == ["2", "3", "4", "5"]
        for axis, lag in axes.items():
            assert max(line[axis] for line in lines.values()) == pytest.approx(lag["max"], abs=1e-3)
        assert lines[str(axes["X"]["worst_line"])]["X"] == pytest.approx(axes["X"]["max"], abs=1e-3)
        worst = verdict[f"{prefix}lag_worst_line"]
        assert lines[str(worst["line"])]["path"] == pytest.approx(worst["ms"], abs=1e-3)
        assert verdict[f"{prefix}lag_ms"]["max"] == pytest.approx(worst["ms"])
    assert verdict["shaft_lag_axis_ms"]["X"]["rms"] > 5 * verdict["lag_axis_ms"]["X"]["rms"]
    assert verdict["shaft_program_um"]["max"] > verdict["program_um"]["max"]


def test_a_limit_for_scripts_may_be_put_on_them() -> None:
    verdict = verify(PROGRAM, "mill3-servo").verdict
    assert verdict is not None
    names = ("lag_axis_ms", "shaft_um", "shaft_program_um", "shaft_lag_ms")
    assert broken_limits(verdict, dict.fromkeys(names, 1e6)) == ()
    assert len(broken_limits(verdict, dict.fromkeys(names, 0.0))) == len(names)


def test_by_line_names_path_and_motors() -> None:
    use = LagUse(2.0, 1.0, {"X": MotorLag(3.0, 1.0, 7)}, {7: (2.0, 3.0), 9: (1.0, 0.0)})
    assert by_line(use) == {7: {"path": 2.0, "X": 3.0}, 9: {"path": 1.0, "X": 0.0}}
    assert (use.worst_line, use.worst_motor) == (7, "X")
    assert LagUse(0.0, 0.0, {"X": MotorLag(0.0, 0.0, 0)}, {}).worst_line == 0
