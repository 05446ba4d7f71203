"""CY545 axes on other machines than the shipped one: beside servos, two, a linear one, with jerk limits, with CTS."""

import pytest

from gcode.setup import Setup
from machines.job import plan_job, read_job
from machines.load import MachineFile, parse_machine, read_machine
from machines.runner import RunOptions, perform
from machines.verdict import Verdict

LINE = '\n[bus.{name}]\nport = "sim"\nbaud = {baud}\n'
AXIS = """
[axis.{axis}]
chip = "cy545"
bus = "{bus}"
steps_per_unit = {scale}
max_velocity = {velocity}
max_acceleration = {acceleration}
pull_in_velocity = {first}
travel = [-400, 400]
"""
ROTARY = {"scale": -40, "velocity": 90, "acceleration": 400, "first": 8}
LINEAR = {"scale": 200, "velocity": 15, "acceleration": 60, "first": 2}


def with_axes(machine: str, *added: str) -> MachineFile:
    text = read_machine(machine).text
    head = text.index("[sim]")
    text = text[:head] + "".join(added) + "\n" + text[head:]
    return MachineFile("made.toml", text, parse_machine(text, "made.toml"))


def verdict_of(machine: MachineFile, program: str, profile: str = "auto") -> Verdict:
    job = read_job(program, Setup(file="job.nc"), machine.config)
    assert not job.errors, job.errors
    result = perform(job, plan_job(job, machine.config), machine, RunOptions(port="sim", profile=profile))
    assert result.verdict is not None, result.fault
    assert result.verdict.violations == {}
    assert result.verdict.ok, result.verdict.reasons
    return result.verdict


PROGRAM = "G21 G90 G64 P0.02\nG0 X4 Y3\nG0 A30\nG1 X8 F900\nG2 X8 Y7 I0 J2\nG0 A-15\nG0 X0 Y0\nM2\n"


@pytest.mark.parametrize("machine", ["mill3-step", "mill3-mixed", "mill3-servo", "gantry4-step"])
def test_a_motor_that_turns_the_other_way_beside_every_shipped_machine(machine: str) -> None:
    made = with_axes(machine, LINE.format(name="turn", baud=9600), AXIS.format(axis="A", bus="turn", **ROTARY))
    verdict = verdict_of(made, PROGRAM)
    assert verdict.end_error_steps["A"] == 0
    assert verdict.axes == ("X", "Y", "Z", "A")


@pytest.mark.parametrize("profile", ["group", "adaptive"])
def test_both_profiles_of_steppers(profile: str) -> None:
    made = with_axes("mill3-step", LINE.format(name="turn", baud=19200), AXIS.format(axis="A", bus="turn", **ROTARY))
    verdict_of(made, PROGRAM, profile)


def test_two_of_them_a_rotary_and_a_linear_one_move_one_after_the_other() -> None:
    made = with_axes(
        "mill3-step",
        LINE.format(name="turn", baud=9600),
        LINE.format(name="slide", baud=19200),
        AXIS.format(axis="A", bus="turn", **ROTARY),
        AXIS.format(axis="U", bus="slide", **LINEAR),
    )
    verdict = verdict_of(made, "G21 G90\nG0 X2\nG0 A10\nG0 U-12.5\nG1 U5 F300\nG1 X0 F600\nG0 A0\nM2\n")
    assert verdict.end_error_steps == {"X": 0, "Y": 0, "Z": 0, "A": 0, "U": 0}
    assert verdict.peak["U"].velocity <= 15


def test_a_line_may_stand_before_the_buses_in_the_file() -> None:
    made = read_machine("mill3-step").text.replace("[bus.main]", LINE.format(name="turn", baud=9600) + "\n[bus.main]")
    head = made.index("[sim]")
    made = made[:head] + AXIS.format(axis="A", bus="turn", **ROTARY) + "\n" + made[head:]
    verdict_of(MachineFile("made.toml", made, parse_machine(made, "made.toml")), PROGRAM)


def test_axes_with_jerk_limits_keep_their_places() -> None:
    text = with_axes(
        "mill3-step", LINE.format(name="turn", baud=9600), AXIS.format(axis="A", bus="turn", **ROTARY)
    ).text
    text = text.replace("max_acceleration = 500", "max_acceleration = 500\nmax_jerk = 20000")
    text = text.replace("max_acceleration = 200", "max_acceleration = 200\nmax_jerk = 20000")
    verdict_of(MachineFile("made.toml", text, parse_machine(text, "made.toml")), PROGRAM)


def test_cts_and_another_crystal() -> None:
    axis = AXIS.format(axis="A", bus="turn", **ROTARY) + "cts = true\ncrystal_mhz = 11.0592\n"
    made = with_axes("mill3-step", LINE.format(name="turn", baud=9600), axis)
    assert verdict_of(made, PROGRAM).end_error_steps["A"] == 0
