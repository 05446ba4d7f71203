"""What a run reports: every diagnostic once, and none that is only the echo of an earlier one."""

from __future__ import annotations

from gcode.errors import Diagnostic, GcodeError
from gcode.flow import Flow
from gcode.machine import Machine
from gcode.setup import Setup

ONCE = frozenset({"GC040", "GC202", "GC203", "GC204", "GC205", "GC206", "GC208", "GC216"})
"""Reported once a file: the cure of the first is the cure of all."""

FATAL = frozenset({"GC084"})
"""After these nothing more is checked: what follows is their echo, and may take for ever."""


class Reports:
    """The diagnostics of a run. ``failed``: an error was found, nothing more may be commanded."""

    setup: Setup
    machine: Machine
    flow: Flow

    def __init__(self) -> None:
        self.diagnostics: list[Diagnostic] = []
        self.failed = False
        self._reported: set[tuple[str, ...]] = set()
        self._uncertain: set[int] = set()

    def at_first_line(self, text: str, code: str, message: str, hint: str, severity: str = "error") -> None:
        """Something about the whole program, shown at its first line."""
        first = text.split("\n", 1)[0]
        self.report(GcodeError(code, message, hint, (0, 1)), self.setup.file, 1, first, severity)

    def warn_rapid(self, number: int) -> None:
        """Warns of a rapid below Z0 on a line whose text is not at hand."""
        if not self.has_reported("GC216"):
            error = GcodeError("GC216", "a rapid move down below Z0", "check that nothing is in the way", (0, 1))
            self.report(error, self.setup.file, number, "", "warning")

    def has_reported(self, code: str) -> bool:
        """Whether a once-only diagnostic was given."""
        return (code,) in self._reported

    def report(self, error: GcodeError, file: str, number: int, text: str, severity: str = "error") -> None:
        """Notes a diagnostic, unless it is only a consequence of an earlier one or was reported before."""
        if severity == "error":
            self.failed = True
            self.machine.finished |= error.code in FATAL
            if error.code == "GC044" and self._uncertain:
                return
        if error.code in ONCE:
            if (error.code,) in self._reported:
                return
            self._reported.add((error.code,))
        self._note(error, file, number, text, severity)

    def _note(self, error: GcodeError, file: str, number: int, text: str, severity: str) -> None:
        from gcode.places import place

        found = place(error, file, number, text, severity, self.flow.call_stack())
        key = (found.file, str(found.line), str(found.column), found.code)
        if key not in self._reported:
            self._reported.add(key)
            self.diagnostics.append(found)
