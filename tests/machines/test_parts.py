"""Waiting for somebody: the trajectory in parts, the machine held between them, every part exact."""

import numpy as np
import pytest

from gcode.canon import ORIGIN
from gcode.setup import Setup
from machines import bringup
from machines.bringup import Connection
from machines.job import Job, plan_job, read_job
from machines.load import read_machine
from machines.parts import parts_of
from machines.runner import RunOptions, perform
from machines.wiring import bus_specs
from nmc.bus import Bus
from planner.plan import Plan
from sim.build import Simulation, build

MACHINE = read_machine("mill3-step")
PROGRAM = """G21 G90 G64 P0.01
T1 M6
S8000 M3
G0 X5
G1 X10 Y5 F1200
M0
G1 X0
G4 P0.2
M5
T2 M6
G0 Y0
M30
"""


def prepared(text: str) -> tuple[Job, Plan]:
    job = read_job(text, Setup(file="job.nc", start=ORIGIN), MACHINE.config)
    assert not job.errors
    return job, plan_job(job, MACHINE.config, "kernel")


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Simulation:
    """Chips that the session takes for real ones."""
    simulation = build(bus_specs(MACHINE.config), 3)
    links = list(simulation.links)
    connection = Connection(MACHINE.config, links, [Bus(link) for link in links], None)
    monkeypatch.setattr(bringup, "connect", lambda *_args, **_named: connection)
    return simulation


def test_the_parts_are_the_whole() -> None:
    _, plan = prepared(PROGRAM)
    parts = list(parts_of(plan.trajectory))
    assert [[type(wait).__name__ for wait in part.waits] for part in parts] == [
        ["ToolChange", "Spindle"],
        ["Stop"],
        ["ToolChange"],
    ]
    assert sum(part.duration_s for part in parts) == pytest.approx(plan.trajectory.duration_s)
    for part in parts:
        t = np.linspace(0, part.duration_s, 50)
        assert np.array_equal(part.q(t), plan.trajectory.q(t + part.begin_s))
        assert np.array_equal(part.v(t), plan.trajectory.v(t + part.begin_s))
        assert np.array_equal(part.line(t), plan.trajectory.line(t + part.begin_s))
        assert np.abs(part.v(np.array([0.0]))).max() < 1e-9
        assert part.junctions_s()[0] == 0
        assert part.junctions_s()[-1] == part.duration_s


def test_a_program_without_waits_is_one_part() -> None:
    _, plan = prepared("G21 G90\nG1 X5 F600\nM2\n")
    [part] = parts_of(plan.trajectory)
    assert (part.begin_s, part.duration_s, part.waits) == (0, plan.trajectory.duration_s, ())


def test_the_machine_waits_where_the_program_says_and_ends_exact(port: Simulation) -> None:
    asked: list[str] = []
    states: list[str] = []
    progress: list[float] = []

    def ask(request: str) -> bool:
        asked.append(request)
        link = port.links[0]
        link.sleep_until(link.now_ns() + 60_000_000_000)
        return True

    def note(event: str, _time_ns: int, **fields: str) -> None:
        if event == "state":
            states.append(fields["state"])

    result = perform(
        *prepared(PROGRAM),
        MACHINE,
        RunOptions(ask=ask),
        note=note,
        progress=lambda step: progress.append(step.time_s),
    )
    assert result.fault == ""
    assert asked == [
        "line 2: put tool 1 into the spindle",
        "line 3: start the spindle clockwise at 8000 rpm",
        "line 6: the program has stopped",
        "line 10: put tool 2 into the spindle",
    ]
    assert states == ["held", "idle"] * 2 + ["running", "idle"] + ["held", "idle", "running", "idle"] * 2
    assert result.verdict is not None
    assert result.verdict.ok
    assert result.verdict.end_error_steps == {"X": 0, "Y": 0, "Z": 0}
    assert progress == sorted(progress)
    assert port.violations == []


def test_a_request_that_is_not_confirmed_ends_the_run_at_rest(port: Simulation) -> None:
    result = perform(*prepared(PROGRAM), MACHINE, RunOptions(ask=lambda request: "stopped" not in request))
    assert "line 6: the program has stopped: not confirmed" in result.fault
    assert "X10.000 Y5.000" in result.fault


def test_without_anybody_there_nothing_moves(port: Simulation) -> None:
    result = perform(*prepared(PROGRAM), MACHINE, RunOptions())
    assert "line 2: put tool 1 into the spindle: nobody is there" in result.fault
    assert len(port.trace().run_count) == 0
