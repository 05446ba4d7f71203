"""Random legal and illegal commands on four mixed modules, with bytes flipped, dropped and inserted on both lines.

Every module has a mark of its own in its home register, so an answer taken from the wrong module shows at once.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from nmc.bus import Bus
from nmc.errors import LocalFault, NmcError
from nmc.executor import stop_all
from nmc.program import Exchange
from nmc.setup import ModuleExpectation, start_up
from sim.build import build
from sim.spec import BusSpec, ServoModule, StepModule

CHIPS = ["pic-step", "pic-servo", "pic-step", "pic-servo"]
ADDRESSES = (1, 2, 3, 4)
HANG_NS = 2_000_000_000
DAMAGES = ("none", "flip", "drop", "insert", "cut")


class NoisyLink:
    """Damages bytes on their way, by a seeded generator, while it is switched on."""

    def __init__(self, link) -> None:
        self.link = link
        self.outward = "none"
        self.inward = "none"
        self.dice = np.random.default_rng(0)

    def __getattr__(self, name: str):
        return getattr(self.link, name)

    def _damage(self, data: bytes, how: str) -> bytes:
        if not data or how == "none":
            return data
        at = int(self.dice.integers(len(data)))
        if how == "flip":
            return data[:at] + bytes([data[at] ^ 1 << int(self.dice.integers(8))]) + data[at + 1 :]
        if how == "drop":
            return data[:at] + data[at + 1 :]
        if how == "insert":
            return data[:at] + self.dice.bytes(1) + data[at:]
        return data[:at]

    def write(self, data: bytes) -> None:
        how, self.outward = self.outward, "none"
        self.link.write(self._damage(data, how))

    def read(self, count: int, deadline_ns: int) -> bytes:
        data = self.link.read(count, deadline_ns)
        how, self.inward = self.inward, "none"
        return self._damage(data, how)[:count]


class Commands(RuleBasedStateMachine):
    """The driver never hangs, never mistakes an answer, always comes back to a known state."""

    @initialize(seed=st.integers(0, 2**16))
    def power_up(self, seed: int) -> None:
        modules = (StepModule("a"), ServoModule("b"), StepModule("c"), ServoModule("d"))
        self.simulation = build([BusSpec("bus", modules, host_jitter_max_ns=200_000)], seed)
        self.noise = NoisyLink(self.simulation.links[0])
        self.noise.dice = np.random.default_rng(seed)
        self.bus = Bus(self.noise, grace_ns=5_000_000)
        start_up(self.bus, [ModuleExpectation(chip) for chip in CHIPS])
        for address in ADDRESSES:
            self.send(address, 2, bytes([0x20]))
        self.types = dict(zip(ADDRESSES, (3, 0, 3, 0), strict=True))

    def send(self, address: int, command: int, data: bytes):
        """One exchange; whatever happens takes bounded virtual time."""
        before_ns = self.bus.link.now_ns()
        sent = self.bus.counters.bytes_out
        try:
            return self.bus.exchange(Exchange(address, command, data, reply_extra=None if address > 127 else 0))
        except LocalFault:
            assert self.bus.counters.bytes_out == sent, "a refused command left bytes on the wire"
            return None
        except NmcError:
            return None
        finally:
            assert self.bus.link.now_ns() - before_ns < HANG_NS

    def check_answer(self, address: int, evidence) -> None:
        """Type and version in every answer tell who spoke, if the damage did not hit a checksum's blind spot."""
        tracker = self.bus.guard.modules.get(address)
        if evidence is None or evidence.status is None or tracker is None or tracker.mask is None:
            return
        if tracker.mask & 0x20:
            assert evidence.extra[-2] == self.types[address], "another module's answer was taken"

    @rule(address=st.sampled_from(ADDRESSES), outward=st.sampled_from(DAMAGES), inward=st.sampled_from(DAMAGES))
    def ask(self, address: int, outward: str, inward: str) -> None:
        self.noise.outward, self.noise.inward = outward, inward
        self.check_answer(address, self.send(address, 0xE, b""))

    @rule(
        address=st.sampled_from([*ADDRESSES, 0x81, 0x82, 0xFF, 7]),
        command=st.sampled_from([0, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14]),
        data=st.binary(max_size=15),
        outward=st.sampled_from(DAMAGES),
        inward=st.sampled_from(DAMAGES),
    )
    def anything(self, address: int, command: int, data: bytes, outward: str, inward: str) -> None:
        self.noise.outward, self.noise.inward = outward, inward
        self.send(address, command, data)

    @rule(address=st.sampled_from((1, 3)), outputs=st.integers(0, 31), outward=st.sampled_from(DAMAGES))
    def what_is_acknowledged_is_done(self, address: int, outputs: int, outward: str) -> None:
        module = self.simulation.modules["abcd"[address - 1]]
        for command, data in ((8, bytes([outputs])), (2, b"\x28"), (7, b"\x05")):
            self.noise.outward = outward
            done = self.send(address, command, data) is not None
            self.bus.link.sleep_until(self.bus.link.now_ns() + 1_000_000)
            if done:
                assert {8: module.outputs == outputs, 2: module.mask == 0x28, 7: not module.moving}[command]

    @rule(address=st.sampled_from((1, 3)), goal=st.integers(-3000, 3000), count=st.integers(50000, 64000))
    def run_a_stepper(self, address: int, goal: int, count: int) -> None:
        self.send(address, 6, bytes([0, 1, 9, 5, 0]))
        self.send(address, 7, b"\x05")
        tail = count.to_bytes(2, "little") + b"\x05"
        self.send(address, 4, bytes([0x89 if goal > 0 else 0x99]) + goal.to_bytes(4, "little", signed=True) + tail)
        self.send(address, 4, b"\x88" + tail)

    @rule(address=st.sampled_from((2, 4)), goal=st.integers(-3000, 3000), damage=st.sampled_from(DAMAGES))
    def run_a_servo(self, address: int, goal: int, damage: str) -> None:
        gains = b"".join(v.to_bytes(2, "little") for v in (220, 2640, 150, 4000)) + b"\xff\x00\xa0\x0f\x01\x00"
        self.send(address, 6, gains)
        self.send(address, 7, b"\x05")
        self.noise.outward = damage
        numbers = b"".join(v.to_bytes(4, "little", signed=True) for v in (goal, 400_000, 900))
        self.send(address, 4, b"\x97" + numbers)

    @rule(
        address=st.sampled_from(ADDRESSES),
        individual=st.sampled_from([*ADDRESSES, 9]),
        group=st.sampled_from([0x81, 0x82, 0xFF, 0x01, 0x02]),
        outward=st.sampled_from(DAMAGES),
        inward=st.sampled_from(DAMAGES),
    )
    def regroup(self, address: int, individual: int, group: int, outward: str, inward: str) -> None:
        self.noise.outward, self.noise.inward = outward, inward
        self.send(address, 1, bytes([individual if individual == 9 and group == 0xFF else address, group]))

    @rule(group=st.sampled_from([0x81, 0x82]), command=st.sampled_from([5, 7, 12, 14]), damage=st.sampled_from(DAMAGES))
    def to_a_group(self, group: int, command: int, damage: str) -> None:
        self.noise.outward = damage
        self.send(group, command, b"\x05" if command == 7 else b"")

    @rule(data=st.binary(min_size=1, max_size=40))
    def babble(self, data: bytes) -> None:
        """Bytes that no driver would send. A packet among them would be a command nobody knows of: none is let in."""
        self.simulation.links[0].write(data.replace(b"\xaa", b"\xab"))
        self.bus.resync()

    @rule(ms=st.integers(1, 300))
    def wait(self, ms: int) -> None:
        self.bus.link.sleep_until(self.bus.link.now_ns() + ms * 1_000_000)

    @precondition(lambda self: hasattr(self, "bus"))
    @rule()
    def come_back_to_a_known_state(self) -> None:
        """On a quiet line everything can be stopped and everybody answers as himself."""
        modules = self.bus.guard.modules
        if set(modules) != set(ADDRESSES) or any(tracker.address_unsure for tracker in modules.values()):
            start_up(self.bus, [ModuleExpectation(chip) for chip in CHIPS])
        stop_all(self.bus)
        for address in ADDRESSES:
            evidence = self.bus.exchange(Exchange(address, 2, bytes([0x20])))
            assert evidence.extra[0] == self.types[address]
            tracker = self.bus.guard.modules[address]
            assert not tracker.unsure
            assert tracker.mask == 0x20
        for name in "ac":
            assert not self.simulation.modules[name].moving

    @invariant()
    def simulator_is_alive(self) -> None:
        if hasattr(self, "simulation"):
            self.simulation.trace()

    def teardown(self) -> None:
        if hasattr(self, "bus"):
            self.come_back_to_a_known_state()


TestCommands = Commands.TestCase
TestCommands.settings = settings(stateful_step_count=25, suppress_health_check=list(HealthCheck))


@pytest.mark.slow
def test_more_of_it() -> None:
    """The same for many more random sequences."""
    from hypothesis.stateful import run_state_machine_as_test

    run_state_machine_as_test(
        Commands,
        settings=settings(
            max_examples=15 * settings.default.max_examples,
            stateful_step_count=40,
            suppress_health_check=list(HealthCheck),
        ),
    )
