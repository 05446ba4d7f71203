"""One command in flight, exact replies, careful retries."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from nmc.errors import LinkTimeout, LocalFault, RemoteFault
from nmc.program import Exchange

NOP, DEFINE, READ, START, LOAD, STOP = 0xE, 2, 3, 5, 4, 7
COUNT_LOAD = Exchange(1, LOAD, bytes([0x08]) + (60000).to_bytes(2, "little") + b"\x01")
RUN_LOAD = Exchange(1, LOAD, bytes([0x09]) + (500).to_bytes(4, "little") + (60000).to_bytes(2, "little") + b"\x01")
PARAMETERS = Exchange(1, 6, bytes([0, 1, 10, 5, 0]))


def drop_first(count: int) -> Callable[[bytes], bytes]:
    left = [count]

    def tamper(data: bytes) -> bytes:
        if left[0] and data:
            left[0] -= 1
            return b""
        return data

    return tamper


def test_reply_length_follows_the_defined_mask(make_rig) -> None:
    rig = make_rig(3)
    assert rig.bus.exchange(Exchange(1, NOP)).extra == b""
    assert len(rig.bus.exchange(Exchange(1, DEFINE, b"\x01")).extra) == 4
    assert len(rig.bus.exchange(Exchange(1, NOP)).extra) == 4
    assert len(rig.bus.exchange(Exchange(1, READ, b"\x3f")).extra) == 14
    assert len(rig.bus.exchange(Exchange(1, NOP)).extra) == 4


def test_a_read_is_repeated_a_start_is_not(make_rig) -> None:
    rig = make_rig(3)
    rig.link.back = drop_first(1)
    assert rig.bus.exchange(Exchange(1, READ, b"\x01")).status == 0x08
    assert (rig.bus.counters.retries, rig.bus.counters.timeouts) == (1, 1)
    rig.bus.exchange(PARAMETERS)
    rig.bus.exchange(RUN_LOAD)
    rig.link.back = drop_first(1)
    with pytest.raises(LinkTimeout):
        rig.bus.exchange(Exchange(1, START))
    assert [command for command, _ in rig.modules[0].executed].count(START) == 1


def test_a_load_is_repeated_but_not_with_start_now(make_rig) -> None:
    rig = make_rig(3)
    rig.bus.exchange(PARAMETERS)
    rig.link.back = drop_first(1)
    rig.bus.exchange(RUN_LOAD)
    now = Exchange(1, LOAD, bytes([RUN_LOAD.data[0] | 0x80]) + RUN_LOAD.data[1:])
    rig.link.back = drop_first(1)
    with pytest.raises(LinkTimeout):
        rig.bus.exchange(now)
    assert [command for command, _ in rig.modules[0].executed].count(LOAD) == 3


def test_three_failures_are_reported_and_the_line_is_silent_afterwards(make_rig) -> None:
    rig = make_rig(3)
    rig.link.back = drop_first(3)
    with pytest.raises(LinkTimeout):
        rig.bus.exchange(Exchange(1, NOP))
    assert rig.bus.counters.resyncs == 3
    assert rig.bus.exchange(Exchange(1, NOP)).status == 0x08


def test_a_damaged_reply_is_never_taken(make_rig) -> None:
    rig = make_rig(3)
    flips = [True]

    def flip(data: bytes) -> bytes:
        if flips:
            flips.pop()
            return bytes([data[0] ^ 4]) + data[1:]
        return data

    rig.link.back = flip
    assert rig.bus.exchange(Exchange(1, NOP)).status == 0x08
    assert rig.bus.counters.damaged_replies == 1


def test_a_rejected_start_is_known_not_to_have_run(make_rig) -> None:
    rig = make_rig(3)
    rig.bus.exchange(PARAMETERS)
    rig.bus.exchange(RUN_LOAD)
    rig.link.out = lambda data: data[:-1] + bytes([data[-1] ^ 1])
    with pytest.raises(RemoteFault) as caught:
        rig.bus.exchange(Exchange(1, START))
    assert caught.value.executed is False
    rig.link.out = lambda data: data
    rig.bus.exchange(Exchange(1, START))


def test_after_a_lost_start_only_a_stop_helps(make_rig) -> None:
    rig = make_rig(3)
    rig.bus.exchange(PARAMETERS)
    rig.bus.exchange(RUN_LOAD)
    rig.modules[0].status = 0x09
    rig.link.back = drop_first(1)
    with pytest.raises(LinkTimeout):
        rig.bus.exchange(Exchange(1, START))
    with pytest.raises(LocalFault, match="unknown"):
        rig.bus.exchange(COUNT_LOAD)
    rig.bus.exchange(Exchange(1, STOP, b"\x05"))
    rig.bus.exchange(RUN_LOAD)


def test_after_a_lost_define_status_only_a_definition_helps(make_rig) -> None:
    rig = make_rig(3)
    rig.link.back = drop_first(3)
    with pytest.raises(LinkTimeout):
        rig.bus.exchange(Exchange(1, DEFINE, b"\x01"))
    with pytest.raises(LocalFault, match="Define Status"):
        rig.bus.exchange(Exchange(1, NOP))
    assert len(rig.bus.exchange(Exchange(1, READ, b"\x01")).extra) == 4
    rig.bus.exchange(Exchange(1, DEFINE, b"\x00"))
    rig.bus.exchange(Exchange(1, NOP))


def test_a_leaderless_group_is_waited_out(make_rig) -> None:
    rig = make_rig(3, 3)
    before = rig.link.time
    evidence = rig.bus.exchange(Exchange(0x81, 0xC))
    assert evidence.status is None
    wire_ns = 4 * 10_000_000_000 // 115200
    assert rig.link.time - before >= wire_ns + 512_000


def test_a_leader_answers_for_its_group(make_rig) -> None:
    rig = make_rig(3, 3, leader=2)
    assert rig.bus.exchange(Exchange(0x81, 0xC)).status == 0x08
    assert all(module.executed == [(0xC, b"")] for module in rig.modules)


def test_nothing_leaves_before_its_time_and_lateness_is_counted(make_rig) -> None:
    rig = make_rig(3)
    evidence = rig.bus.exchange(Exchange(1, NOP, send_at_ns=5_000_000))
    assert evidence.sent_ns == 5_000_000
    assert rig.bus.counters.late == 0
    rig.bus.exchange(Exchange(1, NOP, send_at_ns=1))
    assert rig.bus.counters.late == 1


def test_a_servo_gets_at_most_a_thousand_commands_a_second(make_rig) -> None:
    rig = make_rig(0)
    times = [rig.bus.exchange(Exchange(1, NOP)).sent_ns for _ in range(10)]
    assert min(b - a for a, b in itertools.pairwise(times)) >= 1_000_000


def test_armed_fault_bits_raise(make_rig) -> None:
    rig = make_rig(3)
    rig.bus.arm_faults(1, low=0x08)
    rig.bus.exchange(Exchange(1, NOP))
    rig.modules[0].status = 0
    with pytest.raises(RemoteFault, match="power_sense is clear"):
        rig.bus.exchange(Exchange(1, NOP))
    rig.bus.exchange(Exchange(1, STOP, b"\x04"))


def test_no_byte_leaves_with_an_illegal_command(make_rig) -> None:
    rig = make_rig(3, 0)
    for bad in (
        COUNT_LOAD,  # before Set Parameters
        Exchange(1, DEFINE, b"\x40"),
        Exchange(1, 0xB),
        Exchange(2, 0xD),
        Exchange(1, 0xA, b"\x0a"),
        Exchange(1, 0xF),
        Exchange(1, STOP, b"\x0c"),
        Exchange(1, 1, b"\x02\xff"),
        Exchange(0x81, 1, b"\x05\xff"),
        Exchange(2, LOAD, b"\x90"),
        Exchange(2, START),
    ):
        with pytest.raises(LocalFault):
            rig.bus.exchange(bad)
    assert rig.link.sent == []
