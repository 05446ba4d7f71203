"""A host that hung finds its bus taken by the watchdog: it is told what is true of the motors, no more and no less."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from supervised import Supervised

from gcode.setup import Setup
from machines import bringup
from machines.aftermath import MAY_MOVE, WITHIN_NS, told_of
from machines.bringup import Connection
from machines.job import plan_job, read_job
from machines.load import read_machine
from machines.runner import RunOptions, perform
from machines.wiring import bus_specs
from nmc.bus import Bus
from nmc.errors import NmcError
from nmc.program import Evidence
from nmc.watchdog import Phase, Switch, Ward, Watchdog
from sim.build import Simulation, build

SINGLE, TWO = read_machine("mill3-step").config, read_machine("gantry4-twobus")
ERROR = NmcError("the watchdog has stopped the machine and holds the bus")


@dataclass
class Told:
    """A port whose watchdog has taken it, as it tells; ``later_ns``: when it has come so far."""

    fenced: bool = True
    motors: bool = True
    switches: bool = True
    later_ns: int = 0
    time_ns: int = 0
    written: list[bytes] = field(default_factory=list)

    def arm(self) -> None:
        raise AssertionError("nothing is armed here")

    @property
    def motors_stand(self) -> bool:
        return self.motors and self.time_ns >= self.later_ns

    @property
    def standing(self) -> bool:
        return self.motors_stand and self.switches

    def now_ns(self) -> int:
        return self.time_ns

    def sleep_until(self, time_ns: int) -> None:
        self.time_ns = max(self.time_ns, time_ns)

    def set_baud(self, baud: int) -> None:
        assert baud == 19200

    def write(self, data: bytes) -> None:
        self.written.append(data)
        raise ERROR if self.fenced else NmcError("the port is gone")


def told(port: Told) -> str:
    link: Any = port
    return told_of(Connection(SINGLE, [link], [Bus(link)], None), ERROR)


def test_a_watchdog_that_is_done_is_believed() -> None:
    port = Told(later_ns=700_000_000)
    assert told(port) == "the watchdog has stopped every motor; where they stand is not known"
    assert 700_000_000 <= port.time_ns < 800_000_000
    assert port.written == []


def test_outputs_that_do_not_go_off_are_no_motors_that_move() -> None:
    words = told(Told(switches=False))
    assert "the watchdog has stopped every motor" in words
    assert "SPINDLE OR OUTPUTS MAY STILL BE ON" in words
    assert MAY_MOVE not in words


def test_a_motor_of_which_nothing_is_heard_may_move() -> None:
    port = Told(motors=False)
    words = told(port)
    assert words.startswith(MAY_MOVE)
    assert "not every motor has told it yet that it stands" in words
    assert "has stopped" not in words
    assert WITHIN_NS <= port.time_ns < 2 * WITHIN_NS


def test_without_a_watchdog_on_the_bus_the_error_is_told_at_once() -> None:
    port = Told(fenced=False)
    assert told(port) == f"{MAY_MOVE}: {ERROR}"
    assert port.written == []


def still(simulation: Simulation) -> bool:
    before = {name: module.position for name, module in simulation.steppers().items()}
    simulation.world.run_until(simulation.world.now_ns + 300_000_000)
    simulation.trace()
    return before == {name: module.position for name, module in simulation.steppers().items()}


@pytest.mark.parametrize("number", [0, 1])
def test_one_of_two_buses_that_was_taken_is_stopped_with_the_other(
    number: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = build(bus_specs(TWO.config), 5)
    links: list[Any] = [Supervised(link, Watchdog([], (), baud=115200)) for link in simulation.links[:2]]
    names = list(TWO.config.bus)
    buses = [Bus(link, name=name) for link, name in zip(links, names, strict=True)]
    connection = Connection(TWO.config, links, buses, None)
    monkeypatch.setattr(bringup, "connect", lambda *_args, **_named: connection)
    job = read_job("G21 G90 F900\nG1 X20 Y8\nG1 X2 Y1\nM2\n", Setup(file="job.nc"), TWO.config)
    count = [0]

    def hang(_evidence: Evidence) -> None:
        count[0] += 1
        if count[0] == 400:
            links[number].watchdog.trip(links[number].now_ns())

    result = perform(job, plan_job(job, TWO.config, "kernel"), TWO, RunOptions(watch=hang))
    assert f"the watchdog has stopped bus {names[number]}, and every other motor stands" in result.fault
    assert MAY_MOVE not in result.fault
    assert any(module.position for module in simulation.steppers().values())
    assert still(simulation)


def test_the_watchdog_knows_motors_from_outputs() -> None:
    dog = Watchdog([Ward(1, "pic-servo")], (0x81,), baud=115200, switches=[Switch(3, b"\xaa\x03\x18\x10\x2b")])
    dog.arm(0)
    dog.trip(1)
    seen = []
    for _ in range(12):
        packet = dog.next_bytes(0)
        dog.heard(b"" if packet[1:2] == b"\x03" else b"\x08\x08")
        seen.append(dog.motors_stand)
    assert not seen[0]
    assert seen[-1]
    assert seen == sorted(seen)
    assert dog.phase is Phase.STOPPING
