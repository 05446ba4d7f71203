"""What goes wrong around a running machine: plug pulled, disk full, host that hung. Stop first, then tell all of it."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from supervised import Supervised

from gcode.canon import ORIGIN
from gcode.setup import Setup
from machines import bringup
from machines.bringup import Connection
from machines.job import Job, plan_job, read_job
from machines.load import read_machine
from machines.runner import RunOptions, perform
from machines.wiring import bus_specs
from nmc.bus import Bus
from nmc.errors import NmcError
from nmc.program import Evidence
from nmc.watchdog import Watchdog
from planner.plan import Plan
from sim.build import Simulation, build

MACHINE = read_machine("mill3-step")
PROGRAM = "G21 G90 F900\nG1 X20 Y8\nG1 X2 Y1\nM2\n"


@pytest.fixture(scope="module")
def job() -> Job:
    return read_job(PROGRAM, Setup(file="job.nc", start=ORIGIN), MACHINE.config)


@pytest.fixture(scope="module")
def plan(job: Job) -> Plan:
    return plan_job(job, MACHINE.config, "kernel")


class Port:
    """A port that is pulled out after so many writes: from then on every call fails, as a descriptor's do."""

    def __init__(self, inner: Any, writes: int) -> None:
        self._inner, self._left = inner, writes

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def write(self, data: bytes) -> None:
        self._left -= 1
        if self._left < 0:
            raise NmcError("/dev/ttyUSB0: [Errno 5] Input/output error")
        self._inner.write(data)

    def read(self, count: int, deadline_ns: int) -> bytes:
        if self._left < 0:
            raise NmcError("/dev/ttyUSB0: the port is gone")
        data: bytes = self._inner.read(count, deadline_ns)
        return data


def on_port(monkeypatch: pytest.MonkeyPatch, wrap: Any) -> tuple[Simulation, Any]:
    simulation = build(bus_specs(MACHINE.config), 5)
    link = wrap(simulation.links[0])
    connection = Connection(MACHINE.config, [link], [Bus(link)], None)
    monkeypatch.setattr(bringup, "connect", lambda *_args, **_named: connection)
    return simulation, link


def still(simulation: Simulation) -> bool:
    before = {name: module.position for name, module in simulation.steppers().items()}
    simulation.world.run_until(simulation.world.now_ns + 300_000_000)
    simulation.trace()
    return before == {name: module.position for name, module in simulation.steppers().items()}


def test_a_plug_that_is_pulled_is_told_with_the_one_thing_to_do(
    job: Job, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_port(monkeypatch, lambda link: Port(link, 1400))
    notes: list[str] = []
    result = perform(job, plan, MACHINE, RunOptions(), note=lambda event, _time_ns, **_fields: notes.append(event))
    assert result.verdict is None
    assert result.fault.startswith("line 3: ")
    assert "Input/output error" in result.fault
    assert "MOTORS MAY STILL BE MOVING, use the emergency stop" in result.fault
    assert notes.count("fault") == 2


def test_a_host_that_hangs_in_a_run_finds_the_machine_stopped_by_the_watchdog(
    job: Job, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    dog = Watchdog([], (), baud=115200)
    simulation, link = on_port(monkeypatch, lambda inner: Supervised(inner, dog))
    told = [0]

    def hang(_evidence: Evidence) -> None:
        told[0] += 1
        if told[0] == 400:
            link.inner.sleep_until(link.inner.now_ns() + 250_000_000)  # nothing is called meanwhile

    result = perform(job, plan, MACHINE, RunOptions(watch=hang))
    assert result.verdict is None
    assert "the watchdog has stopped the machine and holds the bus" in result.fault
    assert "the watchdog has stopped every motor" in result.fault
    assert "MAY STILL" not in result.fault
    assert still(simulation)
    end = [module.position for module in simulation.steppers().values()]
    corners = np.array([[0, 0, 0], [4000, 1600, 0]])
    assert (corners[0] <= end).all()
    assert (end <= corners[1]).all()


def full_disk(event: str, time_ns: int, **_fields: Any) -> None:
    if time_ns > 1_000_000_000:
        raise OSError(28, "No space left on device", "journal.jsonl")


def test_a_journal_that_cannot_be_written_holds_up_no_stop(
    job: Job, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation, _ = on_port(monkeypatch, lambda link: link)
    with pytest.raises(OSError, match="No space left"):
        perform(job, plan, MACHINE, RunOptions(), note=full_disk)
    assert simulation.steppers()["X"].position > 0
    assert still(simulation)
