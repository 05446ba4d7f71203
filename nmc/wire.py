"""Packets on the wire: framing and checksums of both directions (PIC-STEP data sheet section 3.1).

Packing refuses what has no place in a packet; unpacking takes any bytes and never raises.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from nmc.chips.common import DATA_MAX, HEADER
from nmc.errors import LocalFault


@dataclass(frozen=True, slots=True)
class Packet:
    """A command packet found in a byte stream. ``intact``: its checksum is right. ``raw``: the bytes as they came."""

    address: int
    command: int
    data: bytes
    intact: bool
    raw: bytes = field(default=b"", compare=False)


@dataclass(frozen=True, slots=True)
class Noise:
    """Host bytes outside any packet: every module drops them while it waits for a header."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Reply:
    """A status packet: status byte and the bytes between it and the checksum."""

    status: int
    extra: bytes


def checksum(data: bytes) -> int:
    """Low eight bits of the sum of all bytes."""
    return sum(data) & 0xFF


def pack(address: int, command: int, data: bytes = b"") -> bytes:
    """Command packet 0xAA, address, data length and command, data, checksum.

    Raises LocalFault if address, command or data length does not fit its place.
    """
    if not (0 <= address <= 0xFF and 0 <= command <= 0xF and len(data) <= DATA_MAX):
        raise LocalFault(
            f"address {address}, command {command} or {len(data)} data bytes do not fit a packet", rule="section 3.1"
        )
    head = len(data) << 4 | command
    return bytes((HEADER, address, head)) + data + bytes(((address + head + sum(data)) & 0xFF,))


def unpack_reply(raw: bytes, extra_bytes: int) -> Reply | None:
    """The status packet in exactly ``extra_bytes`` + 2 bytes; None if length or checksum is wrong."""
    if len(raw) != extra_bytes + 2 or sum(raw[:-1]) & 0xFF != raw[-1]:
        return None
    return Reply(raw[0], raw[1:-1])


class PacketReader:
    """Finds command packets in host bytes that come in pieces. There is no time-out: a module waits for ever too."""

    def __init__(self) -> None:
        self._held = bytearray()

    @property
    def held(self) -> bytes:
        """Bytes of a packet that is not complete yet."""
        return bytes(self._held)

    def feed(self, data: bytes) -> list[Packet | Noise]:
        """Everything that these bytes complete, in order; a header byte inside a packet is payload."""
        found: list[Packet | Noise] = []
        held = self._held
        held += data
        while held:
            if held[0] != HEADER:
                cut = held.find(HEADER)
                cut = len(held) if cut < 0 else cut
                found.append(Noise(bytes(held[:cut])))
                del held[:cut]
                continue
            if len(held) < 3 or len(held) < (held[2] >> 4) + 4:
                break
            end = (held[2] >> 4) + 4
            intact = sum(held[1 : end - 1]) & 0xFF == held[end - 1]
            found.append(Packet(held[1], held[2] & 0x0F, bytes(held[3 : end - 1]), intact, bytes(held[:end])))
            del held[:end]
        return found
