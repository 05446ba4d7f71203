"""Machines whose motors are on several buses: as good as one bus, and what goes wrong on one bus stops all."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcode.setup import Setup
from machines import bringup
from machines.control import Script
from machines.job import Job, plan_job, read_job
from machines.load import MachineFile, read_machine
from machines.runner import RunOptions, RunResult, perform
from machines.session import Session, SessionError, State
from nmc.bus import Bus
from nmc.errors import LinkTimeout
from nmc.program import Evidence
from planner.plan import Plan
from planner.retime import RetimablePlan
from sim.build import Simulation
from sim.trace import Trace

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """G21 G90 G64 P0.01
G0 X20 Y10 Z5
G1 Z-2 F600
G1 X40 Y30 Z-1 F2400
G3 X20 Y50 Z1 I-20 J0
G1 X0 Z-1
Y0
G0 Z5
M2
"""
Prepared = tuple[MachineFile, Job, Plan]


def prepared(machine: MachineFile, program: str = PROGRAM) -> Prepared:
    job = read_job(program, Setup(file="job.nc"), machine.config)
    assert not job.errors
    return machine, job, plan_job(job, machine.config)


def moved(name: str, folder: Path, *moves: tuple[str, str, int]) -> MachineFile:
    """A shipped machine with a second bus; moves: section, and its new bus and address."""
    text = read_machine(name).text
    for section, bus, address in moves:
        head, body = text.split(f"[{section}]\n", 1)
        lines = body.split("\n")
        at = next(n for n, line in enumerate(lines) if line.startswith("bus ="))
        lines[at : at + 2] = [f'bus = "{bus}"', f"address = {address}"]
        text = f"{head}[{section}]\n" + "\n".join(lines)
    extra = "".join(f'[bus.{bus}]\nport = "sim"\nbaud = 115200\n\n' for bus in dict.fromkeys(m[1] for m in moves))
    path = folder / "several.toml"
    path.write_text(text.replace("[axis.X]\n", extra + "[axis.X]\n", 1))
    return read_machine(str(path))


def many(axes: str, buses: int, folder: Path) -> MachineFile:
    """PIC-STEP axes dealt out to buses in turn."""
    text = '[machine]\nname = "many"\nkinematics = "cartesian"\npath_tolerance = 0.01\n'
    text += "".join(f'[bus.b{n}]\nport = "sim"\nbaud = 115200\n' for n in range(buses))
    for n, axis in enumerate(axes):
        text += f'[axis.{axis}]\nchip = "pic-step"\nbus = "b{n % buses}"\naddress = {n // buses + 1}\n'
        text += "steps_per_unit = 200\nmax_velocity = 40\nmax_acceleration = 300\ntravel = [-50, 50]\n"
    text += '[sim]\nseed = 1\nhost_jitter_ms = 0.2\ncrystal_ppm = 100\ncount_latch = "rollover"\n'
    path = folder / "many.toml"
    path.write_text(text)
    return read_machine(str(path))


def run(ready: Prepared, **options: Any) -> RunResult:
    machine, job, plan = ready
    return perform(job, plan, machine, RunOptions(**options))


def good(result: RunResult) -> None:
    assert result.fault == ""
    assert result.verdict is not None
    assert result.verdict.ok, result.verdict.reasons
    assert set(result.verdict.end_error_steps.values()) == {0}
    assert result.violations == ()


def column(trace: Trace, name: str, at_ns: np.ndarray) -> np.ndarray:
    """Position of a stepper in steps at given times."""
    pulses = trace.pulses_ns(name)
    mine = trace.run_axis == trace.axes.index(name)
    signs = np.repeat(trace.run_dir[mine].astype(int), trace.run_count[mine])
    order = np.argsort(pulses, kind="stable")
    places = np.concatenate([[0], np.cumsum(signs[order])])
    return np.asarray(places[np.searchsorted(pulses[order], at_ns, side="right")])


def racking(result: RunResult) -> int:
    """How far the two motors of a gantry were apart at most, in steps."""
    assert result.trace is not None
    at_ns = np.sort(np.concatenate([result.trace.pulses_ns(name) for name in ("Y", "Y2")]))
    return int(np.abs(column(result.trace, "Y", at_ns) - column(result.trace, "Y2", at_ns)).max())


def after(calls: int) -> Callable[[], bool]:
    left = [calls]

    def asked() -> bool:
        left[0] -= 1
        return left[0] <= 0

    return asked


@pytest.fixture(scope="module")
def gantry() -> Prepared:
    return prepared(read_machine("gantry4-twobus"))


def test_a_gantry_split_over_two_buses_is_nearer_the_path_than_on_one(gantry: Prepared) -> None:
    split, single = run(gantry), run(prepared(read_machine("gantry4-step")))
    good(split)
    good(single)
    assert split.verdict is not None
    assert single.verdict is not None
    assert split.verdict.contour_steps is not None
    assert single.verdict.contour_steps is not None
    assert split.verdict.contour_steps.p999 <= single.verdict.contour_steps.p999
    assert split.verdict.bus.utilisation < single.verdict.bus.utilisation < 1.0
    assert racking(split) <= 3
    assert split.trace is not None
    assert set(split.trace.bus_line.tolist()) == {0, 1, 2, 3}


@pytest.mark.parametrize("profile", ["auto", "group", "exact"])
def test_every_profile_on_two_buses(profile: str, gantry: Prepared) -> None:
    result = run(gantry, profile=profile, seed=4)
    assert result.fault == ""
    assert result.verdict is not None
    assert set(result.verdict.end_error_steps.values()) == {0}
    assert result.violations == ()


@pytest.mark.parametrize("profile", ["auto", "smooth", "stop-here"])
def test_servos_on_one_bus_steppers_on_the_other(profile: str, tmp_path: Path) -> None:
    machine = moved("mill3-mixed", tmp_path, ("axis.Z", "second", 1))
    notes: list[dict[str, Any]] = []
    _, job, plan = prepared(machine)
    result = perform(
        job,
        plan,
        machine,
        RunOptions(profile=profile),
        note=lambda event, _time_ns, **fields: notes.append({"event": event, **fields}),
    )
    assert result.fault == ""
    assert result.violations == ()
    assert result.verdict is not None
    assert set(result.verdict.end_error_steps.values()) == {0}
    chosen = {note["bus"]: note["profile"] for note in notes if note["event"] == "profile"}
    assert chosen == {"main": "stop-here" if profile == "stop-here" else "smooth", "second": "adaptive"}


@pytest.mark.parametrize(("axes", "buses"), [("X", 1), ("XY", 2), ("XYZAB", 2), ("XYZABCUV", 2), ("XYZABCUV", 4)])
def test_one_to_eight_axes(axes: str, buses: int, tmp_path: Path) -> None:
    words = " ".join(f"{axis}{5 + 2 * n}" for n, axis in enumerate(axes))
    back = " ".join(f"{axis}{-n}" for n, axis in enumerate(axes))
    program = f"G21 G90 G94 G64 P0.01\nG1 {words} F900\nG1 {back}\nG1 {words}\nM2\n"
    result = run(prepared(many(axes, buses, tmp_path), program))
    good(result)
    assert result.outcome is not None
    assert len(result.outcome.positions) == len(axes)


def test_the_journal_tells_how_far_apart_the_buses_set_out(gantry: Prepared) -> None:
    machine, job, plan = gantry
    starts: list[dict[str, Any]] = []

    def note(event: str, _time_ns: int, **fields: Any) -> None:
        if event == "bus_starts":
            starts.append(fields)

    perform(job, plan, machine, RunOptions(), note=note)
    assert len(starts) == 1
    assert starts[0]["motions"] >= 1
    assert 0 <= starts[0]["skew_ms"] < 0.5


def test_hold_resume_and_override_of_both_buses(gantry: Prepared) -> None:
    asked = [(0.4, "hold"), (1.2, "resume"), (2.0, "feed 40"), (3.0, "feed 150"), (3.6, "hold"), (4.5, "resume")]
    result = run(gantry, control=Script(asked))
    good(result)
    assert result.outcome is not None
    holds = result.outcome.holds
    assert len(holds) == 2
    assert all(hold.measured_s is not None and hold.off_mm is not None and hold.off_mm < 0.02 for hold in holds)
    assert racking(result) <= 4


def test_a_host_that_is_slower_than_assumed_slows_all_buses(gantry: Prepared, tmp_path: Path) -> None:
    text = gantry[0].text.replace("baud = 115200", "baud = 115200\nhost_jitter_ms = 0.1", 1)
    path = tmp_path / "slow.toml"
    path.write_text(text.replace("\nhost_jitter_ms = 0.2", "\nhost_jitter_ms = 3"))
    machine, job, plan = prepared(read_machine(str(path)))
    result = perform(job, plan, machine, RunOptions())
    assert result.fault == ""
    assert result.violations == ()
    assert result.outcome is not None
    assert result.outcome.statistics.least_speed < 1
    assert set(result.outcome.positions.values()) == {0, 1000}


@pytest.mark.parametrize("exchanges", [1, 2, 3, 40, 41, 400, 1200])
def test_a_stop_request_stops_both_buses(exchanges: int, gantry: Prepared) -> None:
    machine, _, plan = gantry
    with Session(machine.config) as session:
        session.connect()
        outcome = session.run(plan.trajectory, stop_requested=after(exchanges))
        assert session.state is State.STOPPED
        assert session.simulation is not None
        stands(session.simulation, outcome.positions)


def stands(simulation: Simulation, positions: dict[str, int]) -> None:
    """Nothing moves any more, and the counters are where the pulses ended."""
    end_ns = simulation.world.now_ns
    simulation.links[0].sleep_until(end_ns + 2_000_000_000)
    trace = simulation.trace()
    assert positions == {name: int(column(trace, name, np.array([1 << 61]))[0]) for name in trace.axes}
    assert simulation.violations == []


def test_lost_power_on_one_bus_stops_the_motors_of_all(gantry: Prepared) -> None:
    seen = [0]

    def disturb(simulation: Simulation, evidence: Evidence) -> None:
        seen[0] += 1
        if seen[0] == 800:
            simulation.steppers()["Y2"].inputs.power = False

    result = run(gantry, disturb=disturb)
    assert "bus right" in result.fault
    assert "every motor stands" in result.fault
    assert result.violations == ()


def test_a_bus_that_falls_silent_stops_the_motors_of_the_other_at_once(gantry: Prepared) -> None:
    machine, _, plan = gantry
    with Session(machine.config) as session:
        session.connect()
        simulation = session.simulation
        assert simulation is not None
        cut_ns: list[int] = []

        def watch(evidence: Evidence) -> None:
            if evidence.sent_ns > 1_500_000_000 and not cut_ns:
                cut_ns.append(simulation.world.now_ns)
                simulation.buses[1].status.noise = lambda coming: []

        session.watch = watch
        with pytest.raises(SessionError, match="bus right"):
            session.run(plan.trajectory)
        assert session.state is State.FAULTED
        simulation.links[0].sleep_until(simulation.world.now_ns + 100_000_000)
        last = max(int(simulation.trace().pulses_ns(name).max()) for name in ("X", "Y", "Z", "Y2"))
        assert last < cut_ns[0] + 400_000_000
        assert simulation.violations == []


def test_an_exception_of_the_caller_stops_both_buses_before_it_goes_on(gantry: Prepared) -> None:
    class FullDiskError(Exception):
        pass

    def note(event: str, _time_ns: int, **_fields: Any) -> None:
        if event == "line" and session.state is State.RUNNING and session.now_ns > 1_200_000_000:
            raise FullDiskError

    machine, _, plan = gantry
    with Session(machine.config, note=note) as session:
        session.connect()
        with pytest.raises(FullDiskError):
            session.run(plan.trajectory)
        assert session.state is State.FAULTED
        assert session.simulation is not None
        stands(
            session.simulation,
            {name: driver.position() for name, driver in bringup.drivers(session.connection).items()},
        )


def test_a_bus_that_is_not_what_the_file_says_is_named(gantry: Prepared, monkeypatch: pytest.MonkeyPatch) -> None:
    good_talk = Bus.exchange

    def deaf(bus: Bus, exchange: Any, **named: Any) -> Evidence:
        if bus.name == "right":
            error = LinkTimeout("nobody answers", address=exchange.address)
            error.bus = bus.name
            raise error
        return good_talk(bus, exchange, **named)

    monkeypatch.setattr(Bus, "exchange", deaf)
    with Session(gantry[0].config) as session, pytest.raises(SessionError, match="bus right"):
        session.connect()


def test_a_plan_is_streamed_undisturbed_as_it_is(gantry: Prepared) -> None:
    machine, _, plan = gantry
    traces = []
    for trajectory in (plan.trajectory, RetimablePlan(plan)):
        with Session(machine.config) as session:
            session.connect()
            session.run(trajectory)
            assert session.simulation is not None
            trace = session.simulation.trace()
            traces.append((trace.bus_ns.tolist(), trace.bus_byte.tolist()))
    assert traces[0] == traces[1]


@pytest.mark.slow
@pytest.mark.parametrize("profile", ["adaptive", "group"])
def test_a_run_on_two_ports_ends_on_every_step(profile: str, tmp_path: Path) -> None:
    groupstart = [sys.executable, "-m", "groupstart"]
    serving = subprocess.Popen(
        [*groupstart, "sim", "-m", "gantry4-twobus", "--pty"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert serving.stdout is not None
        parts = read_machine("gantry4-twobus").text.split('port = "sim"')
        ports = [f'port = "{serving.stdout.readline().strip()}"\nwatchdog_ms = 4000' for _ in range(2)]
        (tmp_path / "ports.toml").write_text(parts[0] + ports[0] + parts[1] + ports[1] + parts[2])
        (tmp_path / "job.nc").write_text(PROGRAM)
        places = [str(tmp_path / "job.nc"), "-m", str(tmp_path / "ports.toml"), "--runs", str(tmp_path / "runs")]
        command = [*groupstart, "run", *places, "--profile", profile]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert "X 0  Y 0  Z 0  Y2 0 steps" in done.stdout
        [folder] = (tmp_path / "runs").iterdir()
        assert {path.name for path in folder.glob("bus-*.txt")} == {"bus-left.txt", "bus-right.txt"}
        assert '"event": "bus_starts"' in (folder / "journal.jsonl").read_text()
        for name in ("left", "right"):
            dump = [*groupstart, "dump", str(folder / f"bus-{name}.txt")]
            told = subprocess.run(dump, cwd=ROOT, capture_output=True, text=True, check=False)
            assert told.returncode == 0, told.stderr
            assert "load_trajectory" in told.stdout
    finally:
        serving.terminate()
        _, said = serving.communicate()
    assert "0 violations" in said
