"""Every example runs on its machine and ends with a good verdict; what a README promises is tried here."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
MILL = ("-m", "mill3-step")
ROUTER = ("-m", str(EXAMPLES / "machines" / "router.toml"))

PROGRAMS = [
    pytest.param("01_compass.nc", (*MILL,), id="compass"),
    pytest.param("03_index.nc", ("-m", "mill3-indexer"), id="index"),
    pytest.param("04_spindle.nc", ("-m", "mill3-spindle"), id="spindle"),
    pytest.param("corpus/gcodehs/sample.gcode", (*MILL,), id="pcb2gcode"),
    pytest.param("corpus/gcodehs/sample.gcode", ("-m", "mill3-servo"), id="pcb2gcode-servo"),
    pytest.param("corpus/gcodehs/sample.gcode", ("-m", "mill3-mixed"), id="pcb2gcode-mixed"),
    pytest.param("corpus/meerk40t/Back.nc", (*MILL, "--work-offset", "5,5,0"), id="fusion360"),
    pytest.param(
        "corpus/cluck2sesame/Enclosure.nc",
        (*ROUTER, "--work-offset", "10,260,0"),
        id="estlcam",
        marks=pytest.mark.slow,
    ),
]


@pytest.mark.parametrize(("program", "options"), PROGRAMS)
def test_an_example_program_is_good(program: str, options: tuple[str, ...], cli: Cli) -> None:
    answer = cli("verify", str(EXAMPLES / program), *options, "--json")
    verdict = json.loads(answer.out)
    assert verdict["violations"] == {}
    assert set(verdict["end_error_steps"].values()) == {0}
    assert verdict["sim_time_s"] == pytest.approx(verdict["plan_time_s"], rel=0.01)
    assert verdict["contour_steps"]["max"] <= 6, verdict["worst_line"]
    assert answer.status == 0


def test_every_example_program_is_in_the_list() -> None:
    listed = {str(parameter.values[0]) for parameter in PROGRAMS}
    there = {
        str(path.relative_to(EXAMPLES))
        for path in EXAMPLES.rglob("*")
        if path.suffix in (".nc", ".gcode", ".ngc") and "suite" not in path.parts  # those have a regression run
    }
    assert listed == there


@pytest.mark.parametrize("machine", sorted((EXAMPLES / "machines").glob("*.toml")), ids=lambda path: path.stem)
def test_every_example_machine_passes_its_check(machine: Path, cli: Cli) -> None:
    assert cli("machines", "check", str(machine)).status == 0


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_every_example_script_runs(script: Path, tmp_path: Path) -> None:
    place = {**os.environ, "PYTHONPATH": str(EXAMPLES.parent)}  # from the checkout, installed or not
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=place, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_every_corpus_program_has_its_licence_beside_it() -> None:
    for folder in (EXAMPLES / "corpus").iterdir():
        if folder.is_dir():
            assert (folder / "LICENSE").stat().st_size > 500
            assert folder.name in (EXAMPLES / "corpus" / "README.md").read_text()
