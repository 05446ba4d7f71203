"""Profile ``group``: every member is reloaded every slice and one group Start Motion begins the slice for all.

    slice k:   [leavers parked] [Stop Motor before a reversal] [loads] [joiners grouped] ......| Start k |
                                                                                    send_at ---^

Rules that make stale and run-away starts impossible (PIC-STEP data sheet, table 4 and Start Motion):

* a stop position is loaded only while the axis rests, with the first count of its leg;
* a count-only load is started only while even the fastest chip that agrees with the evidence still moves;
* an axis that cannot be sure to move at the next Start leaves the group before it and ends its leg alone, on the stop
  position that the chip itself watches, helped by count-only loads of its own (start now) while that is safe;
* legs too short for the group are started alone, at an instant of their own.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence

from nmc.budget import BusTiming
from nmc.program import Evidence, Exchange
from planner.stream_axis import LOAD_TRAJECTORY, MOVING, Load, StepAxis
from planner.stream_error import StreamError
from planner.stream_regroup import STREAMING_GROUP, Groups, regroup

SET_ADDRESS, START_MOTION, STOP_MOTOR, NO_OPERATION = 0x1, 0x5, 0x7, 0xE
AMP_ENABLE, STOP_ABRUPTLY = 0x01, 0x04
COUNT_BYTES, LEG_BYTES = 4, 8
TRIM_STEPS = 0.4
"""An axis that ends its leg alone is given a new count when it would arrive this many steps off its plan."""
SHORT_LEG_STEPS = 2

Stream = Generator[Exchange, Evidence, None]


class GroupStream:
    """Schedules the exchanges of one bus; ``run`` is driven by the executor's evidence."""

    def __init__(self, axes: Sequence[StepAxis], timing: BusTiming, bus: int) -> None:
        self.axes = list(axes)
        self.timing = timing
        self.bus = bus
        self.groups = Groups.all_parked([axis.motor.address for axis in axes])
        self.now_ns = 0
        self.slices = 0
        self.late_slices = 0

    def run(self) -> Stream:
        """All exchanges until every leg is done and every axis rests."""
        while True:
            for axis in self.axes:
                axis.settle(self.now_ns)
            moving = [axis for axis in self.axes if axis.moving]
            due = [ns for axis in self.axes if not axis.moving and (ns := axis.first_step_ns()) is not None]
            if not moving and not due:
                return
            start_ns = self._slice_start(due)
            members, joiners = self._members(start_ns)
            if members or joiners:
                yield from self._slice(start_ns, members, joiners)
            else:
                yield from self._alone(start_ns, wait=True)

    # --- choosing ----------------------------------------------------------------------------------------------------

    def _slice_ns(self, loads: int) -> int:
        """Bus time of a slice with ``loads`` count-only loads and its Start."""
        return loads * self.timing.worst_ns(COUNT_BYTES) + self.timing.worst_ns(0)

    def _slice_start(self, due: list[int]) -> int:
        """When the coming Start leaves: as soon as the bus allows, or shortly before the first leg is due."""
        moving = [axis for axis in self.axes if axis.moving and axis.in_stream]
        start_ns = self.now_ns + self._slice_ns(max(len(moving), 1))
        starting = sum(1 for ns in due if ns < start_ns + self._slice_ns(len(self.axes)))
        start_ns += starting * (self.timing.worst_ns(LEG_BYTES) + self.timing.worst_ns(2))
        leaving = sum(1 for axis in moving if not axis.surely_moving_at(self._latest_execution(start_ns)))
        start_ns += 2 * leaving * self.timing.worst_ns(2)
        if not moving and due and min(due) > start_ns + self._slice_ns(len(due)):
            start_ns = min(due) - self._slice_ns(len(due))
        return start_ns

    def _latest_execution(self, send_ns: int, data_bytes: int = 0) -> int:
        timing = self.timing
        return send_ns + timing.command_ns(data_bytes) + timing.jitter_max_ns + timing.start_delay_max_ns

    def _mean_execution(self, send_ns: int, data_bytes: int = 0) -> int:
        timing = self.timing
        return send_ns + timing.command_ns(data_bytes) + (timing.jitter_max_ns + timing.start_delay_max_ns) // 2

    def _members(self, start_ns: int) -> tuple[list[StepAxis], list[StepAxis]]:
        """Axes that take part in the coming Start: those that surely still move, and those whose leg begins."""
        latest = self._latest_execution(start_ns)
        members = [axis for axis in self.axes if axis.in_stream and axis.surely_moving_at(latest)]
        horizon = self._mean_execution(start_ns) + self._slice_ns(len(members) + 1)
        joiners = []
        for axis in self.axes:
            first = None if axis.moving else axis.first_step_ns()
            if first is not None and first < horizon and not self._is_short(axis):
                joiners.append(axis)
        return members, joiners

    def _is_short(self, axis: StepAxis) -> bool:
        leg = axis.next_leg()
        assert leg is not None
        lasts_ns = int(leg.times_ns[-1] - leg.times_ns[0])
        return len(leg) <= SHORT_LEG_STEPS or lasts_ns < self._slice_ns(1)

    # --- sending -----------------------------------------------------------------------------------------------------

    def _slice(self, start_ns: int, members: list[StepAxis], joiners: list[StepAxis]) -> Stream:
        """One slice: everything that must be said before its Start, then the Start."""
        stay = {axis.motor.address for axis in members}
        yield from self._regroup(stay)
        ready = []
        for axis in joiners:
            if (yield from self._come_to_rest(axis)):
                ready.append(axis)
        pending: list[tuple[StepAxis, Load]] = []
        execute_ns = self._mean_execution(start_ns)
        target_ns = execute_ns + self._slice_ns(len(members) + len(ready))
        for axis in members:
            data, load = axis.count_load(execute_ns, target_ns, start_now=False)
            evidence = yield self._load(axis, data)
            self._expect_moving(axis, evidence)
            pending.append((axis, load))
        for axis in ready:
            data, load = axis.leg_load(execute_ns, target_ns, start_now=False)
            evidence = yield self._load(axis, data)
            self._expect_rest(axis, evidence)
            pending.append((axis, load))
        yield from self._regroup(stay | {axis.motor.address for axis in ready})
        yield from self._alone(start_ns, wait=False)
        if pending:
            yield from self._start(start_ns, pending)

    def _start(self, start_ns: int, pending: list[tuple[StepAxis, Load]]) -> Stream:
        latest = self._latest_execution(max(start_ns, self.now_ns))
        unsafe = [axis for axis, load in pending if load.leg is None and not axis.surely_moving_at(latest)]
        if unsafe:
            # The slice came too late for them: they leave, the others wait one packet longer.
            pending = [(axis, load) for axis, load in pending if axis not in unsafe]
            yield from self._regroup({axis.motor.address for axis, _ in pending})
            self.late_slices += 1
            if pending:
                yield from self._start(start_ns, pending)
            return
        if self.now_ns > start_ns:
            self.late_slices += 1
        evidence = yield Exchange(STREAMING_GROUP, START_MOTION, send_at_ns=start_ns, bus=self.bus)
        window = self.timing.execution_window_ns(evidence.sent_ns, evidence.replied_ns, 0)
        for axis, load in pending:
            axis.executed(load, *window)
        self.slices += 1

    def _alone(self, until_ns: int, wait: bool) -> Stream:
        """What axes outside the group need before ``until_ns``: short legs begun, ends of legs put right.

        With ``wait`` nothing else is to be done before ``until_ns``, so if nothing was said an axis is asked how it is.
        """
        said = False
        for axis in self.axes:
            if axis.in_stream:
                continue
            if axis.moving:
                said = (yield from self._trim(axis)) or said
            elif axis.next_leg() is not None and self._is_short(axis):
                said = (yield from self._short_leg(axis, until_ns)) or said
        if wait and not said:
            moving = [axis for axis in self.axes if axis.moving]
            ask = moving[0] if moving else self.axes[0]
            at_ns = min((axis.twin.surely_stopped_from_ns() for axis in moving), default=until_ns)
            yield Exchange(ask.motor.address, NO_OPERATION, send_at_ns=min(at_ns + 1, until_ns), bus=self.bus)

    def _short_leg(self, axis: StepAxis, until_ns: int) -> Generator[Exchange, Evidence, bool]:
        """Start a short leg by itself so that its first step comes on time; True if something was sent."""
        leg = axis.next_leg()
        assert leg is not None
        first, last = int(leg.times_ns[0]) + axis.start_ns, int(leg.times_ns[-1]) + axis.start_ns
        period = (last - first) // (len(leg) - 1) if len(leg) > 1 else min(axis.period_max_ns, first - self.now_ns)
        lead_ns = self._mean_execution(0, LEG_BYTES)
        send_ns = first - period - lead_ns
        if send_ns > until_ns:
            return False
        if not (yield from self._come_to_rest(axis)):
            return True
        send_ns = max(send_ns, self.now_ns)
        if send_ns > until_ns - self.timing.worst_ns(LEG_BYTES):
            send_ns = self.now_ns
        data, load = axis.leg_load(send_ns + lead_ns, last, start_now=True)
        evidence = yield self._load(axis, data, send_ns)
        self._expect_rest(axis, evidence)
        axis.executed(load, *self._window(evidence))
        return True

    def _trim(self, axis: StepAxis) -> Generator[Exchange, Evidence, bool]:
        """Give an axis that ends its leg alone a count that lets it arrive on time, if that is safe and worth it."""
        if abs(axis.arrival_error_steps()) < TRIM_STEPS:
            return False
        if not axis.surely_moving_at(self._latest_execution(self.now_ns, COUNT_BYTES)):
            return False
        assert axis.leg is not None
        end_ns = int(axis.leg.times_ns[-1]) + axis.start_ns
        data, load = axis.count_load(self._mean_execution(self.now_ns, COUNT_BYTES), end_ns, start_now=True)
        evidence = yield self._load(axis, data)
        self._expect_moving(axis, evidence)
        axis.executed(load, *self._window(evidence))
        return True

    def _come_to_rest(self, axis: StepAxis) -> Generator[Exchange, Evidence, bool]:
        """Send Stop Motor if the next leg reverses; the slowest twin has stopped, the moving bit must agree."""
        if axis.needs_stop_motor():
            data = bytes((AMP_ENABLE | STOP_ABRUPTLY,))
            evidence = yield Exchange(axis.motor.address, STOP_MOTOR, data, bus=self.bus)
            self._expect_rest(axis, evidence)
            axis.stop_motor_sent = True
        return not axis.moving

    def _regroup(self, wanted: set[int]) -> Stream:
        ranking = sorted(self.axes, key=lambda axis: -axis.twin.surely_moving_until_ns())
        for address, data in regroup(self.groups, wanted, [axis.motor.address for axis in ranking]):
            yield Exchange(address, SET_ADDRESS, data, bus=self.bus)
        for axis in self.axes:
            axis.in_stream = axis.motor.address in wanted

    def _load(self, axis: StepAxis, data: bytes, send_ns: int = 0) -> Exchange:
        at_rest = () if axis.moving else (axis.motor.address,)
        return Exchange(axis.motor.address, LOAD_TRAJECTORY, data, send_at_ns=send_ns, bus=self.bus, at_rest=at_rest)

    def _window(self, evidence: Evidence) -> tuple[int, int]:
        return self.timing.execution_window_ns(evidence.sent_ns, evidence.replied_ns, len(evidence.exchange.data))

    # --- the guardian ------------------------------------------------------------------------------------------------

    def _expect_moving(self, axis: StepAxis, evidence: Evidence) -> None:
        if evidence.status is not None and not evidence.status & MOVING:
            raise StreamError(f"axis {axis.motor.name} stands although its leg is not over", axis.motor.name)

    def _expect_rest(self, axis: StepAxis, evidence: Evidence) -> None:
        if evidence.status is not None and evidence.status & MOVING:
            raise StreamError(f"axis {axis.motor.name} still moves although its leg is over", axis.motor.name)
