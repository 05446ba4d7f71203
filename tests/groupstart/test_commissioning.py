"""The verbs that measure a machine: what they print, write, refuse, and how they end."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from machines.load import parse_machine, read_machine

Cli = Callable[..., Any]


def own_machine(folder: Path, name: str = "mill3-step", **edits: str) -> Path:
    text = read_machine(name).text
    for old, new in edits.items():
        assert old in text
        text = text.replace(old, new)
    path = folder / "own.toml"
    path.write_text(text)
    return path


def test_probe_latch_writes_what_it_has_found_and_keeps_every_comment(tmp_path: Path, cli: Cli) -> None:
    path = own_machine(tmp_path)
    before = path.read_text()
    answer = cli("probe-latch", "-m", str(path), "Y")
    assert answer.status == 0
    assert 'count_latch = "rollover"' in answer.out
    assert all(f"X-{number}" in answer.out for number in (61, 62, 63, 64, 65))
    after = path.read_text()
    added = [line for line in after.splitlines() if line and line not in before.splitlines()]
    assert added[:3] == ['count_latch = "rollover"', 'first_step = "period"', "[axis.Y.probed]"]
    lines = iter(after.splitlines())
    assert all(line in lines for line in before.splitlines())
    table = parse_machine(after, "own").axis["Y"]
    assert table.chip == "pic-step"
    assert table.probed is not None
    assert (table.probed.version, table.probed.measured_on) == (1, "twin, seed 1")
    assert table.probed.date.startswith("20")


def test_probe_latch_tells_the_other_reading_and_can_leave_the_file_alone(tmp_path: Path, cli: Cli) -> None:
    path = own_machine(tmp_path, **{'count_latch = "rollover"': 'count_latch = "immediate"'})
    before = path.read_text()
    options = ("--no-write", "--json", "--amplifier-off", "--reset")
    answer = cli("probe-latch", "-m", str(path), "X", "--seed", "7", *options)
    assert answer.status == 0
    found = json.loads(answer.out)
    assert (found["motor"], found["count_latch"], found["only_rollover"]) == ("X", "immediate", 0)
    assert [one["rule"] for one in found["answers"]] == ["X-63", "X-64", "X-64", "X-65", "X-66", "X-66"]
    assert path.read_text() == before


def test_what_is_not_decided_is_not_written(tmp_path: Path, cli: Cli) -> None:
    path = own_machine(tmp_path, **{"limit1_at = 118": "limit1_at = 0.01"})
    before = path.read_text()
    answer = cli("probe-latch", "-m", str(path), "X")
    assert answer.status == 1
    assert "not decided" in answer.err
    assert path.read_text() == before


def test_a_shipped_machine_is_not_written(cli: Cli) -> None:
    before = read_machine("mill3-step").text
    answer = cli("probe-latch", "Z")
    assert answer.status == 0
    assert "copy it" in answer.err
    assert read_machine("mill3-step").text == before


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (("probe-latch", "A"), 1, "X, Y, Z"),
        (("probe-latch", "-m", "mill3-servo"), 1, "no motor is on a PIC-STEP"),
        (("probe-latch", "--port", "/dev/null/none"), 1, "say --yes"),
        (("probe-latch", "--port", "/dev/null/none", "--yes"), 2, "cannot open"),
        (("calibrate", "A"), 1, "X, Y, Z"),
        (("calibrate", "--port", "/dev/null/none"), 1, "say --yes"),
        (("calibrate", "--seconds", "1"), 2, "--seconds"),
        (("tune", "X"), 1, "it has no PIC-SERVO"),
        (("tune", "A", "-m", "mill3-servo"), 1, "X, Y, Z"),
        (("tune", "X", "-m", "mill3-servo", "--write"), 1, "copy it"),
        (("tune", "X", "-m", "mill3-servo", "--room", "100"), 1, "too small"),
        (("tune", "X", "-m", "mill3-servo", "--port", "/dev/null/none"), 1, "say --yes"),
    ],
)
def test_what_the_measuring_verbs_refuse(arguments: tuple[str, ...], status: int, words: str, cli: Cli) -> None:
    answer = cli(*arguments)
    assert answer.status == status
    assert words in answer.err
    assert "Traceback" not in answer.err


def test_tune_prints_and_draws_the_step_and_writes_only_when_told(tmp_path: Path, cli: Cli) -> None:
    path = own_machine(tmp_path, "mill3-servo", **{"kp = 220": "kp = 60  # weak", "kd = 2640": "kd = 700"})
    before = path.read_text()
    runs = tmp_path / "runs"
    answer = cli("tune", "Y", "-m", str(path), "--runs", str(runs), "--json", "--picture", "svg")
    assert answer.status == 0
    found = json.loads(answer.out)
    assert found["kp"] > 100
    assert found["after"]["rise_ms"] < 20
    assert path.read_text() == before
    [folder] = runs.iterdir()
    assert {item.name for item in folder.iterdir()} == {
        "machine.toml",
        "journal.jsonl",
        "steps.txt",
        "steps.svg",
        "gains.json",
    }
    assert "nine tenths" in (folder / "steps.txt").read_text()
    again = cli("tune", "Y", "-m", str(path), "--runs", str(runs), "--write")
    assert again.status == 0
    assert f"kp = {found['kp']}\nkd = {found['kd']}\n" in again.out
    after = path.read_text()
    table = parse_machine(after, "own").axis["Y"]
    assert table.chip == "pic-servo"
    assert (table.servo.kp, table.servo.kd) == (found["kp"], found["kd"])
    assert f"kp = {found['kp']}  # weak" in after


def test_calibrate_measures_and_remembers(tmp_path: Path, cli: Cli) -> None:
    path = own_machine(tmp_path, "mill3-mixed")
    answer = cli("calibrate", "-m", str(path), "Z", "Y", "--seconds", "5", "--json")
    assert answer.status == 0
    found = {item["motor"]: item for item in map(json.loads, answer.out.splitlines())}
    assert list(found) == ["Z", "Y"]
    machine = read_machine(str(path)).config
    for motor, item in found.items():
        crystal = machine.axis[motor].crystal  # type: ignore[union-attr]
        assert crystal is not None
        assert abs(crystal.ppm - item["ppm"]) < 0.01
        assert crystal.within_ppm < 40
        assert crystal.measured_on == "twin, seed 1"
    assert machine.axis["X"].crystal is None  # type: ignore[union-attr]


def test_calibrate_goes_on_where_one_motor_is_not_decided(tmp_path: Path, cli: Cli) -> None:
    path = own_machine(tmp_path, **{"limit1_at = 118": "limit1_at = 1"})
    answer = cli("calibrate", "-m", str(path), "X", "Z", "--seconds", "4")
    assert answer.status == 1
    assert "X: the motor stopped after" in answer.err
    machine = read_machine(str(path)).config
    assert machine.axis["X"].crystal is None  # type: ignore[union-attr]
    assert machine.axis["Z"].crystal is not None  # type: ignore[union-attr]


def test_a_machine_file_behind_a_link_is_written_through_the_link(tmp_path: Path, cli: Cli) -> None:
    (tmp_path / "real").mkdir()
    path = own_machine(tmp_path / "real")
    path.chmod(0o640)
    link = tmp_path / "link.toml"
    link.symlink_to(path)
    assert cli("calibrate", "-m", str(link), "X", "--seconds", "4").status == 0
    assert link.is_symlink()
    assert parse_machine(path.read_text(), "own").axis["X"].crystal is not None  # type: ignore[union-attr]
    assert path.stat().st_mode & 0o777 == 0o640
    assert [each.name for each in path.parent.iterdir()] == ["own.toml"]


def test_a_disk_that_refuses_the_new_machine_file_leaves_the_old_one_and_nothing_beside_it(
    tmp_path: Path, cli: Cli
) -> None:
    path = own_machine(tmp_path)
    before = path.read_text()
    (tmp_path / "own.toml.new").symlink_to("/dev/full")
    answer = cli("calibrate", "-m", str(path), "X", "--seconds", "4")
    assert answer.status == 2
    assert "motor X: its crystal runs" in answer.out
    assert answer.err.endswith(f"{path}: No space left on device; it is as it was\n")
    assert path.read_text() == before
    assert [each.name for each in tmp_path.iterdir()] == ["own.toml"]
