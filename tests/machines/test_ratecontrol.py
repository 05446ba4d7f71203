"""Hold, resume, override and a slow host, from a script through the whole session on the twin."""

from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pytest

from gcode.canon import ORIGIN
from gcode.setup import Setup
from machines.control import Control, Script
from machines.job import Job, plan_job, read_job
from machines.load import MachineFile, parse_machine, read_machine
from machines.runner import RunOptions, RunResult, perform
from machines.wiring import every_motor, scale_of
from planner.plan import Plan

PROGRAM = """G21 G90 G64 P0.01 F1800
G0 X5 Y5
G1 X30 Y10
G3 X30 Y40 I0 J15
G4 P0.3
G1 X8 Y35 Z1
G1 X5 Y5 Z0
G0 X0 Y0
M2
"""


@dataclass
class Journal:
    """What the session noted."""

    lines: list[tuple[str, int, dict[str, Any]]] = field(default_factory=list)

    def __call__(self, event: str, time_ns: int, **fields: Any) -> None:
        self.lines.append((event, time_ns, fields))

    def of(self, event: str) -> list[tuple[int, dict[str, Any]]]:
        return [(time_ns, fields) for name, time_ns, fields in self.lines if name == event]


@cache
def planned(name: str, text: str = PROGRAM) -> tuple[MachineFile, Job, Plan]:
    machine = read_machine(name)
    job = read_job(text, Setup(file="job.nc", start=ORIGIN), machine.config)
    assert not job.errors
    return machine, job, plan_job(job, machine.config, "kernel")


def run(
    name: str, lines: list[tuple[float, str]], profile: str = "auto", text: str = PROGRAM
) -> tuple[RunResult, Journal]:
    machine, job, plan = planned(name, text)
    journal = Journal()
    result = perform(job, plan, machine, RunOptions(profile=profile, control=Script(lines)), note=journal)
    return result, journal


@pytest.mark.parametrize(
    ("name", "profile", "steps"),
    [
        ("mill3-step", "adaptive", 3.0),
        ("mill3-step", "group", 4.5),
        ("mill3-step", "exact", 3.0),
        ("mill3-servo", "smooth", 5.0),
        ("mill3-servo", "stop-here", 35.0),
        ("mill3-mixed", "auto", 5.0),
        ("gantry4-step", "auto", 3.5),
    ],
)
def test_held_overridden_and_resumed_the_run_is_judged_by_the_times_that_held(
    name: str, profile: str, steps: float
) -> None:
    lines = [(0.5, "hold"), (1.2, "resume"), (1.5, "feed 50"), (2.5, "feed 120"), (3.0, "rapid 50"), (3.4, "hold")]
    result, journal = run(name, [*lines, (4.0, "resume")], profile)
    verdict, outcome = result.verdict, result.outcome
    assert verdict is not None
    assert outcome is not None
    assert set(verdict.end_error_steps.values()) == {0}
    assert verdict.violations == {}
    assert verdict.contour_steps is not None
    assert verdict.contour_steps.max <= steps
    assert verdict.sim_time_s == pytest.approx(verdict.plan_time_s, abs=0.05)
    assert verdict.plan_time_s > planned(name)[2].trajectory.duration_s + 1.0
    assert [fields["state"] for _, fields in journal.of("state")] == [
        "running",
        "held",
        "running",
        "held",
        "running",
        "idle",
    ]
    assert [(f["feed_percent"], f["rapid_percent"]) for _, f in journal.of("override")] == [
        (50, 100),
        (120, 100),
        (120, 50),
    ]
    assert len(verdict.holds) == 2


@pytest.mark.parametrize("at_s", [0.42, 0.81, 1.4, 2.2, 3.7, 4.4])
def test_a_hold_rests_when_and_where_it_was_announced(at_s: float) -> None:
    result, journal = run("mill3-step", [(at_s, "hold"), (at_s + 1.0, "resume")])
    assert result.outcome is not None
    assert result.trace is not None
    [hold] = result.outcome.holds
    assert hold.measured_s is not None
    assert hold.off_mm is not None
    assert hold.off_mm < 0.008  # 1.5 steps of 5 um
    asked_ns, _ = journal.of("hold")[0]
    known_ns, held = journal.of("held")[0]
    last = result.trace.run_first_ns + (result.trace.run_count - 1) * result.trace.run_period_ns
    rested_s = (last[last < known_ns].max() - asked_ns) * 1e-9
    assert rested_s <= hold.announced_s + 0.012
    assert not ((last > known_ns) & (last < known_ns + 0.5e9)).any()
    assert hold.measured_s <= hold.announced_s + 0.12
    trace, motors = result.trace, every_motor(planned("mill3-step")[0].config)
    places = {motor.name: held["places"][motor.axis] * scale_of(motor) for motor in motors}
    steps = trace.start_steps.astype(float)
    np.add.at(steps, trace.run_axis, trace.run_count * trace.run_dir * (last < known_ns))
    assert dict(zip(trace.axes, steps, strict=True)) == pytest.approx(places)


def test_a_hold_in_a_dwell_keeps_what_is_left_of_it_and_nothing_departs() -> None:
    text = "G21 G90 F1200\nG1 X5\nG4 P2\nG1 X10\nM2\n"
    result, journal = run("mill3-step", [(1.0, "hold"), (6.0, "resume")], text=text)
    assert result.verdict is not None
    assert result.verdict.ok
    whole_s = planned("mill3-step", text)[2].trajectory.duration_s
    held_s = (journal.of("resume")[0][0] - journal.of("hold")[0][0]) * 1e-9
    setting_out_s = 0.04  # an idle moment of 20 ms ends; three axes are loaded and started
    assert result.verdict.plan_time_s == pytest.approx(whole_s + held_s + setting_out_s, abs=0.02)
    assert result.trace is not None
    first = result.trace.run_first_ns
    assert not ((first > journal.of("held")[0][0]) & (first < journal.of("resume")[0][0])).any()


def test_a_hold_before_anything_moves() -> None:
    result, _ = run("mill3-step", [(-1.0, "hold"), (2.0, "resume")])
    assert result.verdict is not None
    assert result.verdict.ok


def test_what_is_asked_twice_or_out_of_turn_changes_nothing() -> None:
    plain, _ = run("mill3-step", [])
    result, journal = run("mill3-step", [(0.5, "resume"), (0.6, "feed 100"), (0.7, "rapid 100")])
    assert result.outcome is not None
    assert plain.outcome is not None
    assert not result.outcome.retimed
    assert result.outcome.statistics.packets == plain.outcome.statistics.packets
    assert journal.of("override") == []


def test_a_stop_in_a_hold_ends_the_program() -> None:
    result, journal = run("mill3-step", [(0.5, "hold"), (1.5, "stop")])
    assert "stopped on request" in result.fault
    assert journal.of("state")[-1][1]["state"] == "stopped"


def test_where_the_program_forbids_overrides_the_feed_stays() -> None:
    fixed = PROGRAM.replace("G1 X30 Y10", "M49\nG1 X30 Y10")
    whole_s = planned("mill3-step", fixed)[2].trajectory.duration_s
    result, _ = run("mill3-step", [(0.0, "feed 40")], text=fixed)
    assert result.verdict is not None
    assert result.verdict.ok
    assert result.verdict.plan_time_s == pytest.approx(whole_s, abs=0.15)


def test_a_program_with_index_moves_says_that_it_cannot_be_held() -> None:
    text = "G21 G90 F900\nG1 X3\nG0 A90\nG1 X6\nM2\n"
    control = Control()
    control.hold()
    machine, job, plan = planned("mill3-indexer", text)
    journal = Journal()
    result = perform(job, plan, machine, RunOptions(control=control), note=journal)
    assert result.verdict is not None
    assert result.verdict.ok
    assert "index moves" in journal.of("refused")[0][1]["message"]
    assert "index moves" in control.status.refused


def test_random_requests_end_exact() -> None:
    for seed in range(6):
        dice = np.random.default_rng(seed)
        now, lines, held = 0.0, [], False
        while now < 4.0 or held:
            now += float(dice.exponential(0.25))
            if held:
                lines.append((now, "resume"))
            elif dice.random() < 0.5:
                lines.append((now, "hold"))
            else:
                lines.append((now, f"feed {dice.integers(20, 150)}"))
                continue
            held = not held
        result, _ = run("mill3-step", lines)
        assert result.verdict is not None, result.fault
        assert set(result.verdict.end_error_steps.values()) == {0}
        assert result.verdict.violations == {}
        assert result.verdict.contour_steps is not None
        assert result.verdict.contour_steps.max <= 4.5, lines


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([(0.0, "hold")], "never resumes"),
        ([(1.0, "hold"), (0.5, "resume")], "ascend"),
        ([(0.0, "jump")], "no request"),
        ([(0.0, "feed")], "percentage"),
        ([(0.0, "feed 300")], "1 to 200"),
        ([(0.0, "rapid 120")], "1 to 100"),
        ([(0.0, "hold 5")], "no request"),
    ],
)
def test_a_script_that_makes_no_sense_is_refused(lines: list[tuple[float, str]], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Script(lines)


# --- a host that is slower than its machine file says ---------------------------------------------------------------


def slow_host(assumed_ms: float, real_ms: float, chips: str = "mill3-step") -> MachineFile:
    text = read_machine(chips).text
    text = text.replace("host_jitter_ms = 0.2", f"host_jitter_ms = {real_ms}")
    text = text.replace("[bus.main]\n", f"[bus.main]\nhost_jitter_ms = {assumed_ms}\n")
    return MachineFile("slow.toml", text, parse_machine(text, "slow.toml"))


@pytest.mark.parametrize("real_ms", [1.0, 2.0, 4.0])
def test_a_host_slower_than_assumed_slows_the_motion_and_not_the_truth(real_ms: float) -> None:
    machine = slow_host(0.2, real_ms)
    _, job, plan = planned("mill3-step")
    journal = Journal()
    result = perform(job, plan, machine, RunOptions(), note=journal)
    verdict = result.verdict
    assert verdict is not None, result.fault
    assert set(verdict.end_error_steps.values()) == {0}
    assert verdict.violations == {}
    assert verdict.late_slices == 0
    assert verdict.host is not None
    assert 40 < verdict.host.least_speed_percent <= 80
    assert verdict.host.delay_max_ms > 0.8 * real_ms
    assert verdict.contour_steps is not None
    assert verdict.contour_steps.max <= 4.0
    assert verdict.plan_time_s > plan.trajectory.duration_s
    first_ns, said = journal.of("host_delays")[0]
    begins_ns = journal.of("run_begins")[0][1]["plan_start_ns"]
    assert first_ns < begins_ns + 150_000_000  # before it has got fast
    assert said["speed_percent"] < 100


def test_a_host_as_assumed_is_left_alone() -> None:
    machine = slow_host(2.0, 2.0)
    _, job, plan = planned("mill3-step")
    result = perform(job, plan, machine, RunOptions())
    assert result.outcome is not None
    assert not result.outcome.retimed
    assert result.outcome.statistics.least_speed == 1.0


@pytest.mark.parametrize("profile", ["group", "adaptive", "exact"])
def test_a_host_as_assumed_is_never_found_slow(profile: str) -> None:
    verdict = run("mill3-step", [], profile)[0].verdict
    assert verdict is not None
    assert verdict.host is not None
    assert (verdict.host.late_exchanges, verdict.host.least_speed_percent) == (0, 100.0)
    assert verdict.contour_steps is not None
    assert verdict.contour_steps.max <= 6


INDEXED = "G21 G90 G64 P0.02\nG1 F900 X8 Y5 Z2\nG0 A90\nG1 X2 Y9 Z4\nG1 X6 Y1 Z0\nG0 A0\nM2\n"


def indexed(real_ms: float, control: Script | None = None) -> tuple[RunResult, Journal]:
    machine = slow_host(0.2, real_ms, "mill3-indexer")
    job = read_job(INDEXED, Setup(file="i.nc"), machine.config)
    journal = Journal()
    result = perform(job, plan_job(job, machine.config), machine, RunOptions(seed=3, control=control), note=journal)
    return result, journal


@pytest.mark.parametrize("real_ms", [2.0, 5.0])
def test_a_program_with_index_moves_cannot_be_slowed_but_knows_its_host(real_ms: float) -> None:
    result, journal = indexed(real_ms)
    assert result.fault == ""
    assert result.verdict is not None
    assert set(result.verdict.end_error_steps.values()) == {0}
    assert "cannot be slowed" in " ".join(result.verdict.reasons)
    assert {said["speed_percent"] for _, said in journal.of("host_delays")} == {100}


def test_a_program_with_index_moves_refuses_a_hold_and_says_so() -> None:
    _, journal = indexed(0.2, Script([(0.2, "hold"), (0.3, "resume"), (0.4, "feed 50")]))
    assert [said["message"] for _, said in journal.of("refused")] == [
        "a program with index moves cannot be held or overridden, only stopped"
    ] * 3
