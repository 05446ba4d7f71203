"""What a program asks of the machine is answered by assumption on the twin and refused on a real machine."""

from dataclasses import replace
from importlib import resources

import pytest

from gcode.setup import Setup
from machines.job import plan_job, read_job
from machines.load import load_machine, parse_machine, read_machine
from machines.runner import RunOptions, perform

SHIPPED = (resources.files("machines") / "data" / "mill3-step.toml").read_text(encoding="utf-8")
PROGRAM = "G21 G90 F600\nG38.2 Z-5\nM66 P1 L3 Q2\n  M66 E0\nG1 X5\nM2\n"


def found(config) -> list[tuple[int, int, int, str, str]]:  # type: ignore[no-untyped-def]
    job = read_job(PROGRAM, Setup(file="a.nc", start=(0, 0, 5, 0, 0, 0, 0, 0, 0)), config)
    return [(d.line, d.column, d.end_column, d.code, d.severity) for d in job.diagnostics if d.code == "PR001"]


def test_the_twin_answers_and_says_how() -> None:
    places = [(2, 1, 10, "PR001"), (3, 1, 13, "PR001"), (4, 3, 9, "PR001")]
    assert found(read_machine("mill3-step").config) == [(*place, "warning") for place in places]


def test_a_machine_on_ports_refuses() -> None:
    config = parse_machine(SHIPPED.replace('port = "sim"', 'port = "/dev/ttyUSB0"'), "m.toml")
    assert [severity for *_, severity in found(config)] == ["error"] * 3


def test_a_port_that_is_named_later_refuses_before_anything_is_opened() -> None:
    machine = read_machine("mill3-step")
    start = (0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    job = read_job("G21 G90 F600\nG38.2 Z4\nM2\n", Setup(file="a.nc", start=start), machine.config)
    result = perform(job, plan_job(job, machine.config, "kernel"), machine, replace(RunOptions(), port="/dev/none"))
    assert result.outcome is None
    assert result.fault.startswith("line 2: nothing on this machine reads a probe")


def test_a_program_that_asks_nothing_is_not_told() -> None:
    config = read_machine("mill3-step").config
    job = read_job(PROGRAM.replace("G38.2", "G1").replace("M66", "; M66"), Setup(file="a.nc"), config)
    assert "PR001" not in {d.code for d in job.diagnostics}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("G33 Z-1 K1", "threads (G33, G76)"),
        ("G33.1 Z-1 K1", "rigid tapping (G33.1)"),
        ("G76 P1 Z-1 I-1 J0.5 K1", "G76"),
    ],
)
def test_motion_that_follows_a_spindle_is_refused_by_the_check_with_its_line(words: str, told: str) -> None:
    text = f"G21 G90\nM3 S500\nG0 X5\n{words}\nG0 X1\n{words}\nM2\n"
    found = read_job(text, Setup(file="p.nc"), load_machine("mill3-spindle")).errors
    assert [(item.line, item.code) for item in found] == [(4, "PL001"), (6, "PL001")]
    assert all(told in item.message and item.hint for item in found)
