"""One command after another on the same chips: what is homed stays homed, what was reset starts anew."""

from collections.abc import Callable

import pytest

from gcode.canon import ORIGIN, Position
from gcode.setup import Setup
from machines import bringup
from machines.bringup import Connection
from machines.job import Job, plan_job, read_job
from machines.load import MachineFile, parse_machine, read_machine
from machines.runner import RunOptions, perform
from machines.session import Session
from machines.wiring import bus_specs
from nmc.bus import Bus
from nmc.program import Exchange
from planner.plan import Plan
from sim.build import Simulation, build


def twelve_off(name: str) -> MachineFile:
    text = read_machine(name).text.replace("[sim.axis.X]\n", "[sim.axis.X]\nstart_at = 12\n", 1)
    return MachineFile(name, text, parse_machine(text, name))


@pytest.fixture(params=["mill3-step", "mill3-servo"])
def machine(request: pytest.FixtureRequest) -> MachineFile:
    return twelve_off(request.param)


@pytest.fixture
def chips(machine: MachineFile, monkeypatch: pytest.MonkeyPatch) -> Simulation:
    """Chips that outlive a session, as real ones do; no session knows that they are simulated."""
    simulation = build(bus_specs(machine.config), 3)

    def connect(config: object, port: object = None, seed: object = None) -> Connection:
        links = list(simulation.links)
        return Connection(machine.config, links, [Bus(link) for link in links], None)

    monkeypatch.setattr(bringup, "connect", connect)
    return simulation


def prepared(machine: MachineFile, text: str) -> Callable[[Position], tuple[Job, Plan]]:
    def make(start: Position) -> tuple[Job, Plan]:
        job = read_job(text, Setup(file="job.nc", start=start), machine.config)
        assert not job.errors, job.errors
        return job, plan_job(job, machine.config, "kernel")

    return make


def test_the_next_session_finds_the_machine_where_the_last_left_it(machine: MachineFile, chips: Simulation) -> None:
    kept: list[bool] = []

    def note(event: str, _time_ns: int, **fields: bool) -> None:
        if event == "connected":
            kept.append(fields["kept_positions"])

    with Session(machine.config, note=note) as session:
        session.connect()
        session.home(["X"])
    make = prepared(machine, "G21 G90\nG1 X20 Y5 F2400\nM2\n")
    first = perform(*make(ORIGIN), machine, RunOptions(), note=note, replan=make)
    assert first.fault == ""
    assert first.outcome is not None
    back = prepared(machine, "G21 G91\nG0 X-20 Y-5\nM2\n")
    second = perform(
        *prepared(machine, "G21 G90\nG0 X0 Y0\nM2\n")(ORIGIN), machine, RunOptions(), note=note, replan=back
    )
    assert second.fault == ""
    assert second.job.start[:2] == pytest.approx((20, 5), abs=0.01)
    assert kept == [False, True, True]
    assert chips.violations == []
    with Session(machine.config) as session:
        session.connect()
        assert session.where() == pytest.approx({"X": 0, "Y": 0, "Z": 0}, abs=0.01)


def test_a_plan_from_elsewhere_does_not_run(machine: MachineFile, chips: Simulation) -> None:
    make = prepared(machine, "G21 G90\nG0 X3\nM2\n")
    assert perform(*make(ORIGIN), machine, RunOptions()).fault == ""
    again = perform(*make(ORIGIN), machine, RunOptions())
    assert "does not begin where the machine stands (X at 3.000)" in again.fault
    assert again.outcome is None
    assert chips.violations == []


@pytest.mark.parametrize("harm", ["amplifier off", "still moving"])
def test_what_is_not_ready_is_reset(harm: str, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = twelve_off("mill3-step")
    simulation = build(bus_specs(machine.config), 3)
    links = list(simulation.links)
    connection = Connection(machine.config, links, [Bus(link) for link in links], None)
    assert bringup.bring_up(connection) is False
    bus = connection.buses[0]
    if harm == "amplifier off":
        bus.exchange(Exchange(2, 0x7, b"\x00"))
    else:
        load = bytes((0x89,)) + (4000).to_bytes(4, "little") + (60000).to_bytes(2, "little") + b"\x05"
        bus.exchange(Exchange(2, 0x4, load))
    later = Connection(machine.config, links, [Bus(link) for link in links], None)
    assert bringup.bring_up(later) is False
    assert bringup.read_positions(later) == {"X": 0, "Y": 0, "Z": 0}
    link = links[0]
    link.sleep_until(link.now_ns() + 2_000_000_000)
    assert bringup.read_positions(later) == {"X": 0, "Y": 0, "Z": 0}
    third = Connection(machine.config, links, [Bus(link) for link in links], None)
    assert bringup.bring_up(third) is True
