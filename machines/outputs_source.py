"""A stream with what a machine does beside moving, said between two of its exchanges.

    motion    [X]..[Y]......[X]....[Y][Z]..........[X]
    outputs            [flood]            [spindle]          where there is room; else behind the exchange that is due

An exchange of the motion that is already chosen is never made late: what does not fit before it comes after it. So an
output is late by at most the exchange that was in its way, and the motion by one exchange of an output.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from machines.outputs_events import LOAD_BYTES, Due, Rig, Switched, Timetable
from machines.spindle import wanted_rpm
from nmc.chips.common import START_MOTION
from nmc.program import Evidence, Exchange, ExchangeSource
from planner.types import Trajectory

AHEAD_NS = 5_000_000
"""An event is looked at this long before its time, so that it can use the room before it."""
FOLLOW_NS = 50_000_000
"""How often a surface speed is followed."""
FOLLOW_SHARE = 0.005
"""A speed that has changed less is left as it is."""
IDLE_NS = 50_000_000
"""Behind the motion a module is asked this often how it is, so that a stop is noticed."""
POLL, FOLLOW, IDLE = "poll", "follow", "idle"
"""Names of what is said besides changes that a program asks for."""
POSITION_BYTES = 4


class OutputsSource:
    """Wraps the stream of one bus, or of all: an ``nmc.program.ExchangeSource``.

    start_ns: link time of t = 0 of the trajectory, asked anew each time. poll: asks a module of the stream's bus how it
    is. only: outputs of other buses are somebody else's to say. closes: the program ends with this trajectory, and
    spindle and coolant go off behind it.
    """

    def __init__(
        self,
        inner: ExchangeSource,
        trajectory: Trajectory,
        rig: Rig,
        start_ns: Callable[[], int],
        *,
        poll: Exchange,
        only: bool = False,
        closes: bool = True,
    ) -> None:
        self.timetable = Timetable(trajectory, rig, start_ns, self._mine_to_say)
        self._inner = inner
        self._rig = rig
        self._start_ns = start_ns
        self._bus = poll.bus
        self._only = only
        self._closes = closes
        self._poll = poll
        self._queue: list[Due] = []
        self._held: Exchange | None = None
        self._evidence: Evidence | None = None
        self._mine: Due | None = None
        self._over = self._closed = False
        self._recalled = False
        self._now_ns = self._followed_ns = 0
        self._line = 0
        timing = rig.timings[poll.bus]
        self._half_ns = timing.mean_exchange_ns(LOAD_BYTES) // 2

    def recall(self) -> None:
        """A group Start that waits here must not leave any more: the times have changed."""
        self._recalled = self._held is not None and self._held.command == START_MOTION

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        """What is to be said next, of the motion or beside it."""
        self._now_ns = now_ns
        self._take(evidence, now_ns)
        if self._held is None and not self._over:
            due = self._first(now_ns)
            if due is not None:
                return self._say(due, now_ns)
            self._held = self._inner.next(now_ns, self._evidence)
            self._evidence = None
            self._over = self._held is None
        if self._held is None:
            return self._afterwards(now_ns)
        begin_ns = max(self._held.send_at_ns, now_ns)
        due = self._first(begin_ns + self._half_ns) if begin_ns > now_ns else None
        if due is not None:
            send_ns, latest_ns = max(self._send_ns(due), now_ns), begin_ns - self._room_ns(due)
            if latest_ns >= now_ns and (due.in_motion or send_ns <= latest_ns):
                return self._say(due, min(send_ns, latest_ns))
        held, self._held = self._held, None
        return held

    # --- what comes back ---------------------------------------------------------------------------------------------

    def _take(self, evidence: Evidence | None, now_ns: int) -> None:
        if evidence is not None and self._mine is not None:
            mine, self._mine = self._mine, None
            self._told(mine, evidence)
        elif evidence is not None:
            self._evidence = evidence
            self._line = evidence.exchange.line
        if self._recalled and self._held is not None:
            self._evidence = Evidence(self._held, now_ns, now_ns, None, sent=False)
            self._held = None
        self._recalled = False

    def _told(self, due: Due, evidence: Evidence) -> None:
        rig = self._rig
        if due.name == POLL:
            if rig.watch is not None:
                rig.watch.heard(evidence, due.line)
        elif due.name not in (FOLLOW, IDLE):
            acts_ns = evidence.sent_ns + due.lead_ns
            rig.said.append(Switched(due.name, due.value, due.at_ns(), acts_ns, due.line))
            rig.tell("output", evidence.sent_ns, name=due.name, value=due.value, line=due.line)

    # --- what is to be said ------------------------------------------------------------------------------------------

    def _say(self, due: Due, send_ns: int) -> Exchange:
        if due in self._queue:
            self._queue.remove(due)
        if due.follows:
            self._followed_ns = send_ns
        self._mine = due
        return replace(due.make(), send_at_ns=send_ns, line=due.line)

    def _room_ns(self, due: Due) -> int:
        """Longest time that an exchange takes."""
        bytes_out, bytes_in = (1, POSITION_BYTES) if due.name == POLL else (due.data_bytes, 0)
        return self._rig.timings[due.bus].worst_ns(bytes_out, bytes_in)

    def _send_ns(self, due: Due) -> int:
        return due.at_ns() - due.lead_ns

    def _mine_to_say(self, bus: int) -> bool:
        return bus == self._bus or not self._only

    def _first(self, until_ns: int) -> Due | None:
        """The first thing that should leave before ``until_ns``; it stays in the queue until it is said."""
        self._queue += self.timetable.take(until_ns + AHEAD_NS)
        found = min(self._queue, key=self._send_ns, default=None)
        if found is not None and self._send_ns(found) <= until_ns:
            return found
        return self._look(until_ns) or self._follow(until_ns)

    def _look(self, until_ns: int) -> Due | None:
        """A look at the spindle's speed, if one is due."""
        watch, drive = self._rig.watch, self._rig.drive
        if watch is None or drive is None or not self._mine_to_say(drive.bus):
            return None
        due_ns = watch.due_ns()
        if due_ns is None or due_ns > until_ns:
            return None
        return Due(POLL, 0.0, lambda: due_ns, 0, drive.poll, watch.line, drive.bus)

    def _follow(self, until_ns: int) -> Due | None:
        """Under G96: another speed for where X will be, if it is another one."""
        drive, watch, command = self._rig.drive, self._rig.watch, self.timetable.surface
        if drive is None or watch is None or command is None or watch.waits or not self._mine_to_say(drive.bus):
            return None
        at_ns = max(self._followed_ns + FOLLOW_NS, self._now_ns)
        if at_ns > until_ns:
            return None
        time_s = (at_ns + FOLLOW_NS // 2 - self._start_ns()) / 1e9
        rpm = wanted_rpm(drive.table, command, self.timetable.x_mm(time_s))
        if abs(rpm - drive.said_rpm) <= FOLLOW_SHARE * abs(drive.said_rpm):
            self._followed_ns = at_ns
            return None
        pin = drive.table.drive == "output"
        name, value = ("spindle speed", drive.pwm_of(rpm)) if pin else (FOLLOW, rpm)
        return Due(name, value, lambda: at_ns, 0, lambda: drive.follow(rpm), command.line, drive.bus, follows=True)

    # --- when the motion is over -------------------------------------------------------------------------------------

    def _afterwards(self, now_ns: int) -> Exchange | None:
        """What the program says behind its last motion, at its time; at the end of all what is on goes off."""
        due = self._first(now_ns + IDLE_NS)
        if due is not None:
            return self._say(due, max(self._send_ns(due), now_ns))
        watch = self._rig.watch
        waits = watch is not None and watch.waits and self._mine_to_say(self._bus)
        if not self._queue and not self.timetable.ahead and not waits:
            if self._closed or not self._rig.anything:
                return None
            self._closed = True
            self._queue += self._closing(now_ns)
            return self._afterwards(now_ns)
        idle = Due(IDLE, 0.0, lambda: now_ns, 0, lambda: self._poll, self._line, self._bus)
        return self._say(idle, now_ns + IDLE_NS)

    def _closing(self, now_ns: int) -> list[Due]:
        timetable, drive = self.timetable, self._rig.drive
        found = timetable.rest(now_ns)
        if not self._closes:
            return found
        if drive is not None and drive.said_rpm and self._mine_to_say(drive.bus):
            self._rig.spindle = None
            found += timetable.spindle_dues(0.0, lambda: now_ns, self._line)
        for name in ("flood", "mist"):
            found += timetable.switch(name, 0.0, lambda: now_ns, self._line)
        return found
