"""Link: bytes and time in one object.

Waiting on a simulated link is the passing of simulated time; on a serial port it is the wall clock. Nothing above a
link knows which of the two it runs on, so the code that is verified is the code that cuts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol


class Link(Protocol):
    """One full-duplex NMC line seen from the host. All times are integer nanoseconds of this link's own clock."""

    def now_ns(self) -> int:
        """Present time."""

    def write(self, data: bytes) -> None:
        """Hand bytes to the port; returns at once, the bytes then take their time on the wire."""

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Wait until ``count`` bytes are in or ``deadline_ns`` has passed; return what there is, at most ``count``."""

    def sleep_until(self, time_ns: int) -> None:
        """Wait until ``time_ns``; returns at once if it is past."""

    def set_baud(self, baud: int) -> None:
        """Change the host's baud rate; bytes already handed over still leave at the old one."""

    def flush_input(self) -> None:
        """Drop received bytes that nobody has read."""

    def close(self) -> None:
        """Give the port back."""


class SharedLink(Link, Protocol):
    """A link that can be waited on together with others of its kind and clock (``nmc.together``)."""

    @property
    def root(self) -> Root:
        """What does the waiting: the link at the bottom, without the ones around it."""

    @property
    def patience_ns(self) -> int:
        """How long somebody may wait without calling ``receive``; 0: as long as he likes."""

    def receive(self, count: int) -> bytes:
        """What is in already, at most ``count`` bytes, without waiting. A call, even of 0 bytes, is a sign of life."""


class Root(Protocol):
    """Waits for several links at once."""

    def wait_first(self, wanted: Sequence[tuple[Any, int]], until_ns: int) -> None:
        """Wait until ``until_ns`` or until one of the links, all roots of this kind, has news of its bytes wanted."""
