"""How long a program with loops is checked behind its first error.

A line that was refused is skipped, and if it was the one that counts, its loop never ends. So checking has patience:
when that is at its end, it goes on behind the furthest line that was reached, until the program is over or even that
has taken too long. Nothing is commanded any more, so this is only about which further errors are found.
"""

from __future__ import annotations

from gcode.errors import GcodeError
from gcode.flow import Flow
from gcode.records import dataclass

FIRST, LATER = 20_000, 1_000
"""Lines that are executed before the first leap, and between leaps."""
MAX_LEAPS = 50


@dataclass(slots=True)
class Patience:
    """Counts the lines that are executed after an error."""

    flow: Flow
    furthest: int = -1
    left: int = FIRST
    leaps: int = 0

    def lasts(self) -> bool:
        """Called before a line: leaps behind the furthest line if patience is at its end. False: enough was checked."""
        flow = self.flow
        if not flow.calls:
            self.furthest = max(self.furthest, flow.index)
        self.left -= 1
        if self.left > 0:
            return True
        self.left = LATER
        self.leaps += 1
        self._leave_calls()
        flow.index = self.furthest = self.furthest + 1
        return self.leaps <= MAX_LEAPS and flow.index < flow.main.stop

    def spend(self, lines: int) -> None:
        """Counts lines that were executed at once."""
        self.left -= lines

    def _leave_calls(self) -> None:
        flow = self.flow
        while flow.calls:
            flow.calls[-1].turns_left = 0
            try:
                flow.leave(None)
            except GcodeError:  # modes that cannot be restored: one more consequence of the error
                continue
