"""Where a program's bytes come from: a text in memory or a file read piece by piece, as chunks of whole lines."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

CHUNK_BYTES = 1 << 18
"""A chunk and its tables stay in the cache of the processor."""


class Source(Protocol):
    """A program. ``chunks`` gives pieces that end with a newline; ``text`` the whole."""

    def chunks(self) -> Iterator[bytes]:
        """The program in pieces of whole lines."""

    def text(self) -> str:
        """The whole program."""


def unified(data: bytes) -> bytes:
    """Byte order mark dropped, CR alone as a line end, a newline at the very end."""
    if data.startswith(b"\xef\xbb\xbf"):
        data = data[3:]
    if b"\r" in data and data.count(b"\r") != data.count(b"\r\n"):
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data if not data or data.endswith(b"\n") else data + b"\n"


class TextSource:
    """A program in memory."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._data = unified(text.encode("utf-8", "surrogateescape"))

    def chunks(self) -> Iterator[bytes]:
        """Pieces of about ``CHUNK_BYTES``."""
        data, start = self._data, 0
        while start < len(data):
            stop = data.rfind(b"\n", start, start + CHUNK_BYTES) + 1
            if stop == 0:
                stop = data.find(b"\n", start) + 1
            yield data[start:stop]
            start = stop

    def text(self) -> str:
        """The program."""
        return self._text


class FileSource:
    """A program in a file; only one piece of it is in memory. Files with CR alone as line end are read whole."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def chunks(self) -> Iterator[bytes]:
        """Pieces of about ``CHUNK_BYTES``. Raises OSError."""
        with self._path.open("rb") as file:
            rest = file.read(CHUNK_BYTES)
            if b"\r" in rest and unified(rest).count(b"\r") == 0:
                yield from TextSource(self.text()).chunks()
                return
            if rest.startswith(b"\xef\xbb\xbf"):
                rest = rest[3:]
            while True:
                stop = rest.rfind(b"\n") + 1
                if stop:
                    yield rest[:stop]
                    rest = rest[stop:]
                more = file.read(CHUNK_BYTES)
                if not more:
                    break
                rest += more
        if rest:
            yield rest + b"\n"

    def text(self) -> str:
        """The whole file. Raises OSError."""
        return self._path.read_text(encoding="utf-8", errors="surrogateescape")


def percent_follows(source: Source) -> bool:
    """Whether a lone percent sign stands anywhere behind the first one."""
    lone = sum(line.strip() == b"%" for chunk in source.chunks() if b"%" in chunk for line in chunk.split(b"\n"))
    return lone > 1


def count_lines(source: Source) -> int:
    """Physical lines of a program."""
    return sum(chunk.count(b"\n") for chunk in source.chunks())
