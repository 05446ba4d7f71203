"""The suite runner: baselines that read well, and every kind of change caught and named."""

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from groupstart.regress.baseline import baseline_text, read_baseline, write_baseline
from groupstart.regress.case import Case, Result, run_case
from groupstart.regress.compare import allowed, differences
from groupstart.regress.motiontable import polyline, read_rows
from groupstart.regress.suite import SuiteError, read_suite

Cli = Callable[..., Any]
ROOT = Path(__file__).resolve().parents[2]
PROGRAM = "G21 G90 G64 P0.01 F1200\nG0 X1\nG1 X4\nG1 Y3\nG3 X2 Y3 I-1 J0\nM2\n"
SUITE = """
[suite]
name = "small"
[tolerance]
"plan.time_s" = 1e-6
[[machine]]
name = "step"
file = "step.toml"
[[machine]]
name = "servo"
file = "servo.toml"
[[job]]
name = "part"
file = "part.nc"
"""


def machine_text(name: str) -> str:
    return (ROOT / "machines" / "data" / f"{name}.toml").read_text(encoding="utf-8")


@pytest.fixture
def suite(tmp_path: Path, cli: Cli) -> Path:
    (tmp_path / "part.nc").write_text(PROGRAM)
    (tmp_path / "step.toml").write_text(machine_text("mill3-step"))
    (tmp_path / "servo.toml").write_text(machine_text("mill3-servo"))
    path = tmp_path / "suite.toml"
    path.write_text(SUITE)
    assert cli("regress", str(path), "--update", "--workers", "1").status == 0
    return path


def changed(cli: Cli, suite: Path) -> str:
    answer = cli("regress", str(suite), "--workers", "1")
    assert answer.status == 1
    return str(answer.out)


def test_a_suite_passes_against_its_own_baselines(suite: Path, cli: Cli) -> None:
    answer = cli("regress", str(suite), "--workers", "1")
    assert answer.status == 0, answer.out
    assert "2 cases, all as in the baselines" in answer.out
    again = cli("regress", str(suite), "--update", "--workers", "1")
    assert "0 of 2 baselines are new" in again.err


def test_a_moved_line_is_named(suite: Path, cli: Cli) -> None:
    (suite.parent / "part.nc").write_text(PROGRAM.replace("G1 Y3", "G1 Y3.2").replace("G3 X2 Y3", "G3 X2 Y3.2"))
    out = changed(cli, suite)
    assert "line 4: canonical command: STRAIGHT_FEED(4.0000, 3.0000" in out
    assert "-> STRAIGHT_FEED(4.0000, 3.2000" in out
    assert "line 4: first line that moves otherwise" in out or "line 4: place of line" in out


def test_a_changed_tolerance_is_named_as_the_machine_key_and_shows_in_the_plan(suite: Path, cli: Cli) -> None:
    file = suite.parent / "step.toml"
    file.write_text(file.read_text().replace("path_tolerance = 0.010", "path_tolerance = 0.020"))
    (suite.parent / "part.nc").write_text(PROGRAM.replace("G64 P0.01", "G64"))
    assert cli("regress", str(suite), "--update", "--workers", "1").status == 0
    file.write_text(file.read_text().replace("path_tolerance = 0.020", "path_tolerance = 0.050"))
    out = changed(cli, suite)
    assert "machine.machine.path_tolerance: 0.02 -> 0.05" in out
    assert "plan.time_s" in out
    assert "same    part on servo" in out


def test_a_changed_gain_is_named_and_shows_in_the_trace(suite: Path, cli: Cli) -> None:
    file = suite.parent / "servo.toml"
    file.write_text(file.read_text().replace("kp = 220", "kp = 150", 1))
    out = changed(cli, suite)
    assert "machine.axis.X.servo.kp: 220 -> 150 (-70)" in out
    assert "trace.digest" in out
    assert "same    part on step" in out


def test_another_seed_changes_digests_only_where_chance_is(suite: Path, cli: Cli) -> None:
    suite.write_text(SUITE.replace('name = "small"', 'name = "small"\nseed = 9'))
    out = changed(cli, suite)
    assert "exchanges.digest" in out
    assert "canonical" not in out
    assert "plan." not in out


def test_results_for_machines(suite: Path, tmp_path: Path, cli: Cli) -> None:
    file = suite.parent / "servo.toml"
    file.write_text(file.read_text().replace("kp = 220", "kp = 150", 1))
    junit = tmp_path / "junit.xml"
    answer = cli("regress", str(suite), "--workers", "1", "--json", "--junit", str(junit))
    data = json.loads(answer.out)
    assert data["ok"] is False
    assert [(case["machine"], case["ok"]) for case in data["cases"]] == [("step", True), ("servo", False)]
    assert {difference["what"] for difference in data["cases"][1]["differences"]} >= {"machine.axis.X.servo.kp"}
    tree = ET.parse(junit).getroot()
    assert tree.attrib == {"tests": "2", "failures": "1"}
    (failure,) = tree.iter("failure")
    assert "servo.kp" in str(failure.text)


def test_an_overlay_page_is_written_for_what_changed(suite: Path, tmp_path: Path, cli: Cli) -> None:
    (suite.parent / "part.nc").write_text(PROGRAM.replace("G1 X4", "G1 X3.5").replace("G1 Y3", "G1 X4 Y3"))
    answer = cli("regress", str(suite), "--workers", "1", "--report", str(tmp_path / "pages"))
    assert answer.status == 1
    pages = sorted(path.name for path in (tmp_path / "pages").iterdir())
    assert pages == ["part-servo.html", "part-step.html"]
    text = (tmp_path / "pages" / "part-step.html").read_text(encoding="utf-8")
    assert '"overlay":true' in text
    assert "STRAIGHT_FEED(3.5000" in text


@pytest.fixture(scope="module")
def result() -> Result:
    case = Case("part", "step", "part.nc", PROGRAM, machine_text("mill3-step"), "mill3-step.toml")
    first, second = run_case(case), run_case(case)
    assert first == second
    return first


def test_a_baseline_comes_back_as_it_was_written(result: Result, tmp_path: Path) -> None:
    assert write_baseline(tmp_path, result)
    found = read_baseline(tmp_path, "part", "step")
    assert found is not None
    assert found.fields == dict(result.fields)
    assert (found.canon, found.rows) == (result.canon, result.rows)
    assert differences(result, found, {}) == []
    assert "\nplan.time_s = " in baseline_text(result)


def test_a_change_in_one_line_leaves_the_rows_of_the_others(result: Result) -> None:
    text = PROGRAM.replace("G1 X4\nG1 Y3", "G1 X4.1\nG1 X4 Y3")
    other = run_case(Case("part", "step", "part.nc", text, machine_text("mill3-step"), "mill3-step.toml"))
    unlike = [k for k, (a, b) in enumerate(zip(result.rows, other.rows, strict=True)) if a != b]
    assert {read_rows(result.rows[: k + 1])[-1].line for k in unlike} <= {3, 4, 5}
    t, places = polyline(read_rows(other.rows), (0.0, 0.0, 0.0))
    assert t[-1] == pytest.approx(float(dict(other.fields)["plan.time_s"]), abs=1e-4)
    assert places[:, 0].max() == pytest.approx(4.1, abs=0.01)


def test_tolerances_are_found_by_the_end_of_a_name() -> None:
    given = {"contour_um": 0.5, "plan.time_s": 0.1, "rms": 0.01}
    assert allowed("verdict.contour_um.max", given) == 0.5
    assert allowed("plan.time_s", given) == 0.1
    assert allowed("verdict.motor_contour_um.rms", given) == 0.01
    assert allowed("verdict.lag_ms.max", given) == 0


def test_a_number_within_its_tolerance_is_no_difference(result: Result, tmp_path: Path) -> None:
    write_baseline(tmp_path, result)
    baseline = read_baseline(tmp_path, "part", "step")
    assert baseline is not None
    fields = tuple((k, "9.000" if k == "verdict.contour_um.max" else v) for k, v in result.fields)
    moved = replace(result, fields=fields)
    assert [d.what for d in differences(moved, baseline, {})] == ["verdict.contour_um.max"]
    assert differences(moved, baseline, {"contour_um": 50.0}) == []


def test_a_refused_program_is_a_fault_with_its_words(tmp_path: Path) -> None:
    case = Case("bad", "step", "bad.nc", "G1 X9999 F100\nM2\n", machine_text("mill3-step"), "mill3-step.toml")
    found = run_case(case)
    assert "leaves its travel" in found.fault
    write_baseline(tmp_path, found)
    baseline = read_baseline(tmp_path, "bad", "step")
    assert differences(found, baseline, {}) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[suite]\nname = 'x'\n", "machine"),
        ("[suite\n", "not TOML"),
        (SUITE + "colour = 3\n", "job.0.colour"),
        (SUITE + "machines = ['lathe']\n", "no machine 'lathe'"),
        (SUITE.replace('"step.toml"', '"none.toml"'), "machine step"),
        (SUITE.replace('name = "servo"', 'name = "step"'), "two entries"),
    ],
)
def test_mistakes_in_a_suite_are_told_with_their_place(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "part.nc").write_text(PROGRAM)
    for name in ("step", "servo"):
        (tmp_path / f"{name}.toml").write_text(machine_text(f"mill3-{name}"))
    path = tmp_path / "suite.toml"
    path.write_text(text)
    with pytest.raises(SuiteError, match=words):
        read_suite(path)


def test_the_example_suite_is_whole() -> None:
    suite = read_suite(ROOT / "examples" / "suite.toml")
    assert len({case.job for case in suite.cases}) >= 20
    assert len({case.machine for case in suite.cases}) == 3
    for case in suite.cases:
        assert read_baseline(suite.baselines, case.job, case.machine) is not None, case.name


@pytest.mark.slow
def test_the_example_suite_is_as_in_its_baselines(cli: Cli) -> None:
    answer = cli("regress", str(ROOT / "examples" / "suite.toml"))
    assert answer.status == 0, answer.out
