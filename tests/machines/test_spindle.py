"""The spindle's arithmetic, the rests that a program gets for it, and what is refused before anything moves."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcode.canon import ORIGIN, Dwell, Spindle
from gcode.errors import Diagnostic
from gcode.setup import Setup
from machines.job import Job, plan_job, planned_commands, read_job
from machines.load import parse_machine, read_machine
from machines.outputs import panel_of
from machines.outputs_plan import switch_rest_s
from machines.outputs_schema import SpindleTable
from machines.schema import MachineConfig
from machines.spindle import SpindleDrive, change_s, wanted_rpm
from nmc.budget import BusTiming
from nmc.chips import picservo
from nmc.codec import decode
from nmc.program import Evidence

MACHINE = read_machine("mill3-spindle")
TABLE = MACHINE.config.spindle
assert TABLE is not None
TIMING = BusTiming.at(115_200)


def job_of(text: str, config: MachineConfig = MACHINE.config) -> Job:
    return read_job(text, Setup(file="job.nc", start=ORIGIN), config)


def drive(table: SpindleTable = TABLE) -> SpindleDrive:
    return SpindleDrive(table, panel_of(MACHINE.config), 0, TIMING)


def dwells(text: str, config: MachineConfig = MACHINE.config) -> list[tuple[int, float]]:
    job = job_of(text, config)
    assert not job.errors
    return [(item.line, item.seconds) for item in planned_commands(job, config) if isinstance(item, Dwell)]


def test_the_plan_rests_in_proportion_to_the_change() -> None:
    # ramp_time 1 s from rest to 4000 rpm, settle_time 0.3 s
    text = "G21 G90\nM3 S1000\nG1 X5 F600\nS3000\nG1 X6\nM4\nM5\nM2\n"
    assert dwells(text) == [(2, 0.55), (4, 0.8), (6, pytest.approx(1.8)), (7, 1.05)]


def test_nothing_is_waited_for_where_nothing_changes() -> None:
    assert dwells("G21 G90\nM3 S1000\nG1 X5 F600\nM3\nS1000\nM5\nM5\nM2\n") == [(2, 0.55), (6, 0.55)]


def test_direction_and_speed_of_one_line_are_one_change() -> None:
    job = job_of("G21 G90\nM3 S1000\nG1 X5 F600\nM4 S2000\nM2\n")
    said = [item for item in planned_commands(job, MACHINE.config) if isinstance(item, Spindle)]
    assert [(item.line, item.direction * item.speed_rpm) for item in said] == [(2, 1000), (4, -2000), (5, 0)]


def test_what_is_switched_at_rest_gets_a_rest_and_what_belongs_to_a_motion_gets_none() -> None:
    rest_s = switch_rest_s(MACHINE.config)
    assert rest_s == 0.005
    text = "G21 G90\nM8\nG1 X5 F600\nM64 P0\nM62 P1\nM68 E0 Q5\nM67 E0 Q6\nG1 X6\nM65 P7\nM9\nM2\n"
    assert dwells(text) == [(2, rest_s), (4, rest_s), (6, rest_s), (10, rest_s)]


def test_a_slow_bus_needs_a_longer_rest() -> None:
    slow = parse_machine(MACHINE.text.replace("baud = 115200", "baud = 19200"), "m.toml")
    assert switch_rest_s(slow) == 0.019


def test_machines_without_outputs_plan_as_ever() -> None:
    config = read_machine("mill3-step").config
    job = job_of("G21 G90\nM3 S1000\nM8\nM64 P1\nG1 X5 F600\nM2\n", config)
    assert planned_commands(job, config) is job.commands
    assert plan_job(job, config, "kernel").report.dwell_s == 0


@given(x=st.floats(-100, 100), surface=st.floats(1, 5000), limit=st.floats(100, 9000))
def test_surface_speed_stays_within_all_limits(x: float, surface: float, limit: float) -> None:
    command = Spindle(1, 1, 0.0, "", surface, limit, 10.0)
    rpm = wanted_rpm(TABLE, command, x)
    exact = math.inf if x == 10.0 else surface / (2 * math.pi * abs(x - 10.0)) * 60
    assert rpm <= min(limit, TABLE.max_rpm) + 1e-9
    if TABLE.min_rpm <= exact <= min(limit, TABLE.max_rpm) and abs(x - 10.0) > 1e-3:
        assert rpm == pytest.approx(exact)


@given(rpm=st.floats(100, 4000), reverse=st.booleans())
def test_the_chip_is_told_the_speed_to_its_last_bit(rpm: float, reverse: bool) -> None:
    said = [each.make() for each in drive().change(-rpm if reverse else rpm)]
    values = decode(picservo.FACTS, said[-1].command, said[-1].data).values
    # PIC-SERVO data sheet, section 4.4: counts a tick of 512 us with 16 fractional bits; 400 counts a turn
    counts_s = values["velocity"] / 65536 / 512e-6
    assert counts_s / 400 * 60 == pytest.approx(rpm, abs=0.01)
    assert values["reverse"] == reverse
    assert (values["servo_mode"], values["velocity_mode"], values["start_now"]) == (1, 1, 1)
    # and its acceleration takes ramp_time to max_rpm
    assert 4000 / 60 * 400 * 512e-6 * 65536 / values["acceleration"] * 512e-6 == pytest.approx(1.0, rel=0.01)


def test_the_measured_speed_is_that_of_the_counts_even_where_the_counter_goes_round() -> None:
    spindle = drive()
    list(spindle.change(1500.0))
    poll = spindle.poll()
    reply_ns = TIMING.reply_ns(4)

    def answer(time_ns: int, counts: int) -> Evidence:
        return Evidence(poll, time_ns, time_ns + reply_ns, 0, counts.to_bytes(4, "little", signed=True))

    assert spindle.heard(answer(0, 0x7FFFFFFF - 199)) is None
    assert spindle.heard(answer(50_000_000, -0x80000000 + 300)) == pytest.approx(1500)
    assert spindle.off_by() == pytest.approx(0, abs=1e-9)


def test_pwm_is_linear_between_its_two_ends_and_ramps_through_zero() -> None:
    table = TABLE.model_copy(
        update={"drive": "pwm", "servo": None, "min_rpm": 500.0, "pwm_at_min": 40, "pwm_at_max": 240}
    )
    spindle = drive(table)
    assert [spindle.pwm_of(rpm) for rpm in (0, 500, -2250, 4000)] == [0, 40, 140, 240]
    list(spindle.change(2000.0))
    ramp = list(spindle.change(-2000.0))
    values = [decode(picservo.FACTS, exchange.command, exchange.data).values for exchange in (e.make() for e in ramp)]
    assert ramp[-1].after_ns < 1_000_000_000 == round(change_s(table, 2000, -2000) * 1e9) - 300_000_000
    signs = [value["reverse"] for value in values]
    assert signs == sorted(signs)
    assert values[-1]["pwm"] == spindle.pwm_of(2000)


def diagnostics(text: str, config: MachineConfig = MACHINE.config) -> list[tuple[str, int, int, str]]:
    found: tuple[Diagnostic, ...] = job_of(text, config).diagnostics
    return [(each.code, each.line, each.column, each.message) for each in found]


@pytest.mark.parametrize(
    ("line", "column", "words"),
    [
        ("M3 S9000", 4, "S9000: the spindle turns at 100 to 4000 rpm"),
        ("M3 S50", 4, "S50: the spindle turns at 100 to 4000 rpm"),
        ("M19 R0", 1, "M19: this spindle knows no angle"),
        ("M68 E0 Q101", 8, "Q101: analog output 0 goes from 0 to 100"),
    ],
)
def test_what_the_machine_cannot_do_is_refused_with_its_place(line: str, column: int, words: str) -> None:
    assert diagnostics(f"G21 G90\nG1 X1 F60\n{line}\nM2\n") == [("SP001", 3, column, words)]


def test_a_spindle_of_pins_turns_one_way_at_one_speed() -> None:
    text = MACHINE.text
    spindle = text[text.index("[spindle]") : text.index("[coolant]")]
    pins = '[spindle]\ndrive = "output"\nmax_rpm = 4000\nramp_time = 1\non = { module = "io", pin = "bit4" }\n'
    config = parse_machine(text.replace(spindle, pins).replace("address = 5", "address = 4"), "m.toml")
    found = diagnostics("G21 G90\nM4 S1000\nG96 S100 M3\nM2\n", config)
    assert [(code, line) for code, line, _, _ in found] == [("SP001", 2), ("SP001", 3)]
    assert {message for _, _, _, message in found} == {
        "M4: this spindle turns one way only",
        "G96: this spindle has one speed only",
    }


def test_what_nothing_answers_to_is_told_once_and_runs() -> None:
    text = "G21 G90\nM3 S1000\nM8\nM7\nM64 P3\nM3 S500\nM8\nM65 P3\nM67 E2 Q1\nG1 X1 F60\nM2\n"
    found = diagnostics(text, read_machine("mill3-step").config)
    assert [(code, line) for code, line, _, _ in found] == [("SP002", line) for line in (2, 3, 4, 5, 9)]
    assert not job_of(text, read_machine("mill3-step").config).errors


def test_surface_speed_is_warned_of_only_where_nothing_follows_it() -> None:
    text = "G21 G90\nG0 X40\nG96 S100 M3\nG1 X30 F60\nM2\n"
    assert diagnostics(text) == []
    assert [code for code, *_ in diagnostics(text, read_machine("mill3-step").config)] == ["GC203", "SP002"]


def test_surface_speed_knows_units_limit_and_the_middle_of_the_work() -> None:
    job = job_of("G20 G90\nG10 L2 P1 X1\nG54 G0 X2\nG96 D1500 S100 M3\nG97 S700\nG21 M2\n")
    said = [item for item in job.commands if isinstance(item, Spindle)]
    assert said[0].surface_mm_s == pytest.approx(100 * 304.8 / 60)  # ft/min
    assert (said[0].limit_rpm, said[0].axis_x_mm) == (1500, pytest.approx(25.4))
    after = said[-2]
    assert (after.surface_mm_s, after.speed_rpm, after.limit_rpm) == (0, 700, math.inf)


def test_g97_without_a_speed_takes_s_as_rpm_from_there() -> None:
    job = job_of("G21 G90\nG0 X40\nG96 S200 M3\nG97\nM2\n")
    said = [item for item in job.commands if isinstance(item, Spindle)]
    [last] = [item for item in said if item.line == 4]
    assert (last.surface_mm_s, last.speed_rpm) == (0, 200)
