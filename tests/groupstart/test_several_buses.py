"""The verbs on a machine with two buses: every bus is scanned, dumped, drawn, judged and compared."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]
PROGRAM = "G21 G90 G64 P0.01 F1200\nG0 X1\nG1 X4 Y2 Z1\nG3 X3 Y3 I-1 J0\nG1 Z0\nM2\n"
SUITE = '[suite]\nname = "s"\n[[machine]]\nname = "two"\nfile = "two.toml"\n[[job]]\nname = "part"\nfile = "part.nc"\n'


@pytest.fixture
def part(tmp_path: Path) -> str:
    path = tmp_path / "part.nc"
    path.write_text(PROGRAM)
    return str(path)


def test_scan_names_the_modules_of_every_bus(cli: Cli) -> None:
    answer = cli("scan", "-m", "gantry4-twobus")
    assert answer.status == 0
    assert "bus left: 2 modules" in answer.out
    assert "bus right: 2 modules" in answer.out


def test_a_report_has_both_buses_and_the_skew_between_them(part: str, tmp_path: Path, cli: Cli) -> None:
    report = tmp_path / "report.json"
    assert cli("verify", part, "-m", "gantry4-twobus", "--report", str(report)).status == 0
    told = json.loads(report.read_text())
    assert told["verdict"]["end_error_steps"] == {"X": 0, "Y": 0, "Z": 0, "Y2": 0}
    assert told["bus"]["late"] == 0
    assert told["bus"]["least_slack_ms"] >= -0.1, "slack is reckoned bus by bus"
    assert len(told["clocks"]) == 4
    assert all(start["skew_ms"] < 3 for start in told["starts"])
    page = tmp_path / "report.html"
    assert cli("verify", part, "-m", "gantry4-twobus", "--report", str(page)).status == 0
    lanes = {f'"bus":{bus},"address":{address}' for bus in (0, 1) for address in (1, 2)}
    text = page.read_text().replace(" ", "")
    assert all(lane in text for lane in lanes)


def test_the_trace_of_a_run_keeps_the_bytes_of_each_bus(part: str, tmp_path: Path, cli: Cli) -> None:
    runs = tmp_path / "runs"
    assert cli("run", part, "-m", "gantry4-twobus", "--runs", str(runs)).status == 0
    [folder] = runs.iterdir()
    both = [cli("dump", str(folder / "trace.npz"), "--bus", str(bus)) for bus in (0, 1)]
    assert all(answer.status == 0 for answer in both)
    assert both[0].out != both[1].out
    assert all("load_trajectory" in answer.out for answer in both)


def test_a_suite_on_two_buses_is_the_same_every_time(part: str, tmp_path: Path, root: Path, cli: Cli) -> None:
    (tmp_path / "two.toml").write_text((root / "machines" / "data" / "gantry4-twobus.toml").read_text())
    suite = tmp_path / "suite.toml"
    suite.write_text(SUITE)
    assert cli("regress", str(suite), "--update", "--workers", "1").status == 0
    assert cli("regress", str(suite), "--workers", "1").status == 0


def test_one_port_is_not_enough_for_two_buses(part: str, cli: Cli) -> None:
    answer = cli("run", part, "-m", "gantry4-twobus", "--port", "/dev/nothing")
    assert answer.status != 0
    assert "2 buses" in answer.err
