"""What a bus can follow is told before anything moves: near what the simulator then shows, and silent where it does."""

from dataclasses import replace

import pytest

from benchmarks.busload import Case, machine, program
from gcode.setup import Setup
from machines.busload import Load, overload, possible_overload
from machines.cautions import cautions
from machines.control import Script
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
    case: Case, profile: str, chips: str = "step", allowed: float = 6.0, *, fit_bus: bool | None = False
) -> tuple[RunResult, list[str]]:
    _, described, plan = estimated(case, profile, chips, allowed)
    told: list[str] = []
    job = read_job(program(case, 1), Setup(file="p.nc"), described.config)
    options = RunOptions(port="sim", seed=1, profile=profile, warn=told.append, fit_bus=fit_bus)
    if fit_bus is not False:
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
    assert 0.5 < load.steps / result.verdict.contour_steps.max < 2
    assert told == [f"{load.words()} (--fit-bus)"]
    bad = result.verdict.contour_steps.max > 6.0
    assert result.verdict.ok is not bad
    assert result.verdict.warnings[:1] == ((load.words(),) if bad else ())


def test_nothing_is_said_of_three_axes_on_a_fast_bus() -> None:
    for profile in ("adaptive", "group", "exact"):
        assert estimated(STEEP, profile)[0] is None
    assert estimated(STEEP, "smooth", "servo")[0] is None
    assert estimated(STEEP, "smooth", "mixed")[0] is None


@pytest.mark.parametrize(
    ("case", "profile"),
    [
        (Case(3, 9600, 50, 300), "adaptive"),
        (Case(3, 9600, 50, 300), "group"),
        (Case(3, 9600, 50, 9), "adaptive"),
        (Case(8, 115200, 500, 60), "exact"),
    ],
)
def test_on_the_slowest_buses_too_a_stream_keeps_to_its_plan(case: Case, profile: str) -> None:
    result, _ = run(case, profile, allowed=12.0)
    assert result.verdict is not None
    assert result.verdict.ok, result.verdict.contour_steps


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
    assert told == [f"{load.words()} (--fit-bus)"]
    assert result.verdict is not None
    assert result.verdict.ok
    assert result.verdict.warnings == ()


def test_what_went_wrong_is_told_in_words_unless_the_contour_was_measured_and_is_good() -> None:
    verdict = run(STEEP, "group")[0].verdict
    assert verdict is not None
    assert verdict.host is not None
    late = replace(verdict, late_slices=300)
    assert cautions(late, None, 6.0) == ()
    assert cautions(late, None, 1.0) == (
        "300 slices began late, 44 a second: what they need had not been said in time; "
        "what that cost is in the contour error",
    )
    [words] = cautions(replace(late, contour_steps=None), None, 6.0)
    assert words.endswith("what that cost was not measured")
    strained = replace(verdict.host, strain_steps=9.3, least_speed_percent=45.0)
    on_a_port = replace(verdict, contour_steps=None, host=strained)
    assert cautions(on_a_port, None, 6.0) == (
        "the axes were off the path by about 9 steps or counts, by what the host knows (contour_steps allows 6); "
        "slowed to 45 %",
    )
    assert cautions(on_a_port, None, 10.0) == ()


def test_a_slice_that_took_as_long_as_was_foreseen_is_not_late() -> None:
    verdict = run(STEEP, "group")[0].verdict
    assert verdict is not None
    assert verdict.late_slices < 25


def test_a_verdict_names_the_profiles() -> None:
    result, _ = run(STEEP, "auto", "mixed")
    assert result.verdict is not None
    assert result.verdict.profiles == {"main": "smooth"}


def test_a_machine_file_is_looked_at_with_all_axes_at_once() -> None:
    load = possible_overload(machine(Case(8, 115200, 500, 1200), "step").config, simulated=True)
    assert load is not None
    assert (load.bus, load.moving, load.line) == ("main", 8, 0)
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


def test_a_plan_is_fitted_unless_that_is_not_wanted_but_stop_here_points_only_where_it_is() -> None:
    slow = Case(3, 9600, 50, 300)
    fitted, told = run(slow, "adaptive", fit_bus=None)
    assert len(told) == 1
    assert told[0].startswith("planned with accelerations of ")
    assert fitted.verdict is not None
    assert fitted.verdict.ok
    assert fitted.verdict.warnings == ()
    plain, told = run(slow, "adaptive", fit_bus=False)
    assert plain.verdict is not None
    assert not plain.verdict.ok
    assert told == [f"{plain.verdict.warnings[0]} (--fit-bus)"]
    _, told = run(STEEP, "stop-here", "servo", fit_bus=None)
    assert len(told) == 1
    assert told[0].startswith("bus main is too slow")


def test_a_limit_below_what_steps_are_off_keeps_the_plan_and_the_warning() -> None:
    load, _, plan = estimated(STEEP, "adaptive", allowed=0.9)
    assert load is not None
    result, told = run(STEEP, "adaptive", allowed=0.9, fit_bus=True)
    assert told == [load.words()]
    assert result.plan.trajectory.duration_s >= plan.trajectory.duration_s


def test_a_hold_on_a_fitted_plan_keeps_to_the_path_as_well() -> None:
    case = Case(3, 9600, 500, 1200)
    described = machine(case, "step")
    text = "G21 G90 G64 P0.05 F1200\nG1 X40 Y30 Z20\nG1 X45 Y10 Z12\nM2\n"
    job = read_job(text, Setup(file="p.nc"), described.config)
    control = Script([(3.0, "hold"), (7.0, "resume")])
    options = RunOptions(port="sim", profile="adaptive", control=control)
    result = perform(job, plan_job(job, described.config), described, options)
    assert result.verdict is not None, result.fault
    assert result.verdict.bus_notes
    [hold] = result.verdict.holds
    assert hold.measured_s is not None
    assert hold.announced_s < hold.measured_s < hold.announced_s + 0.5
    assert result.verdict.ok, result.verdict.reasons
