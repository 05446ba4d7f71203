"""A virtual CY545 on a pseudo-terminal beside an NMC bus, with a clock that the test turns by hand."""

import os
import select
import termios

import pytest

from nmc.chips.cy545 import RateTable
from sim.build import build
from sim.cy545_spec import Cy545Port
from sim.rawhost import packet
from sim.spec import BusSpec, StepModule
from sim.virtualport import VirtualPort
from sim.virtualports import serve_all

MS = 1_000_000
PATIENCE_S = 10
RATES = RateTable(tuple(50.0 + 40.0 * k for k in range(256)), "a table of equal steps")


class HandClock:
    def __init__(self):
        self.time_ns = 5_000 * MS

    def now_ns(self):
        return self.time_ns


class Rig:
    """A machine of one PIC-STEP and one CY545, and a client on each of its two terminals."""

    def __init__(self):
        self.clock = HandClock()
        self.sim = build([BusSpec("main", (StepModule("M1"),)), Cy545Port("A", "indexer", RATES, baud=9600)], 1)
        self.ports = [VirtualPort(self.sim, self.clock, bus) for bus in range(2)]
        self.handles = [os.open(port.device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK) for port in self.ports]
        self.rate(1, termios.B9600)

    def rate(self, number, code):
        attributes = termios.tcgetattr(self.handles[number])
        attributes[4] = attributes[5] = code
        termios.tcsetattr(self.handles[number], termios.TCSANOW, attributes)

    def write(self, number, data):
        os.write(self.handles[number], data)
        assert select.select([self.ports[number].master], [], [], PATIENCE_S)[0]

    def serve(self, time_ms, step_ms=0.25):
        """Serve both for ``time_ms`` of the hand clock; it goes on by a step whenever the loop asks whether to stop."""
        left = [round(time_ms / step_ms)]

        def over():
            self.clock.time_ns += round(step_ms * MS)
            left[0] -= 1
            return left[0] < 0

        serve_all(self.ports, over)

    def read(self, number, count):
        data = b""
        while select.select([self.handles[number]], [], [], PATIENCE_S if len(data) < count else 0)[0]:
            data += os.read(self.handles[number], 4096)
        return data

    def close(self):
        for handle in self.handles:
            os.close(handle)
        for port in self.ports:
            port.close()


@pytest.fixture
def rig(monkeypatch):
    # the loop must not wait for the wall clock: time passes when the hand turns it
    monkeypatch.setattr(VirtualPort, "patience_s", lambda self: 0.0)
    found = Rig()
    yield found
    found.close()


def test_the_chip_answers_and_moves_at_the_pace_of_the_clock(rig):
    rig.write(1, b"?R\r")
    rig.serve(20)
    assert rig.read(1, 8) == b"R=00100\r"
    for command in (b"R 10\r", b"F 10\r", b"N 45\r", b"+\r", b"G\r"):
        rig.write(1, command)
        rig.serve(10)
    rig.serve(50)
    chip = rig.sim.indexers["A"]
    assert chip.busy
    assert 20 < chip.mechanical < 35  # 450 steps/s, about 60 ms so far
    rig.serve(60)
    assert not chip.busy
    assert chip.mechanical == 45


def test_both_terminals_are_served(rig):
    rig.serve(2)
    rig.write(0, packet(0, 0xE))
    rig.write(1, b"?P\r")
    rig.serve(30)
    assert len(rig.read(0, 2)) == 2
    assert rig.read(1, 11) == b"P=00000000\r"
    assert rig.sim.violations == []


def test_a_client_at_another_rate_is_not_understood(rig):
    rig.rate(1, termios.B19200)
    rig.write(1, b"?P\r")
    rig.serve(30)
    assert rig.read(1, 0) == b""
    assert {v.rule for v in rig.sim.violations} == {"CE-01"}
