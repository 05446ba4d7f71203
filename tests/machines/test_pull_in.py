"""``pull_in_velocity`` of a stepper axis: corners are taken faster by that jump, and the pins do what was planned."""

import pytest

from gcode.setup import Setup
from machines.job import Job, plan_job, read_job
from machines.load import MachineFile, parse_machine, read_machine
from machines.runner import RunOptions, perform
from machines.wiring import planner_limits
from planner.plan import Plan

ZIGZAG = "G21 G90 G61\nF1200\n" + "".join(f"G1 X{k} Y{k % 2 * 0.1}\n" for k in range(1, 21)) + "M2\n"


def planned(pull_in_mm_s: float) -> tuple[MachineFile, Job, Plan]:
    text = read_machine("mill3-step").text
    if pull_in_mm_s:
        lines = [
            f"{line}\npull_in_velocity = {pull_in_mm_s}" if line.startswith("max_velocity") else line
            for line in text.splitlines()
        ]
        text = "\n".join(lines)
    machine = MachineFile("made.toml", text, parse_machine(text, "made.toml"))
    job = read_job(ZIGZAG, Setup(file="job.nc"), machine.config)
    assert not job.errors, job.errors
    return machine, job, plan_job(job, machine.config)


def test_without_the_key_no_velocity_jumps() -> None:
    machine, _, plan = planned(0.0)
    assert planner_limits(machine.config).velocity_jump is None
    assert plan.report.velocity_jumps == {}


def test_a_corner_uses_the_jump_and_the_report_says_so() -> None:
    _, _, plain = planned(0.0)
    machine, job, plan = planned(2.0)
    assert plan.trajectory.duration_s < plain.trajectory.duration_s - 0.1
    assert 0 < max(plan.report.velocity_jumps.values()) <= 2.0 * 1.001
    verdict = perform(job, plan, machine, RunOptions(port="sim")).verdict
    assert verdict is not None
    assert verdict.end_error_steps == {"X": 0, "Y": 0, "Z": 0}
    assert verdict.violations == {}
    assert verdict.sim_time_s == pytest.approx(plan.trajectory.duration_s, rel=0.01)
    assert verdict.contour_steps is not None
    assert verdict.contour_steps.max < 6
