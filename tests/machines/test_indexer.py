"""A machine with a CY545 axis on its twin: index moves between streams, confirmed, stopped, homed, across blocks."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gcode.setup import Setup
from groupstart.cli import main
from machines.cy545_homing import home_indexer
from machines.cy545_lines import LivingLink
from machines.cy545rates import read_rates
from machines.errors import MachineError
from machines.indexing import has_index_moves, stages_of
from machines.job import plan_job, read_job
from machines.load import MachineFile, parse_machine, read_machine
from machines.parts import parts_of
from machines.runner import RunOptions, RunResult, perform
from machines.session import Session, SessionError, State
from machines.wiring import indexers, planner_limits
from nmc.chips.cy545 import BLOCK
from nmc.cy545 import Cy545
from planner.cy545_plan import plan_indexed
from planner.plan import Plan
from sim.cy545_host import TextHost

PROGRAM = "G21 G90 G64 P0.01\nG0 X3 Y2\nG0 A30\nG1 X6 F600\nG0 A-15\nG0 X0 Y0\nM2\n"


@pytest.fixture(scope="module")
def machine() -> MachineFile:
    return read_machine("mill3-indexer")


def changed(machine: MachineFile, *changes: tuple[str, str]) -> MachineFile:
    text = machine.text
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return MachineFile(machine.origin, text, parse_machine(text, "changed.toml"))


def planned(machine: MachineFile, program: str = PROGRAM) -> tuple[Any, Plan]:
    job = read_job(program, Setup(file="job.nc"), machine.config)
    assert not job.errors, job.errors
    return job, plan_job(job, machine.config)


def run(machine: MachineFile, program: str = PROGRAM, **other: Any) -> RunResult:
    job, plan = planned(machine, program)
    return perform(job, plan, machine, RunOptions(port="sim"), **other)


def after(calls: int) -> Callable[[], bool]:
    """True from the given call on."""
    left = [calls]

    def asked() -> bool:
        left[0] -= 1
        return left[0] <= 0

    return asked


# -- a run -------------------------------------------------------------------------------------------------------------


def test_a_program_with_index_moves_is_good_to_the_step(machine: MachineFile) -> None:
    result = run(machine)
    verdict = result.verdict
    assert verdict is not None
    assert verdict.ok, verdict.reasons
    assert verdict.axes == ("X", "Y", "Z", "A")
    assert verdict.end_error_steps == {"X": 0, "Y": 0, "Z": 0, "A": 0}
    assert verdict.violations == {}
    assert verdict.sim_time_s == pytest.approx(verdict.plan_time_s, abs=0.01)
    assert verdict.peak["A"].velocity <= verdict.limits["A"].velocity
    assert result.outcome is not None
    assert result.outcome.positions["A"] == -15 * 40


def test_nothing_else_steps_while_the_indexer_does(machine: MachineFile) -> None:
    trace = run(machine).trace
    assert trace is not None
    turning = trace.pulses_ns("A")
    moves = np.split(turning, np.flatnonzero(np.diff(turning) > 1e8) + 1)
    assert [len(move) for move in moves] == [30 * 40, 45 * 40]
    others = np.concatenate([trace.pulses_ns(axis) for axis in "XYZ"])
    for move in moves:
        quiet = (others > move[0] - 50e6) & (others < move[-1] + 50e6)
        assert not quiet.any()


def test_the_same_seed_gives_the_same_bytes_and_pulses(machine: MachineFile) -> None:
    one, two = run(machine).trace, run(machine).trace
    assert one is not None and two is not None  # noqa: PT018
    assert one.bus_ns.tolist() == two.bus_ns.tolist()
    assert one.run_first_ns.tolist() == two.run_first_ns.tolist()


def test_the_chips_line_is_in_the_trace(machine: MachineFile) -> None:
    trace = run(machine).trace
    assert trace is not None
    said = bytes(trace.bus_byte[trace.bus_line == 2])  # the second bus, from the host
    assert said.startswith(b"\r\r?P\rI\r?P\r")
    assert b"P 1200\r?P\r" in said
    assert b"N 1800\r-\rG\r?P\r" in said  # from 30 to -15 degrees: into the block below
    answers = bytes(trace.bus_byte[trace.bus_line == 3])
    assert answers.endswith(b"P=00001200\rP=16776616\r" + answers[-11:])


def test_a_program_without_index_moves_runs_as_on_any_machine(machine: MachineFile) -> None:
    _, plan = planned(machine, "G21\nG0 X3\nX0\nM2\n")
    assert not has_index_moves(plan.trajectory)
    result = run(machine, "G21\nG0 X3\nX0\nM2\n")
    assert result.verdict is not None
    assert result.verdict.ok


def test_a_program_that_only_indexes_runs(machine: MachineFile) -> None:
    result = run(machine, "G21\nG0 A10\nG0 A20\nG1 A0 F3000\nM2\n")
    assert result.verdict is not None
    assert result.verdict.ok, result.verdict.reasons


def test_a_part_of_a_program_keeps_its_index_moves(machine: MachineFile) -> None:
    """On a port a program is run part by part, with a wait before each."""
    _, plan = planned(machine, PROGRAM.replace("G1 X6 F600\n", "M0\nG1 X6 F600\n"))
    parts = list(parts_of(plan.trajectory))
    assert len(parts) == 2
    found = [[stage.index is not None for stage in stages_of(part)] for part in parts]
    assert found == [[False, True], [False, True, False]]
    with Session(machine.config, port="sim") as session:
        session.connect()
        for part in parts:
            outcome = session.run(part)
        assert outcome.positions == {"X": 0, "Y": 0, "Z": 0, "A": -600}


# -- blocks ------------------------------------------------------------------------------------------------------------


def test_a_job_that_crosses_the_block_ends_at_the_right_angle(machine: MachineFile) -> None:
    result = run(machine, "G21\nG0 A-90\nG0 A45\nG0 A-1\nG0 A0.5\nM2\n")
    assert result.verdict is not None
    assert result.verdict.ok, result.verdict.reasons
    assert result.outcome is not None
    assert result.outcome.positions["A"] == 20


def test_more_than_sixteen_million_steps_end_at_the_right_angle(machine: MachineFile) -> None:
    """170 degrees of 100,000 steps each are a whole block and 222,784 steps more."""
    fine = changed(
        machine,
        ('steps_per_unit = "400 * 36 / 360"', "steps_per_unit = 100_000"),
        ("max_velocity = 90 ", "max_velocity = 0.2 "),
        ("max_acceleration = 400 ", "max_acceleration = 1 "),
        ("pull_in_velocity = 8 ", "pull_in_velocity = 0.02 "),
    )
    _, plan = planned(fine, "G21\nG0 A170\nM2\n")
    with Session(fine.config, port="sim", seed=3) as session:
        session.connect()
        outcome = session.run(plan.trajectory)
        chip = session.simulation.indexers["A"]  # type: ignore[union-attr]
        assert outcome.positions["A"] == 17_000_000
        assert chip.mechanical == 17_000_000
        assert chip.register == 17_000_000 % BLOCK
        assert session.simulation.violations == []  # type: ignore[union-attr]


# -- when things go wrong ----------------------------------------------------------------------------------------------


def test_a_stop_on_the_way_stops_the_indexer_too(machine: MachineFile) -> None:
    result = run(machine, "G21\nG0 A360\nG0 X5\nM2\n", stop_requested=after(30))
    assert result.verdict is None
    assert "stopped on request" in result.fault
    assert result.outcome is not None
    stands = result.outcome.positions["A"]
    assert 0 < stands < 360 * 40
    assert result.trace is not None
    assert len(result.trace.pulses_ns("A")) == stands
    assert len(result.trace.pulses_ns("X")) == 0
    assert result.violations == ()


def test_without_a_line_to_stop_it_the_move_ends_and_then_all_stands(machine: MachineFile) -> None:
    table = machine.text[machine.text.index("[axis.A.home]") : machine.text.index("# What the simulated machine adds")]
    loose = changed(machine, ('abort_line = "rts" ', 'abort_line = "none" '), (table, ""))
    result = run(loose, "G21\nG0 A90\nG0 X5\nM2\n", stop_requested=after(30))
    assert result.outcome is not None
    assert not result.outcome.finished
    assert result.outcome.positions["A"] == 3600
    assert result.outcome.positions["X"] == 0
    assert result.violations == ()


def test_a_chip_that_is_held_up_is_found_out_and_nothing_else_moves(machine: MachineFile) -> None:
    """Somebody pulls INHIBIT_ABORT in the middle of an index move."""
    _, plan = planned(machine, "G21\nG0 A90\nG0 X5\nM2\n")
    with Session(machine.config, port="sim") as session:
        session.connect()
        simulation = session.simulation
        assert simulation is not None
        chip = simulation.indexers["A"]
        simulation.world.call_at(simulation.world.now_ns + 800_000_000, lambda: chip.set_abort(True))
        with pytest.raises(SessionError, match=r"stands at .* not at 3600") as failed:
            session.run(plan.trajectory)
        assert session.state is State.FAULTED
        assert failed.value.positions is not None
        assert 0 < failed.value.positions["A"] < 3600
        assert len(simulation.trace().pulses_ns("X")) == 0


def test_a_host_that_is_late_costs_time_and_no_place(machine: MachineFile) -> None:
    job = read_job(PROGRAM, Setup(file="job.nc"), machine.config)
    hasty = [replace(indexer, before_s=0.001, after_s=0.001) for indexer in indexers(machine.config)]
    plan = plan_indexed(job.commands, planner_limits(machine.config), hasty, start=np.zeros(4))
    with Session(machine.config, port="sim") as session:
        session.connect()
        outcome = session.run(plan.trajectory)
        assert outcome.positions == {"X": 0, "Y": 0, "Z": 0, "A": -600}
        assert session.simulation.violations == []  # type: ignore[union-attr]
        took_s = (outcome.end_ns - outcome.plan_start_ns) * 1e-9
        assert took_s > plan.trajectory.duration_s + 0.1
        assert outcome.statistics.late_slices >= 2


class Watched:
    """Another port of the machine, whose watchdog wants to hear of its host."""

    def __init__(self, link: Any) -> None:
        self.link = link
        self.beats_ns: list[int] = []

    def now_ns(self) -> int:
        return int(self.link.now_ns())

    def sleep_until(self, _time_ns: int) -> None:
        self.beats_ns.append(self.now_ns())


def test_waiting_for_the_chip_shows_the_other_ports_that_the_host_lives() -> None:
    host = TextHost(read_rates("stand-in"))
    other = Watched(host.link)
    link = LivingLink(host.link, [other])  # type: ignore[list-item]
    driver = Cy545(link, host.link)
    driver.start_up()
    driver.set_rates(14, 60, 200)
    driver.move_to(3000, 3_000_000_000)
    gaps = np.diff(other.beats_ns)
    assert gaps.max() <= 5_000_000
    assert other.beats_ns[-1] > 3e9
    assert host.sim.violations == []


# -- homing ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("start_at", [0.0, -20.0, 31.7])
def test_homing_finds_the_edge_to_the_step_and_ends_at_zero(machine: MachineFile, start_at: float) -> None:
    """The switch is closed at and below -15 degrees; from above its edge is the step -600 of the mechanics."""
    placed = changed(machine, ("home_at = -15", f"home_at = -15\nstart_at = {start_at}"))
    with Session(placed.config, port="sim") as session:
        session.connect()
        (homed,) = session.home(["A"])
        chip = session.simulation.indexers["A"]  # type: ignore[union-attr]
        assert chip.mechanical == 0
        assert chip.register == 0
        assert homed.edge_steps == -600 - round(start_at * 40)
        assert session.where()["A"] == 0
        assert abs(homed.spread_steps) < 60
        assert session.simulation.violations == []  # type: ignore[union-attr]


def test_a_switch_that_is_not_there_is_told_and_the_axis_stands(machine: MachineFile) -> None:
    short = changed(machine, ("[sim.axis.A]\nhome_at = -15\n", ""), ("travel = [-3600, 3600]", "travel = [-20, 20]"))
    with Session(short.config, port="sim") as session:
        session.connect()
        with pytest.raises(SessionError, match="home switch not found"):
            session.home(["A"])
        chip = session.simulation.indexers["A"]  # type: ignore[union-attr]
        assert not chip.busy


def test_homing_without_a_table_is_refused(machine: MachineFile) -> None:
    table = machine.config.axis["A"].model_copy(update={"home": None})
    with pytest.raises(ValueError, match=r"no \[axis.A.home\]"):
        home_indexer("A", table, indexers(machine.config)[0], None)  # type: ignore[arg-type]


# -- machine files -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('bus = "indexer"', 'bus = "main"', "a CY545 needs a serial line of its own"),
        ('rate_table = "stand-in"', 'rate_table = "nowhere.csv"', "nowhere.csv: No such file"),
        ('abort_line = "rts" ', 'abort_line = "none" ', "homing a CY545 needs abort_line"),
        ('home_line = "dsr"', "", "homing a CY545 needs home_line"),
        ('abort_line = "rts" ', 'abort_line = "cts" ', "abort_line"),
        ("baud = 9600", "baud = 300", "baud 300"),
    ],
)
def test_mistakes_of_the_axis_are_told(machine: MachineFile, old: str, new: str, told: str) -> None:
    with pytest.raises(MachineError) as wrong:
        changed(machine, (old, new))
    assert told in str(wrong.value)


def test_a_rate_table_is_looked_for_beside_the_machine_file(machine: MachineFile, tmp_path: Any) -> None:
    rows = "\n".join(f"{k},{100 + 10 * k}" for k in range(256))
    (tmp_path / "mine.csv").write_text(f"rate,steps_per_s_12mhz\n{rows}\n")
    text = machine.text.replace('rate_table = "stand-in"', 'rate_table = "mine.csv"')
    (tmp_path / "mine.toml").write_text(text)
    found = read_machine(str(tmp_path / "mine.toml"))
    (indexer,) = indexers(found.config)
    assert indexer.rates.steps_per_s[255] == 2650
    assert not indexer.rates.stand_in
    (tmp_path / "mine.csv").write_text("rate,steps_per_s_12mhz\n0,5\n1,4\n")
    with pytest.raises(MachineError, match=r"mine.csv:3: the rates must be above 0 and ascend"):
        read_machine(str(tmp_path / "mine.toml"))


# -- the front door ----------------------------------------------------------------------------------------------------


def command(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as leaving:
        main(arguments)
    captured = capsys.readouterr()
    assert isinstance(leaving.value.code, int)
    return leaving.value.code, captured.out, captured.err


@pytest.mark.parametrize("verb", ["check", "plan", "verify", "run"])
def test_interpolation_exits_1_with_line_column_and_two_ways_out(
    verb: str, tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.nc").write_text("G21 G90\nG0 X5\nG1 X10 A45 F100\nM2\n")
    status, out, err = command(capsys, verb, str(tmp_path / "bad.nc"), "-m", "mill3-indexer")
    assert status == 1
    told = out + err
    assert "bad.nc:3:8: error PL001: axis A is on a CY545, which cannot be interpolated with X" in told
    assert "hint: split the move" in told
    assert "put the axis on an NMC chip" in told


def test_the_stand_in_is_told_whenever_it_is_used(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "turn.nc").write_text("G21 G90\nG0 A5\nM2\n")
    for verb in ("plan", "verify"):
        status, _, err = command(capsys, verb, str(tmp_path / "turn.nc"), "-m", "mill3-indexer")
        assert status == 0
        assert "cy545_rates_standin.csv is a stand-in" in err


def test_the_verbs_by_hand_take_the_indexer(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = command(capsys, "jog", "A+7.5", "-m", "mill3-indexer")
    assert status == 0
    assert "A7.5000" in out
    assert command(capsys, "home", "A", "-m", "mill3-indexer")[0] == 0
    status, out, _ = command(capsys, "scan", "-m", "mill3-indexer")
    assert status == 0
    assert "bus indexer: a CY545 at 9600 baud, axis A, position register 0" in out
    status, out, _ = command(capsys, "scan", "-m", "mill3-indexer", "--json")
    assert json.loads(out.splitlines()[1])["modules"] == [{"chip": "cy545", "axis": "A", "position": 0}]
    status, _, err = command(capsys, "reset", "-m", "mill3-indexer")
    assert status == 0
    assert "axis A: CY545 reset" in err


def test_the_report_of_a_run_has_the_indexer_in_it(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "job.nc").write_text(PROGRAM)
    page, trace = tmp_path / "report.html", tmp_path / "trace.npz"
    places = ["--report", str(page), "--trace", str(trace)]
    status, _, err = command(capsys, "verify", str(tmp_path / "job.nc"), "-m", "mill3-indexer", *places)
    assert status == 0, err
    assert page.stat().st_size > 10_000
    status, out, _ = command(capsys, "dump", str(trace), "--bus", "1", "--chip", "cy545")
    assert status == 0
    assert "position 1200" in out
