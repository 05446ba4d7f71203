"""Profile ``adaptive``: inside a run the bus goes to the axis that would be furthest off its plan without it.

There is no slice and, while anything moves, no group Start: every load is a "start now" to one axis, so no stale Start
can happen by construction. A load acts at the next roll-over only, so the instant at which it is sent matters little
and the period it carries is chosen for what comes after that roll-over.

                 X      Y   X      Z        X    Y              a load is worth its bus time only if the axis would be
    bus   ...--[##]---[##][##]---[##]-----[##]-[##]--...        0.1 step or more off at its next turn; if none would
                                                                be, the bus waits until one will
"""

from __future__ import annotations

from collections.abc import Sequence

from nmc.budget import BusTiming
from nmc.program import Exchange
from planner.stream_axis import StepAxis
from planner.stream_base import COUNT_BYTES, LEG_BYTES, NO_OPERATION, PREPARE_NS, Said, StepSchedule, Stream

WORTH_STEPS = 0.1
"""A load is sent only if it mends at least this much."""
HORIZON = 0.8
"""Share of the time between two turns of an axis after which a load should have put it right."""
LOOK_NS = 300_000
"""Step of the search for the next moment at which something is worth sending."""
LOOK_AHEAD_NS = 20_000_000


class AdaptiveSchedule(StepSchedule):
    """Event-driven single loads."""

    def __init__(self, axes: Sequence[StepAxis], timing: BusTiming, bus: int) -> None:
        super().__init__(axes, timing, bus)
        self.turn_ns = timing.mean_exchange_ns(COUNT_BYTES)

    def proceed(self) -> Stream:
        """The most urgent thing; or, if nothing is, whatever will be, at its time."""
        start = self._next_start()
        busy_until_ns = self.now_ns + self.timing.worst_ns(COUNT_BYTES)
        if start is not None and start[0] <= busy_until_ns:
            yield from self._lone_start(start[1], start[0])
            return
        axis = self._most_urgent(self.now_ns)
        if axis is not None:
            yield from self._count(axis, self.now_ns)
            return
        if (yield from self._prepare()):
            return
        yield from self._later(start)

    def _next_start(self) -> tuple[int, StepAxis] | None:
        """The leg that must be begun first, and when its load must be sent."""
        starts = []
        for axis in self.axes:
            if not axis.moving and axis.next_leg() is not None:
                send_ns = axis.lone_start_ns(self._horizon_ns()) - self.mean_ns(0, LEG_BYTES)
                if axis.needs_stop_motor():
                    send_ns -= self.timing.worst_ns(1)
                starts.append((send_ns, axis))
        return min(starts, key=lambda pair: pair[0], default=None)

    def _lone_start(self, axis: StepAxis, send_ns: int) -> Stream:
        if (yield from self.stop_motor(axis)):
            return
        send_ns = max(send_ns, self.now_ns)
        execute_ns = self.mean_ns(send_ns, LEG_BYTES)
        data, load = axis.leg_load(execute_ns, execute_ns + self._horizon_ns(), start_now=True)
        evidence = yield self.load(axis, data, send_ns)
        self.expect_rest(axis, evidence)
        axis.executed(load, *self.window(evidence))

    def _horizon_ns(self) -> int:
        """When this axis will get its next turn: the moving axes share the bus."""
        moving = sum(1 for axis in self.axes if axis.moving)
        return int(HORIZON * self.turn_ns * max(moving, 1)) + self.turn_ns

    def _most_urgent(self, send_ns: int) -> StepAxis | None:
        """The axis for which a load sent at ``send_ns`` mends most, if it mends enough."""
        best, worth = None, WORTH_STEPS
        latest_ns = self.latest_ns(send_ns, COUNT_BYTES)
        execute_ns = self.mean_ns(send_ns, COUNT_BYTES)
        horizon_ns = self._horizon_ns()
        for axis in self.axes:
            if axis.surely_moving_at(latest_ns):
                mends = axis.urgency_steps(execute_ns, horizon_ns, latest_ns - execute_ns)
                if mends > worth:
                    best, worth = axis, mends
        return best

    def _count(self, axis: StepAxis, send_ns: int) -> Stream:
        execute_ns = self.mean_ns(max(send_ns, self.now_ns), COUNT_BYTES)
        data, load = axis.count_load(execute_ns, execute_ns + self._horizon_ns(), start_now=True)
        evidence = yield self.load(axis, data, send_ns)
        self.expect_moving(axis, evidence)
        axis.executed(load, *self.window(evidence))

    def _prepare(self) -> Said:
        """Use a free moment: Stop Motor before reversals, the moving bit of an axis that has probably arrived."""
        for axis in self.axes:
            first = axis.first_step_ns()
            if first is None or first - self.now_ns > PREPARE_NS:
                continue
            if axis.likely_stopped_at(self.now_ns):
                yield from self.ask(axis)
                return True
            if not axis.moving and (yield from self.stop_motor(axis)):
                return True
        return False

    def _later(self, start: tuple[int, StepAxis] | None) -> Stream:
        """Nothing is worth sending now: send what will be first, when it will be."""
        limit_ns = self.now_ns + LOOK_AHEAD_NS if start is None else start[0] - self.timing.worst_ns(COUNT_BYTES)
        ends = [axis.twin.surely_stopped_from_ns() + 1 for axis in self.axes if axis.moving]
        limit_ns = min([limit_ns, self.now_ns + LOOK_AHEAD_NS, *ends])
        at_ns = self.now_ns + LOOK_NS
        while at_ns < limit_ns:
            axis = self._most_urgent(at_ns)
            if axis is not None:
                yield from self._count(axis, at_ns)
                return
            at_ns += LOOK_NS
        if start is not None and start[0] <= at_ns + self.timing.worst_ns(COUNT_BYTES):
            yield from self._lone_start(start[1], start[0])
            return
        moving = next((axis for axis in self.axes if axis.moving), self.axes[0])
        yield Exchange(moving.motor.address, NO_OPERATION, send_at_ns=max(limit_ns, self.now_ns), bus=self.bus)
