"""Framing and checksums."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nmc.errors import LocalFault
from nmc.wire import Noise, Packet, PacketReader, pack, unpack_reply


def test_no_operation_to_module_one() -> None:
    assert pack(1, 0xE) == bytes.fromhex("aa 01 0e 0f")


def test_sheet_example_of_a_servo_load() -> None:
    packet = pack(3, 4, b"\x15" + (5).to_bytes(4, "little") + (7).to_bytes(4, "little"))
    assert packet[2] == 0x94
    assert packet[-1] == sum(packet[1:-1]) & 0xFF


@pytest.mark.parametrize(("address", "command", "size"), [(256, 0, 0), (-1, 0, 0), (1, 16, 0), (1, 4, 16)])
def test_what_does_not_fit_is_refused(address: int, command: int, size: int) -> None:
    with pytest.raises(LocalFault):
        pack(address, command, bytes(size))


def test_reply_of_wrong_length_or_sum_is_none() -> None:
    assert unpack_reply(b"\x08\x08", 0) is not None
    assert unpack_reply(b"\x08\x09", 0) is None
    assert unpack_reply(b"\x08", 0) is None
    assert unpack_reply(b"", 0) is None
    assert unpack_reply(b"\x08\x08\x08", 0) is None


def test_header_inside_a_packet_is_payload() -> None:
    packet = pack(0xAA, 4, bytes([0xAA] * 4))
    assert PacketReader().feed(packet) == [Packet(0xAA, 4, bytes([0xAA] * 4), True)]


@given(st.lists(st.binary(max_size=30), max_size=20))
def test_the_reader_takes_any_bytes_and_loses_none(parts: list[bytes]) -> None:
    reader = PacketReader()
    seen = 0
    for part in parts:
        for item in reader.feed(part):
            seen += len(item.data) if isinstance(item, Noise) else len(item.data) + 4
    assert seen + len(reader.held) == sum(map(len, parts))


@given(st.integers(0, 255), st.integers(0, 15), st.binary(max_size=15), st.integers(1, 5))
def test_packets_in_pieces_come_out_whole(address: int, command: int, data: bytes, cut: int) -> None:
    packet = pack(address, command, data)
    reader = PacketReader()
    found = [item for at in range(0, len(packet), cut) for item in reader.feed(packet[at : at + cut])]
    assert found == [Packet(address, command, data, True)]
