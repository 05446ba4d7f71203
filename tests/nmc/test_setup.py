"""The nine steps, the executor and stopping."""

from __future__ import annotations

import pytest

from nmc.bus import Bus
from nmc.errors import LocalFault, RemoteFault
from nmc.executor import play, stop_all
from nmc.program import Evidence, Exchange
from nmc.setup import ModuleExpectation, reset_network, set_group, start_up

STEP, SERVO = ModuleExpectation("pic-step", 1), ModuleExpectation("pic-servo", 4)


def test_nine_steps_in_order(make_link) -> None:
    link = make_link(3, 3, 0)
    infos = start_up(Bus(link), [STEP, STEP, SERVO])
    assert [(i.address, i.chip, i.version, i.group, i.leader) for i in infos] == [
        (1, "pic-step", 1, 0x82, True),
        (2, "pic-step", 1, 0x82, False),
        (3, "pic-servo", 4, 0x82, False),
    ]
    assert link.sent[0] == bytes(16)
    assert [packet[2] for packet in link.sent[1:4]] == [0x21] * 3
    baud_at = next(n for n, packet in enumerate(link.sent) if packet[2] == 0x1A)
    assert link.sent[baud_at] == bytes.fromhex("aa ff 1a 0a 23")
    assert [packet[2] for packet in link.sent[baud_at + 1 :]] == [0x0E] * 3 + [0x21] * 3
    assert link.baud == link.bus_baud == 115200


def test_too_few_modules_are_reported_after_one_recovery(make_link) -> None:
    link = make_link(3)
    with pytest.raises(RemoteFault, match="1 modules on the bus, 2 expected"):
        start_up(Bus(link), [STEP, STEP])


def test_one_module_too_many_is_noticed(make_link) -> None:
    with pytest.raises(RemoteFault, match="at least 2 modules"):
        start_up(Bus(make_link(3, 3)), [STEP], recover=False)


def test_wrong_type_and_version(make_link) -> None:
    with pytest.raises(RemoteFault, match="pic-servo was expected"):
        start_up(Bus(make_link(3)), [SERVO], recover=False)
    with pytest.raises(RemoteFault, match="version 7 was expected"):
        start_up(Bus(make_link(3)), [ModuleExpectation("pic-step", 7)], recover=False)


def test_a_network_left_at_another_rate_is_recovered(make_link) -> None:
    link = make_link(3, 0)
    start_up(Bus(link), [STEP, SERVO])
    again = Bus(link)
    infos = start_up(again, [STEP, SERVO], baud=57600)
    assert [info.chip for info in infos] == ["pic-step", "pic-servo"]
    assert link.bus_baud == 57600


def test_reset_network_ends_at_power_up_state(make_link) -> None:
    link = make_link(3, 3)
    bus = Bus(link)
    start_up(bus, [STEP, STEP])
    reset_network(bus)
    assert [module.address for module in link.modules] == [0, 0]
    assert bus.guard.modules == {}


def test_only_one_leader_a_group(make_link) -> None:
    bus = Bus(make_link(3, 3))
    start_up(bus, [STEP, STEP])
    with pytest.raises(LocalFault, match="already has a leader"):
        set_group(bus, 2, 0x82, leader=True)
    set_group(bus, 1, 0x81, leader=True)
    set_group(bus, 2, 0x82, leader=True)


class Three:
    """A source of three exchanges that keeps what it was told."""

    def __init__(self) -> None:
        self.told: list[Evidence | None] = []

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        self.told.append(evidence)
        return Exchange(len(self.told), 0xE, send_at_ns=now_ns + 1_000_000) if len(self.told) <= 3 else None


def test_play_pulls_one_exchange_at_a_time(make_rig) -> None:
    rig = make_rig(3, 3, 3)
    source = Three()
    evidence = list(play(rig.bus, source))
    assert source.told == [None, *evidence]
    assert [e.exchange.address for e in evidence] == [1, 2, 3]


def test_stop_all_repeats_until_everybody_stands(make_rig) -> None:
    rig = make_rig(3, 0, 3, group=0x81, leader=1)
    rig.modules[2].status = 0x09
    replies = [0]

    def back(data: bytes) -> bytes:
        replies[0] += 1
        if replies[0] == 12:
            rig.modules[2].status = 0x08
        return b"" if replies[0] % 3 == 0 else data

    rig.link.back = back
    assert stop_all(rig.bus) > 1
    assert all((7, b"\x05") in module.executed for module in rig.modules)


def test_a_module_that_will_not_stop_is_named(make_rig) -> None:
    rig = make_rig(3, 3)
    rig.modules[1].status = 0x09
    with pytest.raises(RemoteFault, match="module 2"):
        stop_all(rig.bus, rounds=3)


def test_a_silent_leader_does_not_hold_up_the_other_group(make_rig) -> None:
    rig = make_rig(3, 3, group=0x81, leader=1)
    set_group(rig.bus, 2, 0x82, leader=True)
    rig.link.back = lambda data: b""
    times: list[int] = []
    plain_write = rig.link.write

    def write(data: bytes) -> None:
        times.append(rig.link.time)
        plain_write(data)

    rig.link.write = write
    with pytest.raises(RemoteFault):
        stop_all(rig.bus, rounds=1)
    assert [packet[1] for packet in rig.link.sent[-len(times) :]][:2] == [0x81, 0x82]
    assert times[1] - times[0] < 3_000_000
    assert all((7, b"\x05") in module.executed for module in rig.modules)
