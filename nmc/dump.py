"""Bytes as decoded packets: both directions, with times and with what the data sheets do not allow.

A dump follows the protocol from outside: addresses and groups from Set Address, reply lengths from Define Status,
chip types from the type and version that modules report. What it cannot know yet it shows as hex.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from nmc.chips.common import (
    ADDRESSING_COMMANDS,
    DEFAULT_GROUP,
    DEFINE_STATUS,
    HARD_RESET,
    LOAD_TRAJECTORY,
    MEMBER_BIT,
    READ_STATUS,
    SET_ADDRESS,
    START_MOTION,
    STATUS_COMM_ERROR,
    ChipFacts,
)
from nmc.chips.picstep import LOAD_POSITION, LOAD_START_NOW
from nmc.codec import Decoded, decode, decode_status
from nmc.errors import LocalFault, NmcError
from nmc.modes import Tracker
from nmc.recording_link import HOST, STATUS, Chunk
from nmc.setup import CHIPS, ITEM_TYPE_VERSION, ModuleInfo, make_tracker
from nmc.wire import Noise, Packet, PacketReader, checksum

QUIET_NS = 2_000_000
"""Bytes outside packets that are closer together than this belong together."""
_COMMON = ChipFacts("module", -1, 0, {fact.code: fact for fact in ADDRESSING_COMMANDS}, (), (), {}, (0,) * 256)
"""Stands in for a module that has not said what it is."""


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a dump. direction ">" host, "<" modules, "!" a remark. complaints: violations of the sheets."""

    time_ns: int
    direction: str
    words: str
    raw: bytes = b""
    complaints: tuple[str, ...] = ()

    def text(self) -> str:
        """Time in ms, direction, words, bytes, complaints."""
        tail = "".join(f"\n{'':15}! {complaint}" for complaint in self.complaints)
        return f"{self.time_ns / 1e6:13.4f} {self.direction} {self.words:<56} {self.raw.hex(' ')}{tail}".rstrip()


@dataclass(slots=True)
class _Seat:
    """What the dump knows of one address."""

    tracker: Tracker | None = None
    group: int = DEFAULT_GROUP
    leader: bool = False
    mask: int = 0


@dataclass(slots=True)
class _Open:
    """A command that waits for its answer."""

    packet: Packet
    seats: tuple[int, ...]
    answers: int | None
    mask: int
    legal: bool = True


@dataclass(slots=True)
class Dump:
    """Decoder of a byte stream that comes in pieces; ``feed`` gives the lines that are complete.

    facts: chip to assume where the stream has not told the type, None: commands common to all chips only.
    """

    facts: ChipFacts | None = None
    _reader: PacketReader = field(default_factory=PacketReader)
    _seats: dict[int, _Seat] = field(default_factory=dict)
    _open: _Open | None = None
    _held: bytearray = field(default_factory=bytearray)
    _held_ns: int = 0
    _packet_ns: int = 0
    _noise: bytearray = field(default_factory=bytearray)
    _noise_ns: int = 0
    _noise_end_ns: int = 0

    def feed(self, chunk: Chunk) -> Iterator[Line]:
        """Lines that this chunk completes."""
        if chunk.line == HOST:
            if not self._reader.held:
                self._packet_ns = chunk.time_ns
            yield from self._close_answer()
            for item in self._reader.feed(chunk.data):
                if isinstance(item, Noise):
                    if self._noise and chunk.time_ns - self._noise_end_ns > QUIET_NS:
                        yield from self._quiet()
                    self._noise_ns = self._noise_ns if self._noise else self._packet_ns
                    self._noise += item.data
                    self._noise_end_ns = chunk.time_ns
                else:
                    yield from self._quiet()
                    yield self._command(self._packet_ns, item)
                    self._packet_ns = chunk.time_ns
        elif chunk.line == STATUS:
            yield from self._quiet()
            if not self._held:
                self._held_ns = chunk.time_ns
            self._held += chunk.data
            wanted = self._reply_bytes()
            if wanted is not None and len(self._held) >= wanted:
                yield from self._close_answer()
        else:
            yield from self._quiet()
            yield Line(chunk.time_ns, "!", f"host rate {chunk.data.decode(errors='replace')} baud")

    def finish(self) -> Iterator[Line]:
        """Whatever is held back, at the end of a stream."""
        yield from self._quiet()
        yield from self._close_answer()

    def _quiet(self) -> Iterator[Line]:
        """The bytes outside packets that have come one after another."""
        if self._noise:
            raw = bytes(self._noise)
            self._noise.clear()
            yield Line(self._noise_ns, HOST, _noise_words(raw), raw)

    def _close_answer(self) -> Iterator[Line]:
        """The answer that is held so far, whole or not."""
        if self._held:
            raw = bytes(self._held)
            self._held.clear()
            yield self._answer(self._held_ns, raw)
        self._open = None

    def _facts(self, addresses: tuple[int, ...]) -> ChipFacts | None:
        for address in addresses:
            seat = self._seats.get(address)
            if seat is not None and seat.tracker is not None:
                return seat.tracker.facts
        return self.facts

    def _members(self, address: int) -> tuple[int, ...]:
        if address in self._seats:
            return (address,)
        members = tuple(a for a, seat in self._seats.items() if seat.group == address)
        return members if members or address >= MEMBER_BIT else (address,)

    def _command(self, time_ns: int, packet: Packet) -> Line:
        seats = self._members(packet.address)
        facts = self._facts(seats)
        single = packet.address in self._seats or packet.address < MEMBER_BIT
        answers = packet.address if single else next((a for a in seats if self._seats[a].leader), None)
        mask = self._seats.get(answers if answers is not None else -1, _Seat()).mask
        if packet.command in (DEFINE_STATUS, READ_STATUS) and packet.data:
            mask = packet.data[0]
        opened = self._open = _Open(packet, seats, answers, mask)
        who = f"{packet.address:3d}" if single else f"g{packet.address:02X}"
        if not packet.intact:
            opened.legal = False
            return Line(
                time_ns, HOST, f"{who} damaged packet", packet.raw, ("wrong checksum: not executed (section 3.1)",)
            )
        decoded = decode(facts or _COMMON, packet.command, packet.data)
        values = _value_words(decoded)
        complaints = decoded.complaints if facts is not None and not self._has_tracker(seats) else ()
        complaints = tuple(dict.fromkeys(complaints + self._judge(packet, seats)))
        opened.legal = not complaints
        self._follow(packet, seats)
        if answers is None:
            self._settle(opened, None, b"")
        return Line(time_ns, HOST, f"{who} {decoded.name} {values}".rstrip(), packet.raw, complaints)

    def _has_tracker(self, addresses: tuple[int, ...]) -> bool:
        return any(address in self._seats and self._seats[address].tracker is not None for address in addresses)

    def _judge(self, packet: Packet, seats: tuple[int, ...]) -> tuple[str, ...]:
        """What the mode guards of the modules concerned say to this command."""
        found = []
        for address in seats:
            seat = self._seats.get(address)
            if seat is None or seat.tracker is None or packet.command == SET_ADDRESS:
                continue
            if packet.command == START_MOTION and seat.tracker.awaits_rest:
                seat.tracker.at_rest()  # nothing on the wire need say that it has arrived
            try:
                seat.tracker.check(packet.command, packet.data, endless=True, for_rest=_may_wait(packet))
            except LocalFault as fault:
                found.append(str(fault))
        return tuple(found)

    def _follow(self, packet: Packet, seats: tuple[int, ...]) -> None:
        if packet.command == SET_ADDRESS and len(packet.data) == 2 and len(seats) <= 1:
            seat = self._seats.pop(seats[0], _Seat()) if seats else _Seat()
            seat.group, seat.leader = packet.data[1] | MEMBER_BIT, not packet.data[1] & MEMBER_BIT
            self._seats[packet.data[0]] = seat
        elif packet.command == HARD_RESET:
            self._seats.clear()
        elif packet.command == DEFINE_STATUS and packet.data:
            for address in seats:
                self._seats.setdefault(address, _Seat()).mask = packet.data[0]

    def _reply_bytes(self) -> int | None:
        if self._open is None or self._open.answers is None:
            return None
        facts = self._facts((self._open.answers,)) or next(iter(CHIPS.values()))
        return facts.status_bytes[self._open.mask] + 2

    def _answer(self, time_ns: int, raw: bytes) -> Line:
        opened = self._open
        if len(raw) < 2 or checksum(raw[:-1]) != raw[-1]:
            return Line(time_ns, STATUS, "damaged answer", raw, ("wrong checksum or length (section 3.1)",))
        if opened is None or opened.answers is None:
            return Line(time_ns, STATUS, "answer to nothing", raw, ("nobody was asked",))
        address = opened.answers
        self._learn(address, opened.mask, raw)
        facts = self._facts((address,))
        if facts is None:
            return Line(time_ns, STATUS, f"{address:3d} status {raw[0]:02X}", raw)
        self._settle(opened, address, raw)
        status = decode_status(facts, raw[0], opened.mask, raw[1:-1])
        flags = ",".join(sorted(status.flags)) or "-"
        values = " ".join(f"{n}={v}" for n, v in status.values.items() if "." not in n or v)
        complaints: tuple[str, ...] = ()
        if raw[0] & STATUS_COMM_ERROR:
            complaints = ("the module reports a communications error",)
        return Line(time_ns, STATUS, f"{address:3d} {flags} {values}".rstrip(), raw, complaints)

    def _learn(self, address: int, mask: int, raw: bytes) -> None:
        """A module that says what it is gets a tracker."""
        seat = self._seats.setdefault(address, _Seat())
        if mask & ITEM_TYPE_VERSION and seat.tracker is None:
            for facts in CHIPS.values():
                at = 1 + facts.status_bytes[mask & (ITEM_TYPE_VERSION - 1)]
                if len(raw) > at + 2 and raw[at] == facts.device_type:
                    info = ModuleInfo(address, raw[at], raw[at + 1], facts.name, raw[0])
                    seat.tracker = make_tracker(info)
                    seat.tracker.mask = seat.mask
                    return

    def _settle(self, opened: _Open, answered: int | None, raw: bytes) -> None:
        """Let the mode guards follow a legal command once it has been carried out."""
        packet = opened.packet
        if not opened.legal or packet.command == SET_ADDRESS or (raw and raw[0] & STATUS_COMM_ERROR):
            return
        for address in opened.seats:
            tracker = self._seats.get(address, _Seat()).tracker
            if tracker is None:
                continue
            if address != answered:
                tracker.executed(packet.command, packet.data)
                continue
            with contextlib.suppress(NmcError):  # an endless run is told of by the complaints that follow
                tracker.answered(packet.command, packet.data, raw[0], raw[1:-1])


def dump_lines(chunks: Iterable[Chunk], facts: ChipFacts | None = None) -> Iterator[Line]:
    """All lines of a recorded stream."""
    dump = Dump(facts)
    for chunk in chunks:
        yield from dump.feed(chunk)
    yield from dump.finish()


def chunks_of_bytes(
    times_ns: Iterable[int], lines: Iterable[int], data: Iterable[int], bus: int = 0
) -> Iterator[Chunk]:
    """Chunks from a trace's bus log: one byte each, ``line`` = 2 * bus + 0 host, 1 status; other buses are left out."""
    for time_ns, line, byte in zip(times_ns, lines, data, strict=True):
        if int(line) >> 1 == bus:
            yield Chunk(int(time_ns), STATUS if int(line) & 1 else HOST, bytes((int(byte),)))


def _may_wait(packet: Packet) -> bool:
    """A stop position that is loaded and not started may be meant for the coming rest."""
    if packet.command != LOAD_TRAJECTORY or not packet.data:
        return False
    return packet.data[0] & (LOAD_POSITION | LOAD_START_NOW) == LOAD_POSITION


def _value_words(decoded: Decoded) -> str:
    """Fields with their values, control bits by name where they are set; "loaded" bits are told by their fields."""
    words = []
    for name, value in decoded.values.items():
        if name in decoded.control:
            if value and not name.endswith("_loaded"):
                words.append(name if value == 1 else f"{name}={value}")
        else:
            words.append(f"{name}={value}")
    return " ".join(words)


def _noise_words(data: bytes) -> str:
    return f"{len(data)} nulls" if not any(data) else f"{len(data)} bytes outside any packet"
