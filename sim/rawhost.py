"""A host of a few lines, for experiments, benchmarks and tests: packets by hand, answers as bytes.

It shares nothing with the driver of the project, so it can be wrong in other ways than the driver.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

from nmc.link import Link
from sim.build import Simulation, build
from sim.picservo import PicServo
from sim.picstep import PicStep
from sim.spec import BusSpec, Module, ServoModule, SimOptions, StepModule

WAIT_NS = 20_000_000
GROUP = 0x81
FIRM_GAINS = (220, 2640, 150, 4000, 255, 0, 4000, 1, 0)  # Kp Kd Ki IL OL CL EL SR deadband of the default plant


def packet(address: int, command: int, data: Iterable[int] = ()) -> bytes:
    """A command packet: header, address, command byte with data length, data, checksum."""
    payload = bytes(data)
    body = bytes([address, len(payload) << 4 | command]) + payload
    return b"\xaa" + body + bytes([sum(body) & 0xFF])


def i32(value: int) -> bytes:
    """Four bytes, least significant first."""
    return struct.pack("<i", value)


class NoReplyError(Exception):
    """The answer did not come whole, or its checksum is wrong."""


class RawHost:
    """Talks to modules over a link; raises NoReplyError when an answer is missing."""

    def __init__(self, link: Link) -> None:
        self.link = link

    def send(self, address: int, command: int, data: Iterable[int] = ()) -> None:
        """Send a command and do not listen."""
        self.link.write(packet(address, command, data))

    def exchange(self, address: int, command: int, data: Iterable[int] = (), extra: int = 0) -> bytes:
        """Send a command; the answer without its checksum: status byte and ``extra`` further bytes."""
        self.send(address, command, data)
        return self.listen(extra)

    def listen(self, extra: int = 0) -> bytes:
        """Wait for one status packet."""
        reply = self.link.read(extra + 2, self.link.now_ns() + WAIT_NS)
        if len(reply) != extra + 2 or sum(reply[:-1]) & 0xFF != reply[-1]:
            raise NoReplyError(reply.hex() or "silence")
        return reply[:-1]

    def silent(self, wait_ns: int = WAIT_NS) -> bool:
        """Whether nothing arrives for a while."""
        return self.link.read(1, self.link.now_ns() + wait_ns) == b""

    def wait_ms(self, time_ms: float) -> None:
        """Let time pass."""
        self.link.sleep_until(self.link.now_ns() + round(time_ms * 1e6))

    def status(self, address: int) -> int:
        """The status byte."""
        return self.exchange(address, 0xE)[0]

    def items(self, address: int, mask: int, size: int) -> bytes:
        """Read Status: the ``size`` bytes of the items in ``mask``."""
        return self.exchange(address, 0x3, [mask], size)[1:]

    def position(self, address: int) -> int:
        """The position, by Read Status."""
        return int.from_bytes(self.items(address, 0x01, 4), "little", signed=True)

    def home(self, address: int) -> int:
        """The home register, by Read Status."""
        return int.from_bytes(self.items(address, 0x10, 4), "little", signed=True)

    def start_up(self, count: int, brd: int = 10, baud: int = 115200) -> None:
        """The start-up sequence of section 3.4 (PIC-STEP) and 4.1 (PIC-SERVO); group GROUP led by module 1."""
        self.link.set_baud(19200)
        self.link.write(bytes(16))
        self.wait_ms(10)
        self.link.flush_input()
        for address in range(1, count + 1):
            self.exchange(0, 0x1, [address, 0xFF])
        self.send(0xFF, 0xA, [brd])
        self.wait_ms(5)
        self.link.set_baud(baud)
        for address in range(1, count + 1):
            self.exchange(address, 0xE)
        for address in range(1, count + 1):
            self.exchange(address, 0x1, [address, GROUP & 0x7F if address == 1 else GROUP])


def machine(
    modules: Iterable[Module], seed: int = 1, jitter_ns: int = 0, options: SimOptions | None = None
) -> tuple[Simulation, RawHost]:
    """One bus with ``modules``, powered up and nothing said yet."""
    simulation = build([BusSpec("bus", tuple(modules), jitter_ns)], seed, options)
    return simulation, RawHost(simulation.links[0])


def single(chip: str) -> tuple[Simulation, RawHost]:
    """One module ``A`` alone, a PIC-STEP ("step") or a PIC-SERVO ("servo"), up for 2 ms and not started."""
    module: Module = StepModule("A") if chip == "step" else ServoModule("A")
    simulation, host = machine([module])
    host.wait_ms(2)
    return simulation, host


def mixed(seed: int = 1) -> tuple[Simulation, RawHost]:
    """From the far end to the host: PIC-STEP A, PIC-SERVO B, PIC-STEP C, PIC-SERVO D."""
    return machine([StepModule("A"), ServoModule("B"), StepModule("C"), ServoModule("D")], seed)


def steppers(
    count: int = 1, mode: int = 3, least_speed: int = 1, options: SimOptions | None = None, **spec: object
) -> tuple[Simulation, RawHost, list[PicStep]]:
    """Started PIC-STEPs M1, M2, ... in speed mode bits ``mode``, amplifiers on."""
    specs = [StepModule(f"M{i + 1}", **spec) for i in range(count)]  # type: ignore[arg-type]  # keywords of the spec
    simulation, host = machine(specs, options=options)
    host.start_up(count)
    for address in range(1, count + 1):
        host.exchange(address, 0x6, [mode, least_speed, 200, 50, 0])
        host.exchange(address, 0x7, [0x01])
    host.wait_ms(1)
    return simulation, host, list(simulation.steppers().values())


def servos(
    count: int = 1,
    gains: tuple[int, ...] = FIRM_GAINS,
    options: SimOptions | None = None,
    **spec: object,
) -> tuple[Simulation, RawHost, list[PicServo]]:
    """Started PIC-SERVOs S1, S2, ..., amplifier and servo on, sticky bits clear."""
    specs = [ServoModule(f"S{i + 1}", **spec) for i in range(count)]  # type: ignore[arg-type]  # keywords of the spec
    simulation, host = machine(specs, options=options)
    host.start_up(count)
    for address in range(1, count + 1):
        host.exchange(address, 0x6, struct.pack("<HHHHBBHBB", *gains))
        host.exchange(address, 0x7, [0x05])
        host.exchange(address, 0xB)
    return simulation, host, list(simulation.servos().values())
