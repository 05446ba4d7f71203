"""Profile ``group``: every member is reloaded every slice and one group Start Motion begins the slice for all.

    slice k:   [leavers parked] [recruits grouped] [loads] [axes outside the group] ......| Start k |
                                                                               send_at ---^

When the whole machine rests, the legs that are due are loaded and leave together on one group Start. While others
move, a leg begins alone at its own instant (start now) and its axis joins the group once it runs.

Rules that make stale and run-away starts impossible (PIC-STEP data sheet, table 4 and Start Motion):

* a stop position is loaded only while the axis rests, with the first count of its leg;
* a count-only load is started only while even the fastest chip that agrees with the evidence still moves;
* an axis that cannot be sure to move at the next Start leaves the group before it and ends its leg alone, on the stop
  position that the chip itself watches, helped by count-only loads of its own while that is safe.
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
TRIM_STEPS = 0.2
"""An axis that runs alone is given a new count when it would get this many steps off its plan without."""
RECRUIT_SLICES = 3
"""An axis joins the group only if it surely runs on for so many slices: a change of group costs a load."""
PREPARE_NS = 40_000_000
"""A reversal is prepared (Stop Motor) this long before its first step is due."""
LATE_NS = 100_000
"""A Start that leaves this much after its time counts as late."""

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
            moving = any(axis.moving for axis in self.axes)
            due = [ns for axis in self.axes if not axis.moving and (ns := axis.first_step_ns()) is not None]
            if not moving and not due:
                return
            if moving:
                yield from self._slice()
            else:
                yield from self._depart(min(due))

    # --- the whole machine rests -------------------------------------------------------------------------------------

    def _depart(self, first_due_ns: int) -> Stream:
        """Load every leg that is due soon after ``first_due_ns`` and begin them with one group Start."""
        horizon_ns = first_due_ns + self._slice_ns(len(self.axes))
        starters = [axis for axis in self.axes if (ns := axis.first_step_ns()) is not None and ns <= horizon_ns]
        for axis in starters:
            yield from self._stop_motor(axis)
        yield from self._regroup({axis.motor.address for axis in starters})
        loading_ns = len(starters) * self.timing.worst_ns(LEG_BYTES)
        lead_ns = min(self._slice_ns(1), min(axis.period_max_ns for axis in starters) // 2)
        start_ns = max(self.now_ns + loading_ns, first_due_ns - lead_ns - self._mean_execution(0))
        execute_ns = self._mean_execution(start_ns)
        pending = []
        for axis in starters:
            data, load = axis.leg_load(execute_ns, execute_ns + self._slice_ns(len(starters)), start_now=False)
            evidence = yield self._load(axis, data)
            self._expect_rest(axis, evidence)
            pending.append((axis, load))
        yield from self._start(start_ns, pending)

    # --- while something moves ---------------------------------------------------------------------------------------

    def _slice(self) -> Stream:
        """One slice: everything that must be said before its Start, then the Start; without members, the rest alone."""
        members, start_ns = self._members()
        yield from self._regroup({axis.motor.address for axis in members})
        pending: list[tuple[StepAxis, Load]] = []
        execute_ns = self._mean_execution(start_ns)
        target_ns = execute_ns + self._slice_ns(len(members))
        for axis in members:
            data, load = axis.count_load(execute_ns, target_ns, start_now=False)
            evidence = yield self._load(axis, data)
            self._expect_moving(axis, evidence)
            pending.append((axis, load))
        said = yield from self._alone(start_ns)
        if pending:
            yield from self._start(start_ns, pending)
        elif not said:
            yield self._wait(start_ns)

    def _members(self) -> tuple[list[StepAxis], int]:
        """Who takes part in the coming Start, and when it leaves: as soon as the bus has carried what comes before.

        Members surely still move then and are not slow; an axis from outside is recruited only if it runs on for some
        slices. The slow ones are led alone: a load that comes after a roll-over acts a whole period later.
        """
        timing = self.timing
        regroup_ns, count_ns = timing.worst_ns(2), timing.worst_ns(COUNT_BYTES)
        inside = [axis for axis in self.axes if axis.in_stream and axis.moving]
        outside = [axis for axis in self.axes if not axis.in_stream and axis.moving]
        start_ns = self.now_ns + self._slice_ns(len(inside)) + len(outside) * count_ns
        fits = [axis for axis in inside if not axis.slow and axis.surely_moving_at(self._latest(start_ns))]
        start_ns += regroup_ns * 2 * (len(inside) - len(fits))
        enough_ns = RECRUIT_SLICES * self._slice_ns(len(self.axes))
        recruits = [
            axis for axis in outside if not axis.slow and axis.surely_moving_at(self._latest(start_ns) + enough_ns)
        ]
        start_ns += len(recruits) * 2 * regroup_ns
        members = [axis for axis in fits if axis.surely_moving_at(self._latest(start_ns))]
        return members + recruits, start_ns

    def _alone(self, start_ns: int) -> Generator[Exchange, Evidence, bool]:
        """What axes outside the group need before the Start; True if anything was sent."""
        said = False
        for axis in self.axes:
            if axis.in_stream and axis.moving:
                continue
            axis.settle(self.now_ns)
            first = axis.first_step_ns()
            soon = first is not None and first - self.now_ns < PREPARE_NS
            if soon and axis.likely_stopped_at(self.now_ns):
                yield from self._ask(axis)
                said = True
            if axis.moving:
                said = (yield from self._trim(axis)) or said
            elif soon:
                said = (yield from self._stop_motor(axis)) or said
                said = (yield from self._lone_start(axis, start_ns)) or said
        return said

    def _lone_start(self, axis: StepAxis, start_ns: int) -> Generator[Exchange, Evidence, bool]:
        """Begin a leg by itself so that its first step comes on time; True if it was begun."""
        leg = axis.next_leg()
        assert leg is not None
        lead_ns = self._mean_execution(0, LEG_BYTES)
        ahead_ns = self._slice_ns(len(self.axes))
        send_ns = max(axis.lone_start_ns(ahead_ns) - lead_ns, self.now_ns)
        if send_ns > max(start_ns, self.now_ns):
            return False
        execute_ns = send_ns + lead_ns
        data, load = axis.leg_load(execute_ns, execute_ns + ahead_ns, start_now=True)
        evidence = yield self._load(axis, data, send_ns)
        self._expect_rest(axis, evidence)
        axis.executed(load, *self._window(evidence))
        return True

    def _trim(self, axis: StepAxis) -> Generator[Exchange, Evidence, bool]:
        """Give an axis that runs alone a count that lets it arrive on time, if that is safe and worth it."""
        if not axis.surely_moving_at(self._latest(self.now_ns, COUNT_BYTES)):
            return False
        execute_ns = self._mean_execution(self.now_ns, COUNT_BYTES)
        target_ns = execute_ns + self._slice_ns(len(self.axes))
        if axis.aim_error_steps(execute_ns, target_ns) < TRIM_STEPS:
            return False
        data, load = axis.count_load(execute_ns, target_ns, start_now=True)
        evidence = yield self._load(axis, data)
        self._expect_moving(axis, evidence)
        axis.executed(load, *self._window(evidence))
        return True

    def _ask(self, axis: StepAxis) -> Stream:
        """Read the moving bit of an axis that has probably arrived: its next leg need not wait for the slowest twin."""
        evidence = yield Exchange(axis.motor.address, NO_OPERATION, bus=self.bus)
        if evidence.status is not None and not evidence.status & MOVING:
            axis.close()

    def _wait(self, start_ns: int) -> Exchange:
        """Nothing to say in this slice: ask the axis that ends next how it is."""
        ends = [(axis.twin.surely_stopped_from_ns() + 1, axis) for axis in self.axes if axis.moving]
        until_ns, axis = min(ends, key=lambda end: end[0])
        return Exchange(axis.motor.address, NO_OPERATION, send_at_ns=min(until_ns, start_ns), bus=self.bus)

    # --- sending -----------------------------------------------------------------------------------------------------

    def _start(self, start_ns: int, pending: list[tuple[StepAxis, Load]]) -> Stream:
        """Group Start Motion; an axis for which it has become too late leaves the group first."""
        latest = self._latest(max(start_ns, self.now_ns))
        unsafe = [axis for axis, load in pending if load.leg is None and not axis.surely_moving_at(latest)]
        if unsafe:
            self.late_slices += 1
            pending = [(axis, load) for axis, load in pending if axis not in unsafe]
            yield from self._regroup({axis.motor.address for axis, _ in pending})
            if pending:
                yield from self._start(start_ns, pending)
            return
        if self.now_ns > start_ns + LATE_NS:
            self.late_slices += 1
        evidence = yield Exchange(STREAMING_GROUP, START_MOTION, send_at_ns=start_ns, bus=self.bus)
        window = self.timing.execution_window_ns(evidence.sent_ns, evidence.replied_ns, 0)
        for axis, load in pending:
            axis.executed(load, *window)
        self.slices += 1

    def _stop_motor(self, axis: StepAxis) -> Generator[Exchange, Evidence, bool]:
        """Send Stop Motor if the next leg reverses; the slowest twin has stopped, the moving bit must agree."""
        if not axis.needs_stop_motor():
            return False
        data = bytes((AMP_ENABLE | STOP_ABRUPTLY,))
        evidence = yield Exchange(axis.motor.address, STOP_MOTOR, data, bus=self.bus)
        self._expect_rest(axis, evidence)
        axis.stop_motor_sent = True
        return True

    def _slice_ns(self, loads: int) -> int:
        """Bus time of a slice with ``loads`` count-only loads and its Start."""
        return loads * self.timing.worst_ns(COUNT_BYTES) + self.timing.worst_ns(0)

    def _latest(self, send_ns: int, data_bytes: int = 0) -> int:
        """Latest instant at which a command sent at ``send_ns`` is executed."""
        timing = self.timing
        return send_ns + timing.command_ns(data_bytes) + timing.jitter_max_ns + timing.start_delay_max_ns

    def _mean_execution(self, send_ns: int, data_bytes: int = 0) -> int:
        timing = self.timing
        return send_ns + timing.command_ns(data_bytes) + (timing.jitter_max_ns + timing.start_delay_max_ns) // 2

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
