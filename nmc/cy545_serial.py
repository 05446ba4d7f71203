"""A real port with a CY545 on it: data lines, and modem lines for INHIBIT_ABORT, the home switch and CTS.

On the usual TTL adapter an asserted line is low at its pin, so "pull low" is "assert", and a switch to ground on an
input reads as asserted.
"""

from __future__ import annotations

from typing import Literal

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
        self.pull_abort(False)

    def pull_abort(self, low: bool) -> None:
        """Assert the line that is wired to INHIBIT_ABORT; nothing if none is."""
        if self._abort_line != "none":
            setattr(self._port, self._abort_line, low)

    def switch_closed(self) -> bool:
        """Whether the line with the home switch is asserted; False if none is named."""
        return self._home_line != "none" and bool(getattr(self._port, self._home_line))

    def clear_to_send(self) -> bool:
        """CTS; True where it is not wired."""
        return not self._cts or bool(self._port.cts)
