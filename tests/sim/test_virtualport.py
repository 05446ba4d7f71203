"""The virtual machine on a pseudo-terminal, with a clock that the test turns by hand.

The kernel moves bytes between the two ends of a terminal in its own time, so bytes that must come are waited for; how
long that takes changes nothing.
"""

import os
import select
import termios

import pytest

from sim.build import build
from sim.rawhost import packet
from sim.spec import BusSpec, StepModule
from sim.virtualport import AHEAD_NS, VirtualPort

MS = 1_000_000
PATIENCE_S = 10


class HandClock:
    def __init__(self):
        self.time_ns = 5_000 * MS

    def now_ns(self):
        return self.time_ns


class Client:
    """The other end of the terminal."""

    def __init__(self, port):
        self.port = port
        self.handle = os.open(port.device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def rate(self, code):
        attributes = termios.tcgetattr(self.handle)
        attributes[4] = attributes[5] = code
        termios.tcsetattr(self.handle, termios.TCSANOW, attributes)

    def write(self, data):
        """Write, and wait until the port can see it."""
        os.write(self.handle, data)
        assert select.select([self.port._master], [], [], PATIENCE_S)[0]

    def read(self, count):
        """Wait for ``count`` bytes; with 0 take what there is."""
        data = b""
        while select.select([self.handle], [], [], PATIENCE_S if len(data) < count else 0)[0]:
            data += os.read(self.handle, 4096)
        return data


@pytest.fixture
def rig(request):
    clock = HandClock()
    sim = build([BusSpec("bus", (StepModule("M1"), StepModule("M2")))], 1)
    port = VirtualPort(sim, clock, unpaced=getattr(request, "param", False))
    client = Client(port)
    yield sim, clock, port, client
    os.close(client.handle)
    port.close()


def turn(port, clock, time_ms, step_ms=0.05):
    """Serve for ``time_ms`` of the hand clock."""
    for _ in range(round(time_ms / step_ms)):
        clock.time_ns += round(step_ms * MS)
        readable, _, _ = select.select([port._master], [], [], 0)
        port.turn(bool(readable))


def test_an_answer_takes_its_time_on_the_wire(rig):
    _, clock, port, client = rig
    turn(port, clock, 2)
    client.write(packet(0, 0xE))
    turn(port, clock, 2.5)  # 4 bytes and 1 byte at 19200 baud are 2.6 ms
    assert client.read(0) == b""
    turn(port, clock, 2)
    assert len(client.read(2)) == 2


@pytest.mark.parametrize("rig", [True], indirect=True)
def test_unpaced_answers_at_once_and_motion_follows_the_clock(rig):
    sim, clock, port, client = rig
    turn(port, clock, 2)
    for _ in range(50):
        client.write(packet(0, 0xE))
        before = clock.time_ns
        given = port.answered
        while port.answered < given + 2:
            turn(port, clock, 0.02, 0.02)
        assert len(client.read(2)) == 2
        assert clock.time_ns - before <= 5 * MS
        assert sim.world.now_ns - (clock.time_ns - 5_000 * MS) <= 2 * AHEAD_NS
    turn(port, clock, 50)
    assert sim.world.now_ns == clock.time_ns - 5_000 * MS


def test_the_clients_rate_is_heard(rig):
    sim, clock, port, client = rig
    turn(port, clock, 2)
    client.rate(termios.B115200)
    client.write(packet(0, 0xE))
    turn(port, clock, 20)
    assert port.client_baud() == 115200
    assert len(client.read(0)) < 2
    client.rate(termios.B19200)
    client.write(bytes(16))
    turn(port, clock, 20)
    client.read(0)
    client.write(packet(0, 0xE))
    turn(port, clock, 10)
    assert len(client.read(2)) == 2
    assert sim.modules["M1"].alive


def test_a_client_enumerates_and_moves(rig):
    sim, clock, port, client = rig

    def exchange(address, command, data=b"", extra=0):
        client.write(packet(address, command, data))
        turn(port, clock, 30, 0.5)
        reply = client.read(extra + 2)
        assert len(reply) == extra + 2
        return reply

    turn(port, clock, 2)
    for address in (1, 2):
        exchange(0, 1, [address, 0xFF])
    exchange(2, 6, [0, 1, 100, 50, 0])
    exchange(2, 7, [1])
    exchange(2, 4, [0x87, *(500).to_bytes(4, "little"), 100, 1])
    turn(port, clock, 500, 5)
    assert exchange(2, 3, [0x01], 4)[1:5] == (500).to_bytes(4, "little")
    assert sim.violations == []


def test_serving_ends_when_told(rig):
    _, clock, port, client = rig
    asked = []

    def stopped():
        asked.append(1)
        clock.time_ns += 100 * MS
        return len(asked) > 3

    client.write(packet(0, 0xE))
    port.serve(stopped)
    assert len(asked) == 4


def test_patience_is_the_time_to_the_next_answer(rig):
    _, clock, port, client = rig
    turn(port, clock, 2)
    client.write(packet(0, 0xE))
    turn(port, clock, 1.0, 0.5)
    assert 0 <= port._patience_s() <= 0.002
    turn(port, clock, 20)
    assert port._patience_s() == pytest.approx(0.05)
