"""Estimates: parts add up, operations and tools have their names, and the simulated machine takes that long."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]
ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """(head)
G21 G90 G64 P0.01 F600
T1 M6
(rough)
G0 X5 Y5
G1 X25 (along)
G4 P0.5
(finish)
T2 M6
G1 Y15
G0 X0 Y0
M2
"""


@pytest.fixture
def program(tmp_path: Path) -> str:
    path = tmp_path / "part.nc"
    path.write_text(PROGRAM)
    return str(path)


def test_every_way_of_cutting_up_the_time_adds_up(program: str, cli: Cli) -> None:
    found = json.loads(cli("estimate", program, "--json").out)
    plan = json.loads(cli("plan", program, "--json").out)
    assert found["time_s"] == pytest.approx(plan["duration_s"], abs=1e-9)
    kinds = found["cutting_s"] + found["rapid_s"] + found["rest_s"]
    assert kinds == pytest.approx(found["time_s"], abs=1e-9)
    for way in ("operations", "tools"):
        assert sum(share["time_s"] for share in found[way]) == pytest.approx(found["time_s"], abs=1e-9)
    assert found["rest_s"] == pytest.approx(0.5)


def test_operations_are_named_by_comments_that_stand_alone(program: str, cli: Cli) -> None:
    found = json.loads(cli("estimate", program, "--json").out)
    assert [(share["name"], share["line"]) for share in found["operations"]] == [("rough", 4), ("finish", 8)]
    rough, finish = (share["time_s"] for share in found["operations"])
    # 20 mm at 10 mm/s and the rest of half a second; 10 mm at 10 mm/s and the way back
    assert rough == pytest.approx(2 + 0.5 + 0.25, abs=0.15)
    assert finish == pytest.approx(1 + 0.6, abs=0.15)
    assert [share["name"] for share in found["tools"]] == ["T1", "T2"]


def test_several_files_are_summed_and_a_refused_one_does_not_hide_the_others(
    program: str, tmp_path: Path, cli: Cli
) -> None:
    bad = tmp_path / "bad.nc"
    bad.write_text("G21 G90\nG1 X5000 F100\nM2\n")
    answer = cli("estimate", program, str(bad), program)
    assert answer.status == 1
    assert answer.out.count("part.nc: ") == 2
    assert "all: " in answer.out
    assert "leaves its travel" in answer.err
    assert "1 of 3 files refused" in answer.err


@pytest.mark.parametrize("name", ["full_circle_ij.ngc", "inch_mm_switch.ngc", "number_forms.ngc", "block_delete.nc"])
def test_the_simulated_machine_takes_as_long(name: str, cli: Cli) -> None:
    file = str(next((ROOT / "examples/suite/programs/synthetic").glob(f"*{name}")))
    offset = ("--work-offset", "5,5,0")
    estimated = json.loads(cli("estimate", file, *offset, "--json").out)["time_s"]
    simulated = json.loads(cli("verify", file, *offset, "--json").out)["sim_time_s"]
    # a motor's last step is half a step before its place: up to some milliseconds on the slowest approach
    assert simulated == pytest.approx(estimated, rel=1e-3, abs=0.003)
