"""The watchdog of a port: told of every motor, armed while something moves, and only then."""

from collections.abc import Sequence
from itertools import pairwise

import pytest

from gcode.canon import ORIGIN
from gcode.setup import Setup
from machines import bringup
from machines.bringup import Connection
from machines.control import Script
from machines.job import plan_job, read_job
from machines.load import read_machine
from machines.runner import RunOptions, perform
from machines.session import Session
from machines.wiring import bus_specs
from nmc.bus import Bus
from nmc.link import Link
from nmc.recording_link import RecordingLink
from nmc.watchdog import Switch, Ward
from sim.build import build

MACHINE = read_machine("mill3-mixed")


class Guarded:
    """A link that remembers what its watchdog was told, and whether it was armed at each Start Motion or load."""

    def __init__(self, inner: Link) -> None:
        self.inner = inner
        self.watched: tuple[tuple[Ward, ...], tuple[int, ...], int, int] | None = None
        self.armed = False
        self.changes: list[bool] = []
        self.loads_unarmed = 0
        self.beats = 0

    def watch(
        self,
        wards: Sequence[Ward],
        groups: Sequence[int],
        *,
        baud: int,
        timeout_ns: int,
        switches: Sequence[Switch] = (),
    ) -> None:
        self.watched = (tuple(wards), tuple(groups), baud, timeout_ns)

    def arm(self) -> None:
        assert self.watched is not None
        self.armed = True
        self.changes.append(True)

    def beat(self) -> None:
        self.beats += self.armed

    def disarm(self) -> None:
        self.armed = False
        self.changes.append(False)

    def write(self, data: bytes) -> None:
        moves = len(data) > 2 and data[0] == 0xAA and data[2] & 0x0F in (0x4, 0x5)
        self.loads_unarmed += moves and not self.armed
        self.inner.write(data)

    def now_ns(self) -> int:
        return self.inner.now_ns()

    def read(self, count: int, deadline_ns: int) -> bytes:
        return self.inner.read(count, deadline_ns)

    def sleep_until(self, time_ns: int) -> None:
        self.inner.sleep_until(time_ns)

    def set_baud(self, baud: int) -> None:
        self.inner.set_baud(baud)

    def flush_input(self) -> None:
        self.inner.flush_input()

    def close(self) -> None:
        self.inner.close()


@pytest.fixture
def guarded(monkeypatch: pytest.MonkeyPatch) -> Guarded:
    simulation = build(bus_specs(MACHINE.config), 3)
    link = Guarded(simulation.links[0])
    recorded: list[Link] = [RecordingLink(link)]
    connection = Connection(MACHINE.config, recorded, [Bus(recorded[0])], None)
    monkeypatch.setattr(bringup, "connect", lambda *_args, **_named: connection)
    return link


def test_it_is_armed_while_a_program_runs(guarded: Guarded) -> None:
    job = read_job("G21 G90\nG1 X3 Y1 Z1 F900\nG0 X0\nM2\n", Setup(file="job.nc", start=ORIGIN), MACHINE.config)
    result = perform(job, plan_job(job, MACHINE.config, "kernel"), MACHINE, RunOptions())
    assert result.fault == ""
    wards = (Ward(1, "pic-servo"), Ward(2, "pic-servo"), Ward(3, "pic-step"))
    assert guarded.watched == (wards, (0x81, 0x82), 115200, 100_000_000)
    assert guarded.changes == [True, False]
    assert guarded.loads_unarmed == 0


def test_an_override_shows_between_its_pieces_that_the_host_lives(guarded: Guarded) -> None:
    job = read_job("G21 G90\nG1 X3 Y1 Z1 F300\nG0 X0\nM2\n", Setup(file="job.nc", start=ORIGIN), MACHINE.config)
    plan = plan_job(job, MACHINE.config, "kernel")
    counted: list[tuple[int, int]] = []
    control = Script([(0.3, "feed 50")])
    options = RunOptions(control=control, watch=lambda evidence: counted.append((guarded.beats, evidence.replied_ns)))
    assert perform(job, plan, MACHINE, options).fault == ""
    between = [after - before for (before, _), (after, _) in pairwise(counted)]
    assert max(between) >= 12  # the stages of the path, then each of the three axes
    assert sorted(between)[-8] <= 2


def test_it_is_armed_while_an_axis_homes(guarded: Guarded) -> None:
    with Session(MACHINE.config) as session:
        session.connect()
        session.home(["X"])
    assert guarded.changes == [True, False]
    assert guarded.loads_unarmed == 0


def test_it_is_disarmed_after_a_stop(guarded: Guarded) -> None:
    job = read_job("G21 G90\nG1 X30 F900\nM2\n", Setup(file="job.nc", start=ORIGIN), MACHINE.config)
    plan = plan_job(job, MACHINE.config, "kernel")
    calls = [0]

    def stop() -> bool:
        calls[0] += 1
        return calls[0] > 50

    result = perform(job, plan, MACHINE, RunOptions(), stop_requested=stop)
    assert "stopped on request" in result.fault
    assert guarded.changes == [True, False]
