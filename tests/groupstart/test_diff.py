"""Programs compared as motion: text that changes nothing is nothing, what moves is named with its line and amount."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]
BASE = "G21 G90 G64 P0.01 F1200\nG0 X5 Y5\nG1 X25\nG1 Y20\nG2 X35 Y30 I10 J0\nG1 X50\nM2\n"


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str], str]:
    def call(name: str, text: str) -> str:
        path = tmp_path / name
        path.write_text(text)
        return str(path)

    return call


Write = Callable[[str, str], str]


def test_the_same_motion_in_another_text_is_the_same(write: Write, cli: Cli) -> None:
    other = (
        "( again )\nG20 G90 G64 P0.0003937008\nF47.2440945\nG0 X0.19685039370 Y0.19685039370\ng21\nf1200\nx25 g1\n\n"
    )
    other += "Y20 (up)\nG2 X35 Y30 R10\nG91\nG1 X15\nG90\nM2\n"
    answer = cli("diff", write("a.nc", BASE), write("b.nc", other))
    assert answer.status == 0, answer.out
    assert "line" not in answer.out


def test_a_moved_end_is_named_with_line_distance_and_time(write: Write, cli: Cli) -> None:
    moved = BASE.replace("G1 X50", "G1 X50 Y30.2")
    answer = cli("diff", write("a.nc", BASE), write("b.nc", moved), "--json")
    assert answer.status == 1
    found = json.loads(answer.out)
    (change,) = found["changes"]
    assert change["lines_a"] == change["lines_b"] == [6, 6]
    assert change["distance_mm"] == pytest.approx(0.2, abs=0.005)
    assert "Y30.2" in change["words"]


def test_lines_that_are_new_or_gone_are_told_as_such(write: Write, cli: Cli) -> None:
    longer = BASE.replace("G1 X25\n", "G1 X25\nG1 Y10\n")
    a, b = write("a.nc", BASE), write("b.nc", longer)
    there, back = cli("diff", a, b).out, cli("diff", b, a).out
    assert "now line 4: only in the second: feed Y10" in there
    assert "line 4: only in the first: feed Y10" in back


def test_another_feed_is_a_change_of_time_and_not_of_place(write: Write, cli: Cli) -> None:
    slower = BASE.replace("G1 X50\n", "G1 X50 F600\n")
    found = json.loads(cli("diff", write("a.nc", BASE), write("b.nc", slower), "--json").out)
    (change,) = found["changes"]
    assert change["distance_mm"] < 1e-3
    assert change["time_s"] == pytest.approx(0.75, abs=0.05)
    assert found["time_b_s"] - found["time_a_s"] == pytest.approx(0.75, abs=0.05)


def test_two_machines_are_compared_by_what_they_do_with_a_program(write: Write, tmp_path: Path, cli: Cli) -> None:
    slow = cli("machines", "show", "mill3-step").out.replace("max_acceleration = 500", "max_acceleration = 100")
    machine = tmp_path / "slow.toml"
    machine.write_text(slow)
    program = write("a.nc", BASE)
    assert cli("diff", program, "--other-machine", "mill3-servo").status == 0
    answer = cli("diff", program, "--other-machine", str(machine), "--json")
    assert answer.status == 1
    found = json.loads(answer.out)
    assert found["changes"] == []
    assert found["time_b_s"] > found["time_a_s"] + 0.3


def test_nothing_to_compare_with_is_a_wrong_call(write: Write, cli: Cli) -> None:
    answer = cli("diff", write("a.nc", BASE))
    assert answer.status == 2
    assert "--other-machine" in answer.err


def test_the_overlay_page_is_written(write: Write, tmp_path: Path, cli: Cli) -> None:
    page = tmp_path / "diff.html"
    moved = BASE.replace("G1 X50", "G1 X50 Y30.2")
    cli("diff", write("a.nc", BASE), write("b.nc", moved), "--report", str(page))
    text = page.read_text(encoding="utf-8")
    assert '"overlay":true' in text
    assert "line 6" in text
