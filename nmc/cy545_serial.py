"""A real port with a CY545 on it: data lines, and modem lines for INHIBIT_ABORT, the home switch and CTS.

The chip may move only while its line is asserted: not asserted means INHIBIT_ABORT low. When this program dies, its
port closes, the system drops the line, and the chip stops even in continuous mode. A switch to ground on an input reads
as asserted.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Literal

from nmc.errors import NmcError
from nmc.serial_link import SerialLink

OutputLine = Literal["none", "rts", "dtr"]
InputLine = Literal["none", "cts", "dsr", "cd", "ri"]


class Cy545SerialLink(SerialLink):
    """Also implements ``nmc.cy545.ChipLines``. Raises NmcError if the port cannot be opened."""

    def __init__(
        self, port: str, baud: int, abort_line: OutputLine = "none", home_line: InputLine = "none", cts: bool = False
    ) -> None:
        super().__init__(port, baud)
        self._abort_line, self._home_line, self._cts = abort_line, home_line, cts
        try:
            self.pull_abort(False)
        except NmcError:
            self.close()
            raise

    def pull_abort(self, low: bool) -> None:
        """Drop the line that holds INHIBIT_ABORT high, or assert it; nothing if none is wired."""
        if self._abort_line != "none":
            with self._told(self._abort_line):
                setattr(self._port, self._abort_line, not low)

    def switch_closed(self) -> bool:
        """Whether the line with the home switch is asserted; False if none is named."""
        if self._home_line == "none":
            return False
        with self._told(self._home_line):
            return bool(getattr(self._port, self._home_line))

    def clear_to_send(self) -> bool:
        """CTS; True where it is not wired."""
        if not self._cts:
            return True
        with self._told("cts"):
            return bool(self._port.cts)

    @contextlib.contextmanager
    def _told(self, line: str) -> Iterator[None]:
        """A port without modem lines, such as a terminal of this computer, says so."""
        try:
            yield
        except OSError as error:
            raise NmcError(f"{self.name} has no line {line}: {error.strerror or error}") from None
