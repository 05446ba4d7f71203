"""What a bus can follow is told before anything moves: near what the simulator then shows, and silent where it does."""

from dataclasses import replace

import pytest

from benchmarks.busload import Case, machine, program
from gcode.setup import Setup
from machines.busload import Load, overload, possible_overload
from machines.job import plan_job, read_job
from machines.load import MachineFile, load_machine, shipped_machines
from machines.runner import RunOptions, RunResult, perform
from planner.plan import Plan

STEEP = Case(3, 115200, 500, 1200)


def estimated(
    case: Case, profile: str, chips: str = "step", allowed: float = 6.0
) -> tuple[Load | None, MachineFile, Plan]:
    described = machine(case, chips)
    config = described.config
    config = config.model_copy(update={"verify": config.verify.model_copy(update={"contour_steps": allowed})})
    plan = plan_job(read_job(program(case, 1), Setup(file="p.nc"), config), config)
    return overload(config, plan.trajectory, profile, simulated=True), replace(described, config=config), plan


def run(
    case: Case, profile: str, chips: str = "step", allowed: float = 6.0, *, fit_bus: bool = False
) -> tuple[RunResult, list[str]]:
    _, described, plan = estimated(case, profile, chips, allowed)
    told: list[str] = []
    job = read_job(program(case, 1), Setup(file="p.nc"), described.config)
    options = RunOptions(port="sim", seed=1, profile=profile, warn=told.append, fit_bus=fit_bus)
    if fit_bus:
        options = replace(options, tell=told.append)
    return perform(job, plan, described, options), told


@pytest.mark.parametrize(
    ("axes", "baud", "profile", "chips"),
    [
        (8, 115200, "adaptive", "step"),
        (8, 115200, "group", "step"),
        (8, 57600, "smooth", "servo"),
        (3, 115200, "stop-here", "servo"),
        (3, 19200, "adaptive", "step"),
    ],
)
def test_the_estimate_is_near_what_the_simulator_shows(axes: int, baud: int, profile: str, chips: str) -> None:
    case = Case(axes, baud, 500, 1200)
    load, _, _ = estimated(case, profile, chips)
    result, told = run(case, profile, chips)
    assert load is not None
    assert result.verdict is not None
    assert result.verdict.contour_steps is not None
    assert not load.lost
    assert 0.5 < load.steps / result.verdict.contour_steps.max < 2
    assert told == [load.words()]
    assert result.verdict.warnings[0] == load.words()
    assert not result.verdict.ok


def test_nothing_is_said_of_three_axes_on_a_fast_bus() -> None:
    for profile in ("adaptive", "group", "exact"):
        assert estimated(STEEP, profile)[0] is None
    assert estimated(STEEP, "smooth", "servo")[0] is None
    assert estimated(STEEP, "smooth", "mixed")[0] is None


def test_a_bus_that_cannot_say_when_legs_begin_is_told_without_a_figure() -> None:
    slow = Case(3, 9600, 50, 300)
    load, _, _ = estimated(slow, "adaptive")
    assert load is not None
    assert load.lost
    assert "may fall far behind" in load.words()
    assert "a higher baud" in load.words()
    assert estimated(Case(2, 9600, 50, 300), "adaptive")[0] is None


def test_what_is_advised_is_enough() -> None:
    load, _, _ = estimated(Case(8, 115200, 500, 1200), "adaptive")
    assert load is not None
    assert "at most 5 axes on this bus" in load.words()
    assert estimated(Case(5, 115200, 500, 1200), "adaptive")[0] is None
    assert estimated(Case(8, 115200, 500 * int(100 * load.share) / 100, 1200), "adaptive")[0] is None


def test_a_measured_contour_within_its_limit_knows_better_than_an_estimate() -> None:
    load, _, _ = estimated(STEEP, "adaptive", allowed=1.99)
    assert load is not None
    result, told = run(STEEP, "adaptive", allowed=1.99)
    assert told == [load.words()]
    assert result.verdict is not None
    assert result.verdict.ok
    assert result.verdict.warnings == ()


def test_many_late_slices_are_told_in_words() -> None:
    result, _ = run(STEEP, "group")
    assert result.verdict is not None
    assert result.verdict.late_slices > 20
    [words] = result.verdict.warnings
    assert words.startswith(f"{result.verdict.late_slices} slices began late")


def test_a_verdict_names_the_profiles() -> None:
    result, _ = run(STEEP, "auto", "mixed")
    assert result.verdict is not None
    assert result.verdict.profiles == {"main": "smooth"}


def test_a_machine_file_is_looked_at_with_all_axes_at_once() -> None:
    load = possible_overload(machine(Case(8, 115200, 500, 1200), "step").config, simulated=True)
    assert load is not None
    assert (load.bus, load.moving, load.lost, load.line) == ("main", 8, False, 0)
    assert 8 < load.steps < 20
    assert possible_overload(machine(STEEP, "step").config, simulated=True) is None
    for name in shipped_machines():
        assert possible_overload(load_machine(name), simulated=True) is None


@pytest.mark.parametrize(
    ("axes", "profile", "chips", "what"),
    [
        (8, "adaptive", "step", "accelerations"),
        (3, "stop-here", "servo", "speeds"),
        (8, "group", "step", "accelerations"),
    ],
)
def test_a_plan_can_be_fitted_to_its_bus(axes: int, profile: str, chips: str, what: str) -> None:
    case = Case(axes, 115200, 500, 1200)
    plain, _ = run(case, profile, chips)
    result, told = run(case, profile, chips, fit_bus=True)
    assert plain.verdict is not None
    assert result.verdict is not None
    assert plain.verdict.contour_steps is not None
    assert result.verdict.contour_steps is not None
    assert len(told) == 1
    assert told[0].startswith(f"planned with {what} of ")
    assert result.verdict.contour_steps.max < 0.7 * plain.verdict.contour_steps.max
    assert result.verdict.contour_steps.max < 8
    assert result.plan.trajectory.duration_s > plain.plan.trajectory.duration_s


def test_a_bus_that_nothing_makes_up_for_keeps_its_plan_and_the_warning() -> None:
    slow = Case(3, 9600, 50, 300)
    load, _, plan = estimated(slow, "adaptive")
    assert load is not None
    result, told = run(slow, "adaptive", fit_bus=True)
    assert told == ["no lower accelerations or speeds make up for the bus: planned as before", load.words()]
    assert result.plan.trajectory.duration_s == pytest.approx(plan.trajectory.duration_s)
