"""Positions back from the chips while they run: one group latch, then a read of each in the slack.

Save Current Position as Home (PIC-STEP data sheet, section 5.1) to the streaming group makes all members store their
counters on one packet; the home registers are read one by one when the bus has time, the least known axis first. What
comes back closes the bounds of the twins, and is the guardian's evidence: a position that no chip of the data sheet
could have had ends the stream.
"""

from __future__ import annotations

from collections.abc import Sequence

from nmc.program import Exchange
from planner.stream_axis import StepAxis
from planner.stream_base import StepSchedule, Stream
from planner.stream_error import StreamError
from planner.stream_regroup import STREAMING_GROUP

SAVE_HOME, READ_STATUS = 0xC, 0x3
HOME_ITEM = b"\x10"
HOME_BYTES = 4
INTERVAL_NS = 10_000_000
"""Time between two latches: a chip that differs from its twin is stopped within this and a few exchanges."""
QUIET_EXCHANGE_NS = 773_000
"""A No Operation on a host without jitter; on a slower one the round costs more and comes less often."""
POSITION_ITEM, POSITION_BYTES = b"\x01", 4
"""Status item bit 0: the position, four bytes (PIC-STEP data sheet, section 5.1)."""
DOUBT_STEPS = 0.4
"""An axis of which so much is unknown after a load (which roll-over took it?) is asked where it is."""
ASK_AGAIN_NS = 4_000_000
SHARE = 6
LATE_NS = 6_000_000
"""On a busy bus a latched position is read after this time, or as one exchange in ``SHARE``."""


class Feedback:
    """The round of latch and reads of one bus."""

    def __init__(self, schedule: StepSchedule, axes: Sequence[StepAxis]) -> None:
        self.schedule = schedule
        self.axes = list(axes)
        self.interval_ns = int(INTERVAL_NS * (schedule.timing.mean_exchange_ns(0) / QUIET_EXCHANGE_NS) ** 2)
        self.next_ns = 0
        self.since_ns = 0
        self._others = 0
        self._unread: list[StepAxis] = []

    def overdue(self) -> bool:
        """The round is late: it takes its share of a busy bus, one exchange in ``SHARE``."""
        self._others += 1
        late_ns = LATE_NS if self._unread else self.interval_ns // 2
        return self._others >= SHARE and self.schedule.now_ns > self.since_ns + late_ns

    def due(self) -> bool:
        """There is something to send: a latched position is unread, or a latch is due and an axis would take part."""
        return self.due_at(self.schedule.now_ns)

    def due_at(self, at_ns: int) -> bool:
        """There will be something to send at ``at_ns``, if nothing is sent before."""
        if self._unread:
            return True
        return at_ns > self.next_ns and any(axis.moving and axis.in_stream for axis in self.axes)

    def doubtful(self) -> StepAxis | None:
        """The axis of which least is known, if that is too little and it was not asked just now."""
        now_ns = self.schedule.now_ns
        blur_ns = self.schedule.timing.reply_delay_max_ns // 4
        most = DOUBT_STEPS
        found: StepAxis | None = None
        for axis in self.axes:
            if axis.doubt_steps <= most or now_ns <= axis.looked_ns + ASK_AGAIN_NS:
                continue
            if axis.doubt_steps * axis.twin.nominal.period_ns > blur_ns:
                most, found = axis.doubt_steps, axis
        return found

    def look(self, axis: StepAxis) -> Stream:
        """Ask one axis for its counter; it is taken between the end of the command and the begin of the answer."""
        schedule, leg = self.schedule, axis.leg
        evidence = yield Exchange(
            axis.motor.address, READ_STATUS, POSITION_ITEM, reply_extra=POSITION_BYTES, bus=schedule.bus
        )
        axis.looked_ns = schedule.now_ns
        if leg is None or axis.leg is not leg:
            return
        window = schedule.timing.reading_window_ns(evidence.sent_ns, evidence.replied_ns, 1, POSITION_BYTES)
        axis.twin.latch(window)
        if axis in self._unread:
            self._unread.remove(axis)
        self._take(axis, int.from_bytes(evidence.extra, "little", signed=True))

    def step(self) -> Stream:
        """Send the next exchange of the round."""
        self._others = 0
        self.since_ns = max(self.schedule.now_ns, self.next_ns)
        if self._unread:
            now_ns = self.schedule.now_ns
            least_known = max(self._unread, key=lambda axis: axis.twin.belief.deviation_steps(now_ns))
            self._unread.remove(least_known)
            yield from self._read(least_known)
            return
        schedule = self.schedule
        evidence = yield Exchange(STREAMING_GROUP, SAVE_HOME, bus=schedule.bus)
        window = schedule.window(evidence)
        self._unread = [axis for axis in self.axes if axis.moving and axis.in_stream]
        for axis in self._unread:
            axis.twin.latch(window)
        self.next_ns = schedule.now_ns + self.interval_ns

    def _read(self, axis: StepAxis) -> Stream:
        leg = axis.leg
        evidence = yield Exchange(
            axis.motor.address, READ_STATUS, HOME_ITEM, reply_extra=HOME_BYTES, bus=self.schedule.bus
        )
        if leg is None or axis.leg is not leg:
            return
        self._take(axis, int.from_bytes(evidence.extra, "little", signed=True))

    def _take(self, axis: StepAxis, counter: int) -> None:
        """A counter has been read that was taken at the last latch."""
        leg = axis.leg
        assert leg is not None
        if not axis.twin.latched((counter - leg.start_steps) * leg.direction):
            name = axis.motor.name
            raise StreamError(f"axis {name} was at step {counter}, where its twins exclude it", name)
        axis.doubt_steps = axis.twin.belief.deviation_steps(self.schedule.now_ns)
