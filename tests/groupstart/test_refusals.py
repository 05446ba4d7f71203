"""What the command line refuses: always in words with a place, never with a traceback, with the right exit status."""

import json
import os
import pty
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from nmc.serial_link import SerialLink

ROOT = Path(__file__).resolve().parents[2]
Cli = Callable[..., Any]
SQUARE = "G21 G90\nG0 X0 Y0\nG1 X10 F600\nY10\nX0\nY0\nM2\n"
PROGRAM_VERBS = ("check", "canon", "plan", "preview", "verify", "run")

FIVE_MISTAKES = """G21 G90 F100
G1 X1O
G2 X20 Y20 I3 J0
G1 Z-1 Q2
G0 X
G999
M30
"""


@pytest.fixture
def square(tmp_path: Path) -> str:
    path = tmp_path / "square.nc"
    path.write_text(SQUARE)
    return str(path)


def clean(answer: Any) -> Any:
    assert "Traceback" not in answer.out + answer.err
    return answer


def test_a_program_with_five_mistakes_prints_five_located_errors(tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / "five.nc"
    path.write_text(FIVE_MISTAKES)
    answer = clean(cli("check", str(path)))
    assert answer.status == 1
    places = [line for line in answer.out.splitlines() if line.startswith(f"{path}:")]
    assert [place.split(":")[1] for place in places] == ["2", "3", "4", "5", "6"]
    assert answer.out.count("^") >= 5
    assert "5 errors" in answer.err


def test_check_json_is_one_object_a_line_with_the_agreed_fields(tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / "five.nc"
    path.write_text(FIVE_MISTAKES)
    answer = clean(cli("check", "--json", str(path)))
    records = [json.loads(line) for line in answer.out.splitlines()]
    assert answer.status == 1
    assert len(records) == 5
    for record in records:
        fields = {"file", "line", "column", "end_column", "code", "severity", "message", "hint"}
        assert fields <= set(record)
        assert record["severity"] == "error"
        assert 1 <= record["column"] < record["end_column"]


@pytest.mark.parametrize("verb", PROGRAM_VERBS)
def test_a_missing_file(verb: str, tmp_path: Path, cli: Cli) -> None:
    answer = clean(cli(verb, str(tmp_path / "none.nc")))
    assert answer.status == 2
    assert "none.nc: No such file or directory" in answer.err


@pytest.mark.parametrize("verb", PROGRAM_VERBS)
def test_a_directory_given_as_a_file(verb: str, tmp_path: Path, cli: Cli) -> None:
    answer = clean(cli(verb, str(tmp_path)))
    assert answer.status == 2
    assert "Is a directory" in answer.err


@pytest.mark.parametrize("verb", PROGRAM_VERBS)
def test_bytes_that_are_no_program(verb: str, tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / "noise.nc"
    path.write_bytes(bytes(range(256)) * 4)
    answer = clean(cli(verb, str(path)))
    assert answer.status == 1
    assert "noise.nc:" in answer.out + answer.err


@pytest.mark.parametrize("verb", ["plan", "preview", "verify", "run"])
def test_a_machine_that_is_not_there(verb: str, square: str, cli: Cli) -> None:
    answer = clean(cli(verb, square, "-m", "mill3-stap"))
    assert answer.status == 2
    assert "did you mean mill3-step?" in answer.err


@pytest.mark.parametrize("verb", ["plan", "preview", "verify", "run"])
def test_a_machine_file_with_three_mistakes(verb: str, square: str, tmp_path: Path, cli: Cli) -> None:
    text = (ROOT / "machines" / "data" / "mill3-step.toml").read_text()
    text = text.replace("max_velocity = 60", "max_velocty = 60", 1).replace("address = 3", "address = 2")
    text = text.replace('"200 * 4 / 4"', '"200 * 4 /"', 1)
    path = tmp_path / "bad.toml"
    path.write_text(text)
    answer = clean(cli(verb, square, "-m", str(path)))
    assert answer.status == 1
    errors = [line for line in answer.err.splitlines() if line.startswith(f"{path}:")]
    assert [line.split(": ")[2] for line in errors] == ["axis.X.steps_per_unit", "axis.X.max_velocty", "axis.Z.address"]


@pytest.mark.parametrize("verb", ["check", "plan", "preview", "verify", "run"])
def test_a_program_beyond_the_travel_is_refused_with_line_and_the_offset_that_fits(
    verb: str, tmp_path: Path, cli: Cli
) -> None:
    path = tmp_path / "far.nc"
    path.write_text("G21 G90 F600\nG1 X10\nG1 X120 (still good in Y)\nG1 X130 Y5\nM2\n")
    answer = clean(cli(verb, str(path), "-m", "mill3-step"))
    assert answer.status == 1
    words = answer.out + answer.err
    assert f"{path}:3:4: error TR001: X leaves its travel of -5 to 115 (2 moves; farthest X130.000 in line 4)" in words
    assert "--work-offset -15,0,0 would fit it" in words
    assert cli("check", str(path), "-m", "mill3-step", "--work-offset", "-15,0,0").status == 0


def test_an_axis_that_the_machine_does_not_have(tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / "rotary.nc"
    path.write_text("G21 G90 F600\nG1 X10 A20\nM2\n")
    answer = clean(cli("verify", str(path), "-m", "mill3-step"))
    assert answer.status == 1
    assert f"{path}:2:8" in answer.err


@pytest.mark.parametrize(
    ("machine", "profile", "words"),
    [("mill3-step", "smooth", "this machine has none"), ("mill3-servo", "group", "this machine has none")],
)
def test_a_profile_of_chips_that_the_machine_does_not_have(
    machine: str, profile: str, words: str, square: str, cli: Cli
) -> None:
    answer = clean(cli("verify", square, "-m", machine, "--profile", profile))
    assert answer.status == 1
    assert words in answer.err


def test_cy545s_beside_motors_on_several_buses_are_refused(square: str, tmp_path: Path, cli: Cli) -> None:
    text = (ROOT / "machines" / "data" / "mill3-indexer.toml").read_text()
    text = text.replace("[axis.X]", "[bus.second]\n\n[axis.X]", 1)
    text = text.replace('bus = "main"\naddress = 3', 'bus = "second"\naddress = 1')
    path = tmp_path / "two.toml"
    path.write_text(text)
    answer = clean(cli("verify", square, "-m", str(path)))
    assert answer.status == 1
    assert "several buses" in answer.err


@pytest.mark.parametrize("offset", ["1,2,x", "1,2,3,4,5,6,7,8,9,10", "nan", "1e400"])
def test_a_work_offset_that_is_none(offset: str, square: str, cli: Cli) -> None:
    answer = clean(cli("plan", square, "--work-offset", offset))
    assert answer.status == 2
    assert "--work-offset" in answer.err


@pytest.mark.parametrize(
    ("option", "text", "status", "words"),
    [
        ("--tool-table", "T1 Q\n", 1, "error GC301"),
        ("--tool-table", None, 2, "No such file"),
        ("--parameters", "5221 x\n", 1, "error GC302"),
        ("--parameters", None, 2, "No such file"),
        ("--ini", "no section\n[", 1, "not an ini file"),
        ("--ini", None, 2, "No such file"),
    ],
)
@pytest.mark.parametrize("verb", ["check", "canon", "run"])
def test_a_file_beside_the_program_that_is_none(
    verb: str, option: str, text: str | None, status: int, words: str, square: str, tmp_path: Path, cli: Cli
) -> None:
    path = tmp_path / "beside.txt"
    if text is not None:
        path.write_text(text)
    answer = clean(cli(verb, square, option, str(path)))
    assert answer.status == status
    assert words in answer.err


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_folder_that_cannot_be_written(square: str, tmp_path: Path, cli: Cli) -> None:
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    answer = clean(cli("run", square, "--runs", str(locked / "runs")))
    assert answer.status == 2
    assert "Permission denied" in answer.err


def test_a_runs_folder_that_is_a_file(square: str, tmp_path: Path, cli: Cli) -> None:
    answer = clean(cli("run", square, "--runs", square))
    assert answer.status == 2
    assert "square.nc" in answer.err


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
@pytest.mark.parametrize("verb", ["canon", "plan"])
def test_a_full_disk(verb: str, square: str, cli: Cli) -> None:
    answer = clean(cli(verb, square, "-o", "/dev/full"))
    assert answer.status == 2
    assert answer.err.endswith("/dev/full: No space left on device\n")


def test_a_port_that_is_not_there(square: str, tmp_path: Path, cli: Cli) -> None:
    answer = clean(cli("run", square, "--port", str(tmp_path / "ttyNone"), "--runs", str(tmp_path / "runs")))
    assert answer.status == 2
    assert answer.err.count("No such file or directory") == 1
    assert f"cannot open {tmp_path / 'ttyNone'}: No such file" in answer.err


def test_a_port_that_another_program_has_open(cli: Cli) -> None:
    master, slave = pty.openpty()
    try:
        held = SerialLink(os.ttyname(slave))
        answer = clean(cli("scan", "--port", os.ttyname(slave)))
        assert answer.status == 2
        assert f"cannot open {held.name}: another program has it open" in answer.err
    finally:
        os.close(slave)
        os.close(master)


@pytest.mark.parametrize("line", [9, 100])
def test_steps_that_no_line_of_the_program_would_lose(line: int, square: str, cli: Cli) -> None:
    answer = clean(cli("verify", square, "--lose-steps", f"X:5@{line}"))
    assert answer.status == 1
    assert f"--lose-steps X:5@{line}: the program moves in no line from {line} on" in answer.err


def test_a_picture_of_an_unknown_kind(square: str, cli: Cli) -> None:
    answer = clean(cli("preview", square, "-o", "picture.bmp"))
    assert answer.status == 2
    assert ".png" in answer.err


@pytest.mark.parametrize("arguments", [("nonsense",), ("check",), ("plan", "--solver", "magic", "x.nc")])
def test_a_wrong_call_is_a_usage_error(arguments: tuple[str, ...], cli: Cli) -> None:
    answer = clean(cli(*arguments))
    assert answer.status == 2
    assert "Usage:" in answer.err
