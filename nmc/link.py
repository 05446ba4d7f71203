"""Link: bytes and time in one object.

Waiting on a simulated link is the passing of simulated time; on a serial port it is the wall clock. Nothing above a
link knows which of the two it runs on, so the code that is verified is the code that cuts.
"""

from __future__ import annotations

from typing import Protocol


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
