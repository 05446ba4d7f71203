"""When the spindle's speed is looked at, and what is said of it: the wait for a new speed, and the cut after it.

command          ramp is over        last look      the axes move on
|------|------|------|------|------|------|~~|
       looks, WAIT_POLL_NS apart          JUDGE_NS before the end of the planned rest
"""

from __future__ import annotations

from collections.abc import Callable

from machines.spindle import SpindleDrive
from nmc.program import Evidence
from planner.stream_error import StreamError

WAIT_POLL_NS = 50_000_000
CUT_POLL_NS = 250_000_000
JUDGE_NS = 8_000_000
"""The speed is judged this long before the planned rest ends."""
STRAYED = 3.0
"""In the cut a spindle may differ by this many times ``at_speed``, in one of two looks that follow each other."""
Instant = Callable[[], int]
Told = Callable[..., None]


class SpindleWatch:
    """Decides when to poll, and raises StreamError when the spindle does not do what it was told."""

    def __init__(self, drive: SpindleDrive, tell: Told) -> None:
        self.drive = drive
        self._tell = tell
        self._begin: Instant | None = None
        self._end: Instant | None = None
        self._next_ns: int | None = None
        self._last_look = False
        self._reached = False
        self._strayed = 0
        self.line = 0
        """That of the last change."""
        self.follows = False
        """The speed is being changed all the time (G96): the cut is not judged."""

    @property
    def waits(self) -> bool:
        """A change of speed is not over."""
        return self._end is not None

    def began(self, begin: Instant, end: Instant, line: int) -> None:
        """A change of speed has begun that must be over at ``end``; both are asked for again as times shift."""
        self.line = line
        if not self.drive.measures:
            return
        self._begin, self._end = begin, end
        self._next_ns = None
        self._reached = self._last_look = False
        self._strayed = 0

    def due_ns(self) -> int | None:
        """When to look next; None: nothing to look at."""
        if self._end is not None and self._begin is not None:
            last_ns = self._end() - JUDGE_NS
            first_ns = self._begin() if self._next_ns is None else self._next_ns
            if last_ns - first_ns < WAIT_POLL_NS // 2:
                self._last_look = True
                return last_ns
            return first_ns
        return self._next_ns

    def heard(self, evidence: Evidence, line: int) -> None:
        """An answer to a poll. Raises StreamError."""
        drive = self.drive
        rpm = drive.heard(evidence)
        self._next_ns = evidence.replied_ns + (WAIT_POLL_NS if self._end is not None else CUT_POLL_NS)
        if rpm is None:
            return
        if self._end is not None:
            self._wait(rpm, evidence.replied_ns, line)
        else:
            self._cut(rpm)

    def _wait(self, rpm: float, now_ns: int, line: int) -> None:
        drive = self.drive
        good = drive.off_by() <= drive.table.at_speed
        if good and not self._reached:
            assert self._begin is not None
            after_s = (now_ns - self._begin()) / 1e9
            self._tell("spindle_at_speed", now_ns, rpm=round(rpm, 1), wanted_rpm=drive.said_rpm, after_s=after_s)
        self._reached = good
        if not self._last_look:
            return
        if not good:
            words = f"the spindle turns at {abs(rpm):.0f} rpm, {abs(drive.said_rpm):.0f} wanted"
            raise StreamError(f"{words}, after the whole time that line {line} was given", "spindle")
        self._begin = self._end = None
        self._last_look = False
        self._next_ns = now_ns + CUT_POLL_NS if drive.said_rpm else None

    def _cut(self, rpm: float) -> None:
        drive = self.drive
        strays = not self.follows and drive.off_by() > STRAYED * drive.table.at_speed
        self._strayed = self._strayed + 1 if strays else 0
        if self._strayed > 1:
            words = f"the spindle has come to {abs(rpm):.0f} rpm, {abs(drive.said_rpm):.0f} wanted"
            raise StreamError(words, "spindle")
