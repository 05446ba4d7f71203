"""The session on the twin: states, stops, faults; what moves is stopped before anybody is told."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gcode.setup import Setup
from machines.job import Job, plan_job, read_job
from machines.load import MachineFile, read_machine
from machines.patience import LONGEST_WAIT_NS, PatientSource
from machines.runner import RunOptions, perform
from machines.session import Session, SessionError, State
from nmc.bus import Bus
from nmc.errors import LinkTimeout
from nmc.program import Evidence, Exchange
from planner.plan import Plan

PROGRAM = "G21 G90 G64 P0.01\nG0 X20 Y10\nG1 X40 Y30 F2400\nG3 X20 Y50 I-20 J0\nG1 X0\nY0\nM2\n"


@pytest.fixture(scope="module")
def machine() -> MachineFile:
    return read_machine("mill3-step")


@pytest.fixture(scope="module")
def job(machine: MachineFile) -> Job:
    found = read_job(PROGRAM, Setup(file="job.nc"), machine.config)
    assert not found.errors
    return found


@pytest.fixture(scope="module")
def plan(job: Job, machine: MachineFile) -> Plan:
    return plan_job(job, machine.config)


def after(calls: int) -> Callable[[], bool]:
    """True from the given call on."""
    left = [calls]

    def asked() -> bool:
        left[0] -= 1
        return left[0] <= 0

    return asked


def pins_at_end(trace: Any) -> dict[str, int]:
    steps = dict(zip(trace.axes, trace.start_steps.tolist(), strict=True))
    for axis, direction, count in zip(trace.run_axis, trace.run_dir, trace.run_count, strict=True):
        steps[trace.axes[axis]] += int(direction) * int(count)
    return steps


def test_a_run_ends_idle_and_on_the_programmed_step(machine: MachineFile, plan: Plan) -> None:
    notes: list[tuple[str, dict[str, Any]]] = []
    with Session(machine.config, note=lambda event, _time_ns, **fields: notes.append((event, fields))) as session:
        assert session.state is State.IDLE
        session.connect()
        outcome = session.run(plan.trajectory)
        assert session.state is State.IDLE
    assert outcome.finished
    assert outcome.positions == {"X": 0, "Y": 0, "Z": 0}
    assert outcome.statistics.packets > 100
    assert [fields["state"] for event, fields in notes if event == "state"] == ["running", "idle"]


def test_the_runner_judges_it_good(machine: MachineFile, job: Job, plan: Plan) -> None:
    result = perform(job, plan, machine, RunOptions(seed=5))
    assert result.fault == ""
    assert result.verdict is not None
    assert result.verdict.ok, result.verdict.reasons
    assert result.verdict.program_um is not None
    assert result.verdict.program_um < 1e3 * machine.config.machine.path_tolerance + 30


@pytest.mark.parametrize("exchanges", [1, 40, 400, 1200])
def test_a_stop_request_stops_every_motor_and_reads_where_it_stands(
    exchanges: int, machine: MachineFile, job: Job, plan: Plan
) -> None:
    notes: list[str] = []
    result = perform(
        job,
        plan,
        machine,
        RunOptions(),
        note=lambda event, _time_ns, **_fields: notes.append(event),
        stop_requested=after(exchanges),
    )
    assert result.outcome is not None
    assert not result.outcome.finished
    assert result.verdict is None
    assert result.trace is not None
    assert result.outcome.positions == pins_at_end(result.trace)
    assert "stopped on request" in result.fault
    assert "read back" in result.fault
    assert result.violations == ()
    assert notes.index("stop_requested") < notes.index("all_stopped")


def test_after_a_stop_nothing_moves_any_more(machine: MachineFile, plan: Plan) -> None:
    with Session(machine.config) as session:
        session.connect()
        outcome = session.run(plan.trajectory, stop_requested=after(500))
        assert session.state is State.STOPPED
        link = session.connection.links[0]
        link.sleep_until(link.now_ns() + 5_000_000_000)
        assert session.simulation is not None
        assert pins_at_end(session.simulation.trace()) == outcome.positions
        with pytest.raises(SessionError, match="stopped, not idle"):
            session.run(plan.trajectory)


def test_a_bus_fault_stops_every_motor_first_and_then_is_told(
    machine: MachineFile, job: Job, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = [600]
    good = Bus.exchange

    def broken(bus: Bus, exchange: Exchange, **named: Any) -> Evidence:
        left[0] -= 1
        if left[0] == 0:
            raise LinkTimeout("nobody answers", address=exchange.address)
        return good(bus, exchange, **named)

    monkeypatch.setattr(Bus, "exchange", broken)
    notes: list[str] = []
    result = perform(job, plan, machine, RunOptions(), note=lambda event, _time_ns, **_fields: notes.append(event))
    assert "nobody answers" in result.fault
    assert result.fault.startswith("line ")
    assert "every motor stands" in result.fault
    assert notes.index("fault") < notes.index("all_stopped")
    assert result.trace is not None


def test_an_exception_of_the_caller_stops_the_motors_before_it_goes_on(machine: MachineFile, plan: Plan) -> None:
    class FullDiskError(Exception):
        pass

    def note(event: str, _time_ns: int, **_fields: Any) -> None:
        if event == "line" and session.state is State.RUNNING and link.now_ns() > 1_000_000_000:
            raise FullDiskError

    with Session(machine.config, note=note) as session:
        session.connect()
        link = session.connection.links[0]
        with pytest.raises(FullDiskError):
            session.run(plan.trajectory)
        assert session.state is State.FAULTED
        assert session.simulation is not None
        before = pins_at_end(session.simulation.trace())
        assert any(before.values())
        link.sleep_until(link.now_ns() + 5_000_000_000)
        assert pins_at_end(session.simulation.trace()) == before


def test_a_machine_that_is_not_what_the_file_says(machine: MachineFile, monkeypatch: pytest.MonkeyPatch) -> None:
    from machines import bringup
    from nmc.setup import ModuleExpectation

    monkeypatch.setattr(bringup, "expectations", lambda _config, _bus: [ModuleExpectation("pic-step")] * 2)
    with Session(machine.config) as session:
        with pytest.raises(SessionError, match="3 modules on the bus, 2 expected"):
            session.connect()
        assert session.state is State.FAULTED


def test_a_session_is_not_used_before_it_is_connected(machine: MachineFile, plan: Plan) -> None:
    session = Session(machine.config)
    with pytest.raises(SessionError, match="not connected"):
        session.run(plan.trajectory)


class Script:
    """A source of given exchanges that remembers what evidence it was shown."""

    def __init__(self, *exchanges: Exchange) -> None:
        self.exchanges = list(exchanges)
        self.seen: list[Evidence | None] = []

    def next(self, _now_ns: int, evidence: Evidence | None) -> Exchange | None:
        self.seen.append(evidence)
        return self.exchanges.pop(0) if self.exchanges else None


def test_long_waits_are_filled_with_polls_that_the_source_never_sees() -> None:
    script = Script(Exchange(2, 5, send_at_ns=1_000_000_000), Exchange(3, 5))
    patient = PatientSource(script, address=1)
    now_ns, evidence, sent = 0, None, []
    while (exchange := patient.next(now_ns, evidence)) is not None:
        now_ns = max(now_ns, exchange.send_at_ns)
        evidence = Evidence(exchange, now_ns, now_ns, 0)
        sent.append(exchange)
    polls = [each for each in sent if each.address == 1]
    assert len(polls) == pytest.approx(1e9 / LONGEST_WAIT_NS, abs=2)
    assert np.diff([each.send_at_ns for each in polls]).max() <= LONGEST_WAIT_NS
    assert [each.address for each in sent if each.address != 1] == [2, 3]
    assert [None if each is None else each.exchange.address for each in script.seen] == [None, 2, 3]
