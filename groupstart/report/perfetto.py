"""Perfetto trace: every packet of the buses and what was in it, one track a bus and direction, for ui.perfetto.dev.

The file is a sequence of TracePacket messages of Perfetto's protobuf schema (trace_packet.proto, track_event.proto);
only the few fields that slices and counters need are written.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

SLICE_BEGIN, SLICE_END, COUNTER = 1, 2, 4
SEQUENCE = 1


@dataclass(frozen=True, slots=True)
class Slice:
    """Something that lasts, on a track: from begin_ns to end_ns, called ``name``."""

    track: int
    begin_ns: int
    end_ns: int
    name: str


@dataclass(frozen=True, slots=True)
class Sample:
    """The value of a counter track from time_ns on."""

    track: int
    time_ns: int
    value: float


def perfetto_trace(
    tracks: dict[int, str], slices: Iterable[Slice], counters: dict[int, str], samples: Iterable[Sample]
) -> Iterator[bytes]:
    """The file, packet by packet. tracks, counters: names by number (from 1 on)."""
    for number, name in tracks.items():
        yield _packet(_message(60, _uint(1, number) + _text(2, name)))
    for number, name in counters.items():
        yield _packet(_message(60, _uint(1, number) + _text(2, name) + _message(8, b"")))
    for item in slices:
        begin = _uint(9, SLICE_BEGIN) + _uint(11, item.track) + _text(23, item.name)
        yield _packet(_uint(8, item.begin_ns) + _message(11, begin))
        yield _packet(_uint(8, item.end_ns) + _message(11, _uint(9, SLICE_END) + _uint(11, item.track)))
    for sample in samples:
        event = _uint(9, COUNTER) + _uint(11, sample.track) + _double(44, sample.value)
        yield _packet(_uint(8, sample.time_ns) + _message(11, event))


def _packet(content: bytes) -> bytes:
    return _message(1, content + _uint(10, SEQUENCE))


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _uint(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _message(field: int, content: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(content)) + content


def _text(field: int, text: str) -> bytes:
    return _message(field, text.encode("utf-8"))


def _double(field: int, value: float) -> bytes:
    return _varint(field << 3 | 1) + struct.pack("<d", value)
