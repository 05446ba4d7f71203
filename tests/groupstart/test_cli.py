"""The verbs at their work: what stands on stdout, what in the files, and what is imported for it."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from machines.load import shipped_machines

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
Cli = Callable[..., Any]
SHORT = "G21 G90 G64 P0.01\nG0 X0 Y0 Z1\nG1 X6 F1200\nG2 X10 Y4 I0 J4\nG1 Y8\nG0 Z0\nM2\n"


@pytest.fixture
def short(tmp_path: Path) -> str:
    path = tmp_path / "short.nc"
    path.write_text(SHORT)
    return str(path)


def test_help_lists_every_verb(cli: Cli) -> None:
    answer = cli("--help")
    assert answer.status == 0
    for verb in ("check", "canon", "plan", "preview", "verify", "run", "machines", "dump"):
        assert f"  {verb} " in answer.out
        assert cli(verb, "--help").status == 0


SLOW = {"toppra", "numba", "matplotlib", "scipy", "ruckig", "rich"}


@pytest.mark.parametrize(
    "arguments",
    [["--help"], ["check", str(EXAMPLES / "01_compass.nc")], ["plan", "--help"], ["run", "--help"], ["machines"]],
)
def test_quick_verbs_import_nothing_slow(arguments: list[str]) -> None:
    script = (
        f"import sys\nsys.argv = ['groupstart', *{arguments!r}]\n"
        "from groupstart.cli import main\n"
        "try:\n    main()\nexcept SystemExit as leaving:\n    assert leaving.code == 0, leaving.code\n"
        f"print('SLOW', sorted({SLOW!r} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    assert "SLOW []" in done.stdout


@pytest.mark.parametrize(("verb", "at_once"), [("dump", True), ("scan", True), ("verify", False)])
def test_dump_and_scan_load_no_compiled_code(verb: str, at_once: bool) -> None:
    script = (
        "import sys\n"
        "from groupstart.compiled import FINDER, KERNELS, LIBRARY, ROOMS\n"
        "from groupstart import cli\n"
        f"command = cli.cli.get_command(None, {verb!r})\n"
        "FINDER.find_spec(f'{ROOMS[1]}.bus', None)\n"
        "print(FINDER.state, sorted({LIBRARY, KERNELS} & set(sys.modules)), sep=';')\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "GROUPSTART_COMPILED"}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, env=environment, check=True
    )
    assert (done.stdout == "turned off;[]\n") is at_once, done.stdout


def test_check_of_a_short_program_loads_neither_numpy_nor_rare_parts_of_the_interpreter(tmp_path: Path) -> None:
    path = tmp_path / "hundred.nc"
    moves = [f"X{n / 4} Y{n % 7}.5" if n % 5 else f"G3 X{n / 4} Y6 R50\nG1 F{300 + n}" for n in range(90)]
    head = ["%", "G21 G90 G17 G40 G49 G80 G94", "T1 M6", "S9000 M3", "#1=[2*3]", "G1 X#1 F200"]
    path.write_text("\n".join([*head, *moves, "M5", "M2", "%", ""]))
    heavy = {"numpy", "pydantic", "tomllib", *SLOW, "machines", "planner", "sim", "nmc"}
    heavy |= {f"gcode.{name}" for name in ("columns", "templates", "cycles", "compensation", "lathepath", "tooltable")}
    script = (
        f"import sys\nsys.argv = ['groupstart', 'check', {str(path)!r}]\n"
        "from groupstart.cli import main\n"
        "try:\n    main()\nexcept SystemExit as leaving:\n    assert not leaving.code, leaving.code\n"
        f"print('HEAVY', sorted({heavy!r} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    assert "HEAVY []" in done.stdout, done.stdout


def test_check_of_a_good_program_says_nothing_on_stdout(short: str, cli: Cli) -> None:
    answer = cli("check", short)
    assert (answer.status, answer.out) == (0, "")
    assert "no errors" in answer.err


def test_a_warning_alone_leaves_status_zero(tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / "endless.nc"
    path.write_text("G21 G90\nG1 X1 F100\n")
    answer = cli("check", str(path))
    assert answer.status == 0
    assert "warning" in answer.out


def test_canon_prints_what_stands_before_the_first_error(tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / "half.nc"
    path.write_text("G21 G90\nG1 X1 F100\nG1 X2 Q5\nG1 X3\nM2\n")
    answer = cli("canon", str(path))
    assert answer.status == 1
    assert "N2     STRAIGHT_FEED(1.0000, 0.0000" in answer.out
    assert "STRAIGHT_FEED(3.0000" not in answer.out
    assert f"{path}:3:7" in answer.err


def test_canon_to_a_file_with_more_digits(short: str, tmp_path: Path, cli: Cli) -> None:
    target = tmp_path / "canon.txt"
    assert cli("canon", short, "--digits", "6", "-o", str(target)).out == ""
    assert "STRAIGHT_FEED(6.000000, 0.000000, 1.000000" in target.read_text()


def test_tools_parameters_and_subprograms_come_from_files(tmp_path: Path, cli: Cli) -> None:
    (tmp_path / "tools.tbl").write_text("T3 P3 Z12.5 D6 ; a mill\n")
    (tmp_path / "saved.var").write_text("5221 7.0\n5220 1\n")
    (tmp_path / "subs").mkdir()
    (tmp_path / "subs" / "hop.ngc").write_text("o<hop> sub\nG1 X[#1]\no<hop> endsub\nM2\n")
    (tmp_path / "mill.ini").write_text("[RS274NGC]\nPARAMETER_FILE = saved.var\nSUBROUTINE_PATH = subs\n")
    program = tmp_path / "part.nc"
    program.write_text("G21 G90 F100\nT3 M6\nG43 H3\no<hop> call [5]\nM2\n")
    tools = ("--tool-table", str(tmp_path / "tools.tbl"))
    plan = tmp_path / "plan.npz"
    answer = cli("plan", str(program), *tools, "--ini", str(tmp_path / "mill.ini"), "-o", str(plan))
    assert answer.status == 0, answer.err
    with np.load(plan) as file:
        assert file["q"][-1] == pytest.approx([12, 0, 0])
    separate = ("--parameters", str(tmp_path / "saved.var"), "--include", str(tmp_path / "subs"))
    shown = cli("canon", str(program), *tools, *separate)
    assert "USE_TOOL_LENGTH_OFFSET(0.0000 0.0000 12.5000" in shown.out
    assert cli("check", str(program), *separate).status == 0
    missing = cli("check", str(program), *tools)
    assert missing.status == 1
    assert ":4:" in missing.out


def test_plan_writes_the_agreed_arrays_and_prints_the_report(short: str, tmp_path: Path, cli: Cli) -> None:
    target = tmp_path / "plan.npz"
    answer = cli("plan", short, "-m", "mill3-step", "-o", str(target), "--json")
    report = json.loads(answer.out)
    with np.load(target, allow_pickle=False) as file:
        assert set(file.files) == {"t_s", "q", "v", "line", "axes"}
        assert [str(axis) for axis in file["axes"]] == ["X", "Y", "Z"]
        count = len(file["t_s"])
        assert file["q"].shape == file["v"].shape == (count, 3)
        assert file["line"].shape == (count,)
        assert (file["t_s"].dtype, file["q"].dtype, file["line"].dtype) == (np.float64, np.float64, np.int32)
        assert np.diff(file["t_s"]).max() <= 0.001 + 1e-9
        assert file["t_s"][-1] == pytest.approx(report["duration_s"])
        assert file["q"][-1] == pytest.approx([10, 8, 0], abs=1e-9)


def test_work_offset_moves_the_plan(short: str, tmp_path: Path, cli: Cli) -> None:
    target = tmp_path / "plan.npz"
    assert cli("plan", short, "--work-offset", "5,-2,1", "-o", str(target)).status == 0
    with np.load(target) as file:
        assert file["q"][0] == pytest.approx([0, 0, 0])
        assert file["q"][-1] == pytest.approx([15, 6, 1], abs=1e-9)


@pytest.mark.parametrize(("ending", "magic"), [("png", b"\x89PNG"), ("svg", b"<?xml")])
def test_preview_draws(ending: str, magic: bytes, short: str, tmp_path: Path, cli: Cli) -> None:
    target = tmp_path / f"picture.{ending}"
    assert cli("preview", short, "-o", str(target)).status == 0
    assert target.read_bytes().startswith(magic)
    assert target.stat().st_size > 10_000


VERDICT_FIELDS = {
    "ok", "machine", "axes", "plan_time_s", "sim_time_s", "contour_um", "contour_steps", "program_um", "lag_ms",
    "end_error_steps", "worst_line", "late_slices", "violations", "bus", "peak", "limits",
}  # fmt: skip


def test_verify_json_has_the_agreed_fields_and_the_trace_the_agreed_arrays(
    short: str, tmp_path: Path, cli: Cli
) -> None:
    target = tmp_path / "trace.npz"
    answer = cli("verify", short, "-m", "mill3-step", "--json", "--trace", str(target))
    verdict = json.loads(answer.out)
    assert answer.status == 0
    assert set(verdict) >= VERDICT_FIELDS
    assert verdict["ok"] is True
    assert verdict["violations"] == {}
    assert verdict["end_error_steps"] == {"X": 0, "Y": 0, "Z": 0}
    assert set(verdict["contour_um"]) == set(verdict["contour_steps"]) == {"max", "p999", "rms"}
    assert set(verdict["bus"]) == {"packets", "bytes", "utilisation", "slice_ms"}
    assert verdict["contour_um"]["max"] == pytest.approx(5 * verdict["contour_steps"]["max"])
    assert verdict["sim_time_s"] == pytest.approx(verdict["plan_time_s"], rel=0.01)
    with np.load(target, allow_pickle=False) as file:
        assert [str(axis) for axis in file["axes"]] == ["X", "Y", "Z"]
        assert file["steps_per_unit"].tolist() == [200, 200, 200]
        end = file["start_steps"].copy()
        np.add.at(end, file["run_axis"], file["run_dir"].astype(np.int64) * file["run_count"])
        assert end.tolist() == [2000, 1600, 0]
        assert set(np.unique(file["bus_line"])) == {0, 1}
        first = file["bus_ns"].argmin()
        assert file["bus_byte"][first] == 0  # the log begins at power-up, with the nulls of start-up
        assert file["plan_start_ns"] > 0


def arrays(path: Path) -> dict[str, np.ndarray]:
    """All arrays of a file, which is closed again."""
    with np.load(path) as file:
        return dict(file)


def test_the_same_seed_gives_the_same_bytes(short: str, tmp_path: Path, cli: Cli) -> None:
    for name in ("a", "b", "c"):
        seed = "8" if name == "c" else "7"
        cli("verify", short, "--seed", seed, "--trace", str(tmp_path / f"{name}.npz"))
    a, b, c = (arrays(tmp_path / f"{name}.npz") for name in "abc")
    for key in a:
        assert np.array_equal(a[key], b[key]), key
    assert not np.array_equal(a["run_first_ns"], c["run_first_ns"])


def test_servo_samples_can_be_thinned(short: str, tmp_path: Path, cli: Cli) -> None:
    for every in ("1", "10"):
        trace = str(tmp_path / f"{every}.npz")
        assert cli("verify", short, "-m", "mill3-mixed", "--trace", trace, "--trace-servo-every", every).status == 0
    whole, thin = (arrays(tmp_path / f"{every}.npz") for every in ("1", "10"))
    assert set(np.unique(whole["servo_axis"])) == {0, 1}
    for motor in (0, 1):
        one, other = (trace["servo_ns"][trace["servo_axis"] == motor] for trace in (whole, thin))
        assert len(other) == pytest.approx(len(one) / 10, abs=2)
        assert (other[0], other[-1]) == (one[0], one[-1])
        assert np.isin(other, one).all()
    assert np.array_equal(whole["run_first_ns"], thin["run_first_ns"])
    assert np.array_equal(whole["bus_byte"], thin["bus_byte"])


def test_a_bad_verdict_is_status_one_and_still_writes_the_trace(short: str, tmp_path: Path, cli: Cli) -> None:
    strict = (ROOT / "machines" / "data" / "mill3-step.toml").read_text() + "\n[verify]\ncontour_steps = 0.001\n"
    machine = tmp_path / "strict.toml"
    machine.write_text(strict)
    target = tmp_path / "trace.npz"
    answer = cli("verify", short, "-m", str(machine), "--trace", str(target), "--json")
    verdict = json.loads(answer.out)
    assert answer.status == 1
    assert verdict["ok"] is False
    assert "contour error" in verdict["reasons"][0]
    assert target.exists()


def test_run_leaves_a_whole_run_folder(short: str, tmp_path: Path, cli: Cli) -> None:
    answer = cli("run", short, "-m", "mill3-step", "--runs", str(tmp_path / "runs"))
    assert answer.status == 0, answer.err
    assert "verdict: mill3-step" in answer.out
    [folder] = (tmp_path / "runs").iterdir()
    assert folder.name.endswith("-short")
    assert str(folder) in answer.err
    assert (folder / "job.nc").read_text() == SHORT
    assert (folder / "machine.toml").read_text() == (ROOT / "machines" / "data" / "mill3-step.toml").read_text()
    assert json.loads((folder / "verdict.json").read_text())["ok"] is True
    assert (folder / "path.png").read_bytes().startswith(b"\x89PNG")
    assert arrays(folder / "plan.npz")["t_s"][0] == 0
    assert len(arrays(folder / "trace.npz")["run_count"]) > 0
    journal = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    events = [record["event"] for record in journal]
    assert events[0] == "connected"
    assert [record["state"] for record in journal if record["event"] == "state"] == ["running", "idle"]
    assert [record["line"] for record in journal if record["event"] == "line"] == sorted(
        {record["line"] for record in journal if record["event"] == "line"}
    )
    assert [record["time_ns"] for record in journal] == sorted(record["time_ns"] for record in journal)


def test_two_runs_of_one_second_do_not_share_a_folder(short: str, tmp_path: Path, cli: Cli) -> None:
    for _ in range(2):
        assert cli("run", short, "--runs", str(tmp_path / "runs"), "--json").status == 0
    assert len(list((tmp_path / "runs").iterdir())) == 2


def test_machines_lists_names_one_a_line(cli: Cli) -> None:
    answer = cli("machines")
    assert tuple(answer.out.split()) == shipped_machines()
    shown = cli("machines", "show", "mill3-step").out
    assert shown == (ROOT / "machines" / "data" / "mill3-step.toml").read_text()
    assert json.loads(cli("machines", "show", "mill3-step", "--json").out)["axis"]["X"]["max_velocity"] == 60
    assert cli("machines", "check", *shipped_machines()).status == 0


def test_the_version_is_the_packages(cli: Cli) -> None:
    answer = cli("--version")
    assert answer.status == 0
    assert answer.out.strip()[0].isdigit()


def test_the_shipped_example_is_the_first_of_the_examples() -> None:
    shipped = (ROOT / "groupstart" / "data" / "compass.nc").read_bytes()
    assert shipped == (EXAMPLES / "01_compass.nc").read_bytes()
