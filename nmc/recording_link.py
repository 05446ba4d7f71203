"""A Link around another Link that keeps every byte with its time, for reports and for ``groupstart dump``."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from nmc.link import Link, Root

HOST, STATUS = ">", "<"


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes that passed together. line: ">" from the host, "<" from the modules, "b" a new host baud rate."""

    time_ns: int
    line: str
    data: bytes


class RecordingLink:
    """Records what passes. limit: how many chunks to keep (the oldest are dropped); None: all."""

    def __init__(self, link: Link, *, limit: int | None = None) -> None:
        self.inner = link
        self.chunks: list[Chunk] = []
        self._limit = limit

    def _keep(self, line: str, data: bytes) -> None:
        self.chunks.append(Chunk(self.inner.now_ns(), line, data))
        if self._limit is not None and len(self.chunks) > 2 * self._limit:
            del self.chunks[: -self._limit]

    def now_ns(self) -> int:
        """Time of the inner link."""
        return self.inner.now_ns()

    def write(self, data: bytes) -> None:
        """Record, then hand on."""
        self._keep(HOST, bytes(data))
        self.inner.write(data)

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Read from the inner link and record what came."""
        data = self.inner.read(count, deadline_ns)
        if data:
            self._keep(STATUS, data)
        return data

    def receive(self, count: int) -> bytes:
        """Take what is in from the inner link and record it."""
        data: bytes = self.inner.receive(count)  # type: ignore[attr-defined]  # asked for only where it is shared
        if data:
            self._keep(STATUS, data)
        return data

    @property
    def root(self) -> Root:
        """That of the inner link."""
        return self.inner.root  # type: ignore[attr-defined,no-any-return]

    @property
    def patience_ns(self) -> int:
        """That of the inner link."""
        return self.inner.patience_ns  # type: ignore[attr-defined,no-any-return]

    def sleep_until(self, time_ns: int) -> None:
        """Wait on the inner link."""
        self.inner.sleep_until(time_ns)

    def set_baud(self, baud: int) -> None:
        """Record the new rate, then change it."""
        self._keep("b", str(baud).encode())
        self.inner.set_baud(baud)

    def flush_input(self) -> None:
        """Drop unread bytes of the inner link (they are not recorded: nobody saw them)."""
        self.inner.flush_input()

    def close(self) -> None:
        """Close the inner link."""
        self.inner.close()

    def lines(self) -> Iterator[str]:
        """The record as text, one chunk a line: time in ns, direction, bytes in hex (or the baud rate)."""
        for chunk in self.chunks:
            body = chunk.data.decode() if chunk.line == "b" else chunk.data.hex(" ")
            yield f"{chunk.time_ns} {chunk.line} {body}"


def read_record(lines: Iterable[str]) -> Iterator[Chunk]:
    """Chunks from the text that ``RecordingLink.lines`` writes; empty lines and # comments are skipped.

    Raises ValueError naming the line that is not such a record.
    """
    for number, line in enumerate(lines, start=1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        try:
            time_ns, kind, body = int(words[0]), words[1], words[2:]
            data = " ".join(body).encode() if kind == "b" else bytes(int(word, 16) for word in body)
            if kind not in (HOST, STATUS, "b"):
                raise ValueError
        except (ValueError, IndexError):
            raise ValueError(f"line {number}: expected 'TIME_NS > HEX ...' or 'TIME_NS < HEX ...'") from None
        yield Chunk(time_ns, kind, data)
