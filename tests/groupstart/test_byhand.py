"""The machine by hand: home, jog, mdi, scan, reset, on the twin."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]


def test_scan_names_every_module(cli: Cli) -> None:
    answer = cli("scan", "-m", "mill3-mixed", "--json")
    assert answer.status == 0
    found = json.loads(answer.out)
    assert [(module["address"], module["chip"]) for module in found["modules"]] == [
        (1, "pic-servo"),
        (2, "pic-servo"),
        (3, "pic-step"),
    ]
    assert "bus main: 3 modules at 19200 baud" in cli("scan", "-m", "mill3-step").out


def test_home_sends_every_axis_that_can_to_its_zero(cli: Cli) -> None:
    answer = cli("home", "--json")
    assert answer.status == 0
    assert json.loads(answer.out)["axis"] == "X"
    assert cli("home", "X").out.startswith("X: at machine zero")


def test_home_of_an_axis_that_has_no_switch(cli: Cli) -> None:
    answer = cli("home", "Y")
    assert answer.status == 1
    assert "[axis.Y.home]" in answer.err


@pytest.mark.parametrize("machine", ["mill3-step", "mill3-servo"])
def test_jog_and_mdi_end_where_they_say(machine: str, cli: Cli) -> None:
    jogged = cli("jog", "X+5", "Y-2.5", "-m", machine)
    assert (jogged.status, jogged.out) == (0, "X5.0000 Y-2.5000 Z0.0000\n")
    slow = cli("jog", "z+.5", "--velocity", "2", "-m", machine)
    assert (slow.status, slow.out) == (0, "X0.0000 Y0.0000 Z0.5000\n")
    moved = cli("mdi", "G1", "X1", "Y2", "F600", "-m", machine)
    assert (moved.status, moved.out) == (0, "X1.0000 Y2.0000 Z0.0000\n")


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("jog", "5"), 2, "is no jog"),
        (("jog", "X5mm"), 2, "is no jog"),
        (("jog", "X1", "x2"), 2, "given twice"),
        (("jog", "A1"), 1, "A"),
        (("jog", "X500"), 1, "leaves its travel"),
        (("mdi", "G1", "X1"), 1, "no feed rate"),
        (("mdi", "hello"), 1, "error"),
        (("scan", "--port", "/dev/null/none"), 2, "cannot open"),
        (("reset", "--port", "/dev/null/none"), 2, "cannot open"),
        (("home", "--port", "/dev/null/none"), 2, "cannot open"),
        (("jog", "X1", "--port", "/dev/null/none"), 2, "cannot open"),
    ],
)
def test_what_the_hand_is_refused(arguments: tuple[str, ...], status: int, words: str, cli: Cli) -> None:
    answer = cli(*arguments)
    assert answer.status == status
    assert words in answer.err
    assert "Traceback" not in answer.err


def test_reset_says_what_it_did(cli: Cli) -> None:
    answer = cli("reset")
    assert (answer.status, answer.out) == (0, "")
    assert "bus main: reset" in answer.err


def test_a_run_may_home_first(tmp_path: Path, root: Path, cli: Cli) -> None:
    text = (root / "machines" / "data" / "mill3-step.toml").read_text()
    machine = tmp_path / "off.toml"
    machine.write_text(text.replace("[sim.axis.X]\n", "[sim.axis.X]\nstart_at = 12\n", 1))
    program = tmp_path / "short.nc"
    program.write_text("G21 G90\nG1 X10 Y3 F1200\nG0 X0 Y0\nM2\n")
    answer = cli("run", str(program), "-m", str(machine), "--home", "X", "--runs", str(tmp_path / "runs"), "--json")
    assert answer.status == 0, answer.err
    verdict = json.loads(answer.out)
    assert verdict["contour_steps"]["max"] < 6
    assert verdict["end_error_steps"] == {"X": 0, "Y": 0, "Z": 0}
    [folder] = (tmp_path / "runs").iterdir()
    events = [json.loads(line)["event"] for line in (folder / "journal.jsonl").read_text().splitlines()]
    assert events.index("homed") < events.index("run_begins")
