"""A small scripted network: enough of the protocol to test the driver without the simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from nmc.bus import Bus
from nmc.modes import StepTracker
from nmc.servo_modes import ServoTracker
from nmc.setup import ModuleExpectation, start_up
from sim.build import Simulation, build
from sim.spec import BusSpec, ServoModule, StepModule

ITEM_BYTES = (4, 1, 2, 1, 4, 2, 0, 0)


@dataclass
class FakeModule:
    """One module: addresses, status mask and whatever status byte and items the test wants to see."""

    kind: int = 3
    version: int = 1
    status: int = 0x08
    items: dict[int, bytes] = field(default_factory=dict)
    address: int = 0
    group: int = 0xFF
    leader: bool = False
    mask: int = 0
    addr_out_low: bool = False
    executed: list[tuple[int, bytes]] = field(default_factory=list)

    def reply(self, mask: int, status: int) -> bytes:
        body = bytes([status])
        for bit, size in enumerate(ITEM_BYTES):
            if mask >> bit & 1:
                default = bytes([self.kind, self.version]) if bit == 5 else bytes(size)
                body += self.items.get(bit, default)
        return body + bytes([sum(body) & 0xFF])


class FakeLink:
    """Virtual time; replies come after the wire time and 0.4 ms. ``out`` and ``back`` may damage bytes."""

    def __init__(self, modules: list[FakeModule]) -> None:
        self.modules = modules
        self.time = 0
        self.baud = 0
        self.bus_baud = 19200
        self.sent: list[bytes] = []
        self.pending: list[tuple[int, int]] = []
        self.buffer = bytearray()
        self.out: Callable[[bytes], bytes] = lambda data: data
        self.back: Callable[[bytes], bytes] = lambda data: data
        self.sleeps: list[int] = []

    def now_ns(self) -> int:
        return self.time

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def flush_input(self) -> None:
        self.pending = [entry for entry in self.pending if entry[0] > self.time]

    def close(self) -> None:
        pass

    def sleep_until(self, time_ns: int) -> None:
        self.sleeps.append(time_ns)
        self.time = max(self.time, time_ns)

    def read(self, count: int, deadline_ns: int) -> bytes:
        taken = self.pending[:count]
        if len(taken) == count:
            self.time = max(self.time, taken[-1][0])
        else:
            self.time = max(self.time, deadline_ns)
        taken = [entry for entry in taken if entry[0] <= self.time]
        del self.pending[: len(taken)]
        return bytes(byte for _, byte in taken)

    def write(self, data: bytes) -> None:
        self.sent.append(bytes(data))
        byte_ns = 10_000_000_000 // (self.baud or 19200)
        done = self.time + len(data) * byte_ns
        if self.baud == self.bus_baud:
            self.buffer += self.out(bytes(data))
        for reply in self._take():
            at = done + 400_000
            for byte in self.back(reply):
                at += byte_ns
                self.pending.append((at, byte))

    def _take(self) -> list[bytes]:
        replies: list[bytes] = []
        while True:
            start = self.buffer.find(0xAA)
            if start < 0:
                self.buffer.clear()
                return replies
            del self.buffer[:start]
            if len(self.buffer) < 3 or len(self.buffer) < (self.buffer[2] >> 4) + 4:
                return replies
            end = (self.buffer[2] >> 4) + 4
            packet = bytes(self.buffer[:end])
            del self.buffer[:end]
            replies += self._obey(packet)

    def _obey(self, packet: bytes) -> list[bytes]:
        address, command, data = packet[1], packet[2] & 15, packet[3:-1]
        good = sum(packet[1:-1]) & 0xFF == packet[-1]
        replies = []
        alive = True
        for module in self.modules:
            if not alive:
                break
            alive = module.addr_out_low
            mine = address == module.address
            if not mine and address != module.group and not (command == 15 and address == 0xFF):
                continue
            mask = data[0] if command in (2, 3) and good else module.mask
            if command != 15 and (mine or module.leader):
                replies.append(module.reply(mask, module.status | (0 if good else 2)))
            if good:
                module.executed.append((command, data))
                self._apply(module, command, data)
        return replies

    def _apply(self, module: FakeModule, command: int, data: bytes) -> None:
        if command == 1:
            module.address, module.group = data[0], data[1] | 0x80
            module.leader, module.addr_out_low = not data[1] & 0x80, True
        elif command == 2:
            module.mask = data[0]
        elif command == 10:
            self.bus_baud = {129: 9600, 63: 19200, 20: 57600, 10: 115200}[data[0]]
        elif command == 15:
            module.address, module.group, module.leader, module.mask = 0, 0xFF, False, 0
            module.addr_out_low = False
            self.bus_baud = 19200


@dataclass
class Rig:
    """A bus on a fake link with its modules addressed 1, 2, ... and enrolled."""

    link: FakeLink
    bus: Bus

    @property
    def modules(self) -> list[FakeModule]:
        return self.link.modules


@pytest.fixture
def make_rig() -> Callable[..., Rig]:
    """Rig with these module kinds (3 PIC-STEP, 0 PIC-SERVO), addressed and guarded, at 115200 baud."""

    def make(*kinds: int, group: int = 0x81, leader: int = 0) -> Rig:
        modules = [FakeModule(kind, 1 if kind == 3 else 4, 0x08 if kind == 3 else 0x19) for kind in kinds]
        link = FakeLink(modules)
        link.bus_baud = 115200
        bus = Bus(link)
        bus.set_host_baud(115200)
        for address, module in enumerate(modules, start=1):
            module.address, module.group, module.addr_out_low = address, group, True
            module.leader = address == leader
            tracker = StepTracker(address) if module.kind == 3 else ServoTracker(address)
            tracker.group, tracker.leader = group, module.leader
            bus.guard.enrol(tracker)
        return Rig(link, bus)

    return make


@pytest.fixture
def make_link() -> Callable[..., FakeLink]:
    """A powered-up network of these module kinds, nobody addressed."""
    return lambda *kinds: FakeLink([FakeModule(kind, 1 if kind == 3 else 4) for kind in kinds])


@pytest.fixture
def simulated() -> Callable[..., tuple[Simulation, Bus]]:
    """A simulated bus of these modules, started up at 115200 baud."""

    def make(*modules: StepModule | ServoModule, jitter_ns: int = 0, seed: int = 1) -> tuple[Simulation, Bus]:
        simulation = build([BusSpec("bus", modules, host_jitter_max_ns=jitter_ns)], seed)
        bus = Bus(simulation.links[0])
        chips = ["pic-servo" if isinstance(module, ServoModule) else "pic-step" for module in modules]
        start_up(bus, [ModuleExpectation(chip) for chip in chips])
        return simulation, bus

    return make


@pytest.fixture
def steppers(simulated: Callable[..., tuple[Simulation, Bus]]) -> Callable[..., tuple[Simulation, Bus]]:
    """A simulated bus of PIC-STEPs, one if nothing is said, started up at 115200 baud."""

    def make(*modules: StepModule, jitter_ns: int = 0, seed: int = 1) -> tuple[Simulation, Bus]:
        return simulated(*(modules or (StepModule("x"),)), jitter_ns=jitter_ns, seed=seed)

    return make
