"""A bus that cannot follow shows in axes that leave the path; the motion is slowed by as much as that takes."""

import re

import pytest

from benchmarks.busload import Case, machine, program
from gcode.setup import Setup
from machines import runner
from machines.fitting import slower
from machines.job import plan_job, read_job
from machines.load import MachineFile, parse_machine, read_machine
from machines.runner import RunOptions, RunResult, perform
from machines.strain import CALM_LOOKS, EVERY_NS, RANK, SETTLES_NS, Strain
from planner.stream_strain import Off, strain_steps

CIRCLES = "G21 G90 F1200\nG0 X10 Y20\n" + "G2 I10 J0\n" * 2 + "G0 X0 Y0\nM2\n"
SLOW = Case(3, 9600, 500, 1200)


def looked(strain: Strain, steps: float, count: int, now_ns: int = 0) -> tuple[list[float], int]:
    """Shares after each of ``count`` looks; looks are skipped where the strain wants none."""
    shares = []
    while len(shares) < count:
        if strain.due(now_ns):
            strain.look(steps, now_ns, strain.share)
            shares.append(strain.share)
        now_ns += EVERY_NS
    return shares, now_ns


def test_lag_is_no_strain_and_what_is_across_the_path_is() -> None:
    assert strain_steps([Off(3.0, 300.0), Off(4.0, 400.0)]) == pytest.approx(0.0, abs=1e-6)
    assert strain_steps([Off(4.0, 300.0), Off(-3.0, 400.0)]) == pytest.approx(5.0)
    assert strain_steps([Off(2.0, 0.0), Off(7.0, 100.0)]) == pytest.approx(2.0)
    assert strain_steps([Off(5.0, 100.0)]) == 0.0
    assert strain_steps([]) == 0.0


def test_a_moment_does_not_slow_and_a_while_does_by_the_root_of_what_is_too_much() -> None:
    strain = Strain(6.0)
    shares, now_ns = looked(strain, 19.2, RANK - 1)
    assert set(shares) == {1.0}
    shares, _ = looked(strain, 19.2, 1, now_ns)
    assert shares == [0.5]  # 0.8 of 6 steps are a quarter of 19.2
    assert strain.greatest_steps == 19.2


def test_after_a_change_what_is_under_way_is_not_looked_at() -> None:
    strain = Strain(6.0)
    _, now_ns = looked(strain, 20.0, RANK)
    changed_ns = now_ns - EVERY_NS
    assert not strain.due(changed_ns + SETTLES_NS - 1)
    assert strain.due(changed_ns + SETTLES_NS)


def test_the_speed_comes_back_after_a_calm_time_as_far_as_the_strain_allows() -> None:
    strain = Strain(6.0)
    _, now_ns = looked(strain, 19.2, RANK)
    shares, now_ns = looked(strain, 2.0, CALM_LOOKS, now_ns)
    assert shares[-2:] == [0.5, pytest.approx(0.75)]  # 0.5 * sqrt(4.8 / 2.0), in steps of 5 %
    shares, _ = looked(strain, 0.5, CALM_LOOKS, now_ns)
    assert shares[-1] == 1.0


def test_a_strain_that_does_not_give_way_slows_to_the_least_and_no_further() -> None:
    strain = Strain(6.0)
    shares, _ = looked(strain, 1000.0, 20)
    assert shares[-1] == 0.1


def test_the_share_in_force_counts_not_the_one_that_was_asked_for() -> None:
    strain = Strain(6.0)
    for look in range(RANK):
        strain.look(19.2, look * EVERY_NS, 0.6)  # the host has slowed it to 60 %
    assert strain.share == pytest.approx(0.3)


def test_where_nothing_moves_the_speed_does_not_come_back() -> None:
    strain = Strain(6.0)
    _, now_ns = looked(strain, 19.2, RANK)
    now_ns += SETTLES_NS
    for _ in range(2 * CALM_LOOKS):
        assert strain.due(now_ns)
        strain.skip(now_ns)
        now_ns += EVERY_NS
    assert strain.share == 0.5


def test_without_slowing_the_axes_are_looked_at_all_the_same() -> None:
    strain = Strain(6.0, slows=False)
    shares, _ = looked(strain, 19.2, 2 * RANK)
    assert set(shares) == {1.0}
    assert strain.greatest_steps == 19.2


def run(monkeypatch: pytest.MonkeyPatch, chips: str, profile: str, fit_bus: bool | None) -> RunResult:
    """Of a plan that nobody has fitted to its bus."""
    monkeypatch.setattr(runner, "_overload", lambda _config, _job, plan, _options: (plan, None, ()))
    described = machine(SLOW, chips)
    job = read_job(program(SLOW, 1), Setup(file="p.nc"), described.config)
    options = RunOptions(port="sim", seed=1, profile=profile, fit_bus=fit_bus)
    return perform(job, plan_job(job, described.config), described, options)


@pytest.mark.parametrize(("chips", "profile"), [("mixed", "smooth"), ("servo", "smooth"), ("step", "adaptive")])
def test_a_run_slows_where_its_bus_cannot_follow(monkeypatch: pytest.MonkeyPatch, chips: str, profile: str) -> None:
    plain, slowed = (run(monkeypatch, chips, profile, fits).verdict for fits in (False, None))
    assert plain is not None
    assert slowed is not None
    assert plain.host is not None
    assert slowed.host is not None
    assert plain.contour_steps is not None
    assert slowed.contour_steps is not None
    assert plain.host.least_speed_percent == 100
    assert plain.host.strain_steps is not None
    assert slowed.host.strain_steps is not None
    assert plain.host.strain_steps > 0.4 * plain.contour_steps.p999
    assert slowed.host.least_speed_percent <= 60
    assert slowed.host.strain_steps > 4.8
    assert slowed.contour_steps.p999 < plain.contour_steps.p999
    assert slowed.plan_time_s > 1.3 * plain.plan_time_s
    assert set(slowed.end_error_steps.values()) == {0}
    assert slowed.violations == {}


def test_stop_here_points_are_not_slowed_for_by_themselves(monkeypatch: pytest.MonkeyPatch) -> None:
    verdict = run(monkeypatch, "servo", "stop-here", None).verdict
    assert verdict is not None
    assert verdict.host is not None
    assert verdict.host.least_speed_percent == 100


@pytest.mark.parametrize(
    ("name", "counts", "profile"),
    [("mill3-servo", "", "smooth"), ("mill3-servo", "2000", "smooth"), ("mill3-step", "", "exact")],
)
def test_what_is_no_error_of_the_path_is_no_strain(name: str, counts: str, profile: str) -> None:
    text = read_machine(name).text
    text = re.sub(r'counts_per_unit = "[^"]*"', f"counts_per_unit = {counts}", text) if counts else text
    described = MachineFile(name, text, parse_machine(text, name))
    job = read_job(CIRCLES, Setup(file="c.nc"), described.config)
    result = perform(job, plan_job(job, described.config), described, RunOptions(port="sim", profile=profile))
    assert result.verdict is not None, result.fault
    assert result.verdict.host is not None
    assert result.verdict.contour_steps is not None
    assert result.verdict.host.least_speed_percent == 100
    assert result.verdict.host.strain_steps is not None
    assert result.verdict.host.strain_steps < result.verdict.contour_steps.max + 1.0


def test_the_axes_that_are_not_streamed_are_not_fitted_to_the_bus() -> None:
    described = read_machine("mill3-indexer").config
    config = slower(described, 0.01, speeds=False)
    for axis, table in described.axis.items():
        share = 1.0 if table.chip == "cy545" else 0.01
        assert config.axis[axis].max_acceleration == pytest.approx(share * table.max_acceleration)
