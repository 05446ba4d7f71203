"""What every schedule of PIC-STEP exchanges is made of: departures, lone starts, stops, and what must hold.

A schedule is a generator of exchanges that is sent the evidence of each. Its rules make stale and run-away starts
impossible (PIC-STEP data sheet, table 4 and Start Motion):

* a stop position is loaded only while the axis rests, with the first count of its leg;
* a count-only load is started only while even the fastest chip that agrees with the evidence still moves;
* a group Start is sent only when every member holds a fresh load;
* a reply that contradicts the twins ends the stream: the guardian.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence

from nmc.budget import BusTiming, Window
from nmc.program import Evidence, Exchange
from planner.steptrain import LEG_BYTES
from planner.stream_axis import LOAD_TRAJECTORY, MOVING, SAFETY_NS, START_NOW, Load, StepAxis
from planner.stream_error import StreamError
from planner.stream_members import ranking
from planner.stream_regroup import STREAMING_GROUP, Groups, regroup
from planner.types import nobody_asks

SET_ADDRESS, START_MOTION, STOP_MOTOR, NO_OPERATION = 0x1, 0x5, 0x7, 0xE
AMP_ENABLE, STOP_ABRUPTLY = 0x01, 0x04
COUNT_BYTES = 4
PREPARE_NS = 40_000_000
"""A reversal is prepared (Stop Motor) this long before its first step is due."""
LATE_NS = 100_000
"""A Start that leaves this much after its time, or after the latest that was foreseen, counts as late."""

Stream = Generator[Exchange, Evidence, None]
Said = Generator[Exchange, Evidence, bool]
"""A stream that tells at its end whether it sent anything."""


class StepSchedule:
    """The exchanges of one bus of PIC-STEPs; ``run`` is driven by the executor's evidence."""

    def __init__(self, axes: Sequence[StepAxis], timing: BusTiming, bus: int) -> None:
        self.axes = list(axes)
        self.timing = timing
        self.bus = bus
        self.alive: Callable[[], None] = nobody_asks
        """Called between bounded pieces of longer work."""
        self.groups = Groups.all_parked([axis.motor.address for axis in axes])
        self.now_ns = 0
        self.slices = 0
        self.late_slices = 0

    def run(self) -> Stream:
        """All exchanges until every leg is done and every axis rests."""
        raise NotImplementedError

    @property
    def changing(self) -> bool:
        """New times have come for everything that has not begun."""
        return False

    @property
    def moving(self) -> int:
        """How many axes of this bus move, or may."""
        return sum(1 for axis in self.axes if axis.moving)

    def assume(self, timing: BusTiming) -> None:
        """What is assumed of the bus has changed."""
        self.timing = timing
        for axis in self.axes:
            axis.timing = timing

    def proceed(self) -> Stream:
        """What is sent next while something moves."""
        raise NotImplementedError

    # --- the whole machine rests -------------------------------------------------------------------------------------

    def depart(self, first_due_ns: int) -> Stream:
        """Load every leg that is due soon after ``first_due_ns`` and begin them with one group Start."""
        horizon_ns = first_due_ns + self.slice_ns(len(self.axes))
        starters = [axis for axis in self.axes if (ns := axis.first_step_ns()) is not None and ns <= horizon_ns]
        for axis in starters:
            yield from self.stop_motor(axis)
        yield from self.regroup({axis.motor.address for axis in starters})
        loading_ns = len(starters) * self.timing.worst_ns(LEG_BYTES)
        lead_ns = min(self.slice_ns(1), min(axis.period_max_ns for axis in starters) // 2)
        start_ns = max(self.now_ns + loading_ns, first_due_ns - lead_ns - self.mean_ns(0))
        execute_ns = self.mean_ns(start_ns)
        pending = []
        for axis in starters:
            data, load = axis.leg_load(execute_ns, execute_ns + self.slice_ns(len(starters)), start_now=False)
            evidence = yield self.load(axis, data)
            self.expect_rest(axis, evidence)
            pending.append((axis, load))
        yield from self.start(start_ns, pending)

    def start(self, start_ns: int, pending: list[tuple[StepAxis, Load]], foreseen_ns: int = 0) -> Stream:
        """Group Start Motion; an axis for which it has become too late leaves the group first.

        foreseen_ns: until when everything before it should have been said at the latest, if that is after its time.

        A departure from rest for which new times have come does not happen: what is loaded is then loaded anew.
        """
        if self.changing and all(load.leg is not None for _, load in pending):
            return
        latest = self.latest_ns(max(start_ns, self.now_ns))
        unsafe = [axis for axis, load in pending if load.leg is None and not axis.surely_moving_at(latest)]
        if unsafe:
            self.late_slices += 1
            pending = [(axis, load) for axis, load in pending if axis not in unsafe]
            yield from self.regroup({axis.motor.address for axis, _ in pending})
            if pending:
                yield from self.start(start_ns, pending, foreseen_ns)
            return
        if self.now_ns > max(start_ns, foreseen_ns) + LATE_NS:
            self.late_slices += 1
        running = [axis for axis, load in pending if load.leg is None]
        last_ns = min((self.last_safe_ns(axis, 0) for axis in running), default=0)
        start = Exchange(STREAMING_GROUP, START_MOTION, send_at_ns=start_ns, bus=self.bus, not_after_ns=last_ns)
        evidence = yield start
        if not evidence.sent:
            self.late_slices += evidence.sent_ns > start_ns  # else it was recalled: nothing was late
            return
        window = self.timing.execution_window_ns(evidence.sent_ns, evidence.replied_ns, 0)
        for axis, load in pending:
            axis.executed(load, window)
        self.slices += 1

    # --- one axis ----------------------------------------------------------------------------------------------------

    def stop_motor(self, axis: StepAxis, send_ns: int = 0) -> Said:
        """Send Stop Motor if the next leg reverses; the slowest twin has stopped, the moving bit must agree."""
        if not axis.needs_stop_motor():
            return False
        data = bytes((AMP_ENABLE | STOP_ABRUPTLY,))
        evidence = yield Exchange(axis.motor.address, STOP_MOTOR, data, send_at_ns=send_ns, bus=self.bus)
        self.expect_rest(axis, evidence)
        axis.stop_motor_sent = True
        return True

    def ask(self, axis: StepAxis) -> Stream:
        """Read the moving bit of an axis that has probably arrived: its next leg need not wait for the slowest twin."""
        evidence = yield Exchange(axis.motor.address, NO_OPERATION, bus=self.bus)
        axis.asked_ns = self.now_ns
        if evidence.status is not None and not evidence.status & MOVING:
            axis.close(self.now_ns)

    def regroup(self, wanted: set[int]) -> Stream:
        """Make ``wanted`` (addresses) the streaming group."""
        for address, data in regroup(self.groups, wanted, ranking(self.axes)):
            yield Exchange(address, SET_ADDRESS, data, bus=self.bus)
        for axis in self.axes:
            axis.in_stream = axis.motor.address in wanted

    # --- times -------------------------------------------------------------------------------------------------------

    def slice_ns(self, loads: int) -> int:
        """Bus time of a slice with ``loads`` count-only loads and its Start."""
        return loads * self.timing.worst_ns(COUNT_BYTES) + self.timing.worst_ns(0)

    def latest_ns(self, send_ns: int, data_bytes: int = 0) -> int:
        """Latest instant at which a command sent at ``send_ns`` is executed."""
        timing = self.timing
        return send_ns + timing.command_ns(data_bytes) + timing.jitter_max_ns + timing.start_delay_max_ns

    def last_safe_ns(self, axis: StepAxis, data_bytes: int) -> int:
        """Until when a count for a running axis may leave so that even the fastest chip still moves when it acts."""
        return axis.twin.surely_moving_until_ns() - SAFETY_NS - self.latest_ns(0, data_bytes)

    def mean_ns(self, send_ns: int, data_bytes: int = 0) -> int:
        """Instant in the middle of what is possible for a command sent at ``send_ns``."""
        timing = self.timing
        return send_ns + timing.command_ns(data_bytes) + (timing.jitter_max_ns + timing.start_delay_max_ns) // 2

    def window(self, evidence: Evidence) -> Window:
        """When the exchange that ``evidence`` answers was executed."""
        return self.timing.execution_window_ns(evidence.sent_ns, evidence.replied_ns, len(evidence.exchange.data))

    def load(self, axis: StepAxis, data: bytes, send_ns: int = 0) -> Exchange:
        """Load Trajectory for one axis."""
        if axis.moving:
            last_ns = self.last_safe_ns(axis, len(data)) if data[0] & START_NOW else 0
            return Exchange(
                axis.motor.address, LOAD_TRAJECTORY, data, send_at_ns=send_ns, bus=self.bus, not_after_ns=last_ns
            )
        at_rest = (axis.motor.address,)
        return Exchange(axis.motor.address, LOAD_TRAJECTORY, data, send_at_ns=send_ns, bus=self.bus, at_rest=at_rest)

    # --- the guardian ------------------------------------------------------------------------------------------------

    def expect_moving(self, axis: StepAxis, evidence: Evidence) -> None:
        """Raise StreamError if an axis stands that even the fastest twin says is moving."""
        stands = evidence.status is not None and not evidence.status & MOVING
        if stands and axis.twin.surely_moving_until_ns() > evidence.replied_ns:
            raise StreamError(f"axis {axis.motor.name} stands although its leg is not over", axis.motor.name)

    def expect_rest(self, axis: StepAxis, evidence: Evidence) -> None:
        """Raise StreamError if an axis moves that even the slowest twin says has arrived."""
        if evidence.status is not None and evidence.status & MOVING:
            raise StreamError(f"axis {axis.motor.name} still moves although its leg is over", axis.motor.name)
