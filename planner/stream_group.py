"""Profile ``group``: every member is reloaded every slice and one group Start Motion begins the slice for all.

    slice k:   [latch or read] [leavers parked] [recruits grouped] [loads] [axes outside the group] ..| Start k |
                                                                                           send_at ---^

While others move, a leg begins alone at its own instant (start now) and its axis joins the group once it runs. An axis
that cannot be sure to move at the next Start leaves the group before it and ends its leg alone, on the stop position
that the chip itself watches, helped by count-only loads of its own while that is safe.

Each slice may begin with one exchange of the round that latches the counters of the group and reads them back
(``planner.stream_feedback``): periods and the instant of the Start are chosen for where the chips most likely are and
for what exchanges take on average, safety for the worst.
"""

from __future__ import annotations

from collections.abc import Sequence

from nmc.budget import BusTiming
from nmc.program import Exchange
from planner.steptrain import LEG_BYTES
from planner.stream_adaptive import AdaptiveSchedule
from planner.stream_axis import Load, StepAxis
from planner.stream_base import COUNT_BYTES, NO_OPERATION, PREPARE_NS, Said, StepSchedule, Stream
from planner.stream_feedback import HOME_BYTES, Feedback
from planner.stream_members import Change, cost, next_change

FORESEEN_NS = 9_000_000
"""Turns of other axes lengthen a slice, and periods are chosen for that, but for no longer time than this: while a path
speeds up, one period for all of it is more wrong on the way than it is right at the end."""
TRIM_STEPS = 0.2
"""An axis that runs alone is given a new count when it would get this many steps off its plan without."""


class GroupSchedule(StepSchedule):
    """One group Start a slice. Holds, overrides and slowing go on ``adaptive``, which takes the same for granted."""

    successor: AdaptiveSchedule | None = None

    def __init__(self, axes: Sequence[StepAxis], timing: BusTiming, bus: int) -> None:
        super().__init__(axes, timing, bus)
        self.feedback = Feedback(self, axes)
        self._right_until_ns = 0
        """Until the Start at this instant the counts of the slice that runs were chosen."""
        self.change: Change | None = None
        """The group of the coming Start, as foreseen at the last; None: as it is."""

    @property
    def changing(self) -> bool:
        """A successor waits to take over."""
        return self.successor is not None

    def hand_over(self) -> AdaptiveSchedule:
        """The schedule that goes on after the slice that is being said."""
        if self.successor is None:
            self.successor = AdaptiveSchedule(self.axes, self.timing, self.bus)
            self.successor.groups = self.groups
        return self.successor

    def run(self) -> Stream:
        """All exchanges until every leg is done and every axis rests, or until a successor takes over."""
        while self.successor is None:
            for axis in self.axes:
                axis.settle(self.now_ns)
            moving = any(axis.moving for axis in self.axes)
            due = [ns for axis in self.axes if not axis.moving and (ns := axis.first_step_ns()) is not None]
            if not moving and not due:
                return
            if moving:
                yield from self.proceed()
            else:
                self.change = None
                yield from self.depart(min(due))
        yield from self.successor.run()

    def proceed(self) -> Stream:
        """One slice: everything that must be said before its Start, then the Start; without members, the rest alone."""
        if self.feedback.due():
            yield from self.feedback.step()
        members = self._members()
        yield from self.regroup({axis.motor.address for axis in members})
        start_ns = self._likely_start_ns(len(members))
        worst_ns = self.now_ns + (len(members) + self._outside()) * self.timing.worst_ns(COUNT_BYTES)
        foreseen_ns, self._right_until_ns = max(worst_ns, self._right_until_ns), 0
        slice_ns = self.likely_slice_ns(len(members)) + self._outside() * self.timing.mean_exchange_ns(COUNT_BYTES)
        self.change = next_change(self.axes, self.groups, slice_ns, self.latest_ns, start_ns)
        pending: list[tuple[StepAxis, Load]] = []
        execute_ns = self.mean_ns(start_ns)
        ahead_ns = self._ahead_ns(self.change, start_ns)
        target_ns = execute_ns + ahead_ns
        for axis in members:
            data, load = axis.count_load(execute_ns, target_ns, start_now=False)
            evidence = yield self.load(axis, data)
            self.expect_moving(axis, evidence)
            pending.append((axis, load))
        said = yield from self._alone(start_ns)
        if pending:
            yield from self.start(start_ns, pending, foreseen_ns)
            self._right_until_ns = start_ns + ahead_ns
        elif not said and any(axis.moving for axis in self.axes):
            yield self._wait(start_ns)

    def _members(self) -> list[StepAxis]:
        """Who takes part in the coming Start: what was foreseen, but only those that surely still move then.

        Where one must leave that was not foreseen to, nobody joins.
        """
        wanted = self.groups.streaming if self.change is None else self.change.wanted
        members = [axis for axis in self.axes if axis.motor.address in wanted and axis.moving]
        while True:
            commands = cost(self.groups, {axis.motor.address for axis in members}, self.axes)
            start_ns = self._likely_start_ns(len(members)) + commands * self.timing.mean_exchange_ns(2)
            safe = [axis for axis in members if axis.surely_moving_at(self.latest_ns(start_ns))]
            if len(safe) == len(members):
                return members
            members = [axis for axis in safe if axis.in_stream]

    def _ahead_ns(self, change: Change, start_ns: int) -> int:
        """How long the slice that begins at ``start_ns`` likely lasts, until the next Start."""
        timing = self.timing
        loads = sum(1 for axis in self.axes if axis.moving) * timing.mean_exchange_ns(COUNT_BYTES)
        ahead_ns = timing.mean_exchange_ns(0) + loads + change.commands * timing.mean_exchange_ns(2)
        turns = sum(1 for axis in self.axes if axis.turns_before(start_ns + ahead_ns))
        turn_ns = timing.mean_exchange_ns(0) + timing.mean_exchange_ns(1) + timing.mean_exchange_ns(LEG_BYTES)
        ahead_ns = max(ahead_ns, min(ahead_ns + turns * turn_ns, FORESEEN_NS))
        return ahead_ns + self.feedback.due_at(start_ns) * timing.mean_exchange_ns(1, HOME_BYTES)

    def _outside(self) -> int:
        return sum(1 for axis in self.axes if axis.moving and not axis.in_stream)

    def _alone(self, start_ns: int) -> Said:
        """What axes outside the group need before the Start; True if anything was sent."""
        said = False
        for axis in self.axes:
            if axis.in_stream and axis.moving:
                continue
            axis.settle(self.now_ns)
            first = axis.first_step_ns()
            soon = first is not None and first - self.now_ns < PREPARE_NS
            if soon and axis.likely_stopped_at(self.now_ns):
                yield from self.ask(axis)
                said = True
            if axis.moving:
                said = (yield from self._trim(axis)) or said
            elif soon:
                said = (yield from self.stop_motor(axis)) or said
                said = (yield from self._lone_start(axis, start_ns)) or said
        return said

    def _lone_start(self, axis: StepAxis, start_ns: int) -> Said:
        """Begin a leg by itself so that its first step comes on time; True if it was begun."""
        leg = axis.next_leg()
        assert leg is not None
        lead_ns = self.mean_ns(0, LEG_BYTES)
        ahead_ns = self.likely_slice_ns(len(self.axes))
        send_ns = max(axis.lone_start_ns(ahead_ns) - lead_ns, self.now_ns)
        if send_ns > max(start_ns, self.now_ns):
            return False
        execute_ns = send_ns + lead_ns
        data, load = axis.leg_load(execute_ns, execute_ns + ahead_ns, start_now=True)
        evidence = yield self.load(axis, data, send_ns)
        self.expect_rest(axis, evidence)
        axis.executed(load, self.window(evidence))
        return True

    def _trim(self, axis: StepAxis) -> Said:
        """Give an axis that runs alone a count that lets it arrive on time, if that is safe and worth it."""
        if not axis.surely_moving_at(self.latest_ns(self.now_ns, COUNT_BYTES)):
            return False
        execute_ns = self.mean_ns(self.now_ns, COUNT_BYTES)
        target_ns = execute_ns + self.likely_slice_ns(len(self.axes))
        if axis.aim_error_steps(execute_ns, target_ns) < TRIM_STEPS:
            return False
        data, load = axis.count_load(execute_ns, target_ns, start_now=True)
        evidence = yield self.load(axis, data)
        if not evidence.sent:
            return False
        self.expect_moving(axis, evidence)
        axis.executed(load, self.window(evidence))
        return True

    def likely_slice_ns(self, loads: int) -> int:
        """Bus time of a slice as it is on average; what is safe is decided by ``slice_ns`` and ``latest_ns``.

        A slice as long as its worst case would leave the bus idle for most of it on a host that hesitates now and then.
        """
        return loads * self.timing.mean_exchange_ns(COUNT_BYTES) + self.timing.mean_exchange_ns(0)

    def _likely_start_ns(self, members: int) -> int:
        """When the Start will leave, now that the group is as it shall be: what was set aside for that is over."""
        return self.now_ns + (members + self._outside()) * self.timing.mean_exchange_ns(COUNT_BYTES)

    def _wait(self, start_ns: int) -> Exchange:
        """Nothing to say in this slice: ask the axis that ends next how it is."""
        ends = [(axis.twin.surely_stopped_from_ns() + 1, axis) for axis in self.axes if axis.moving]
        until_ns, axis = min(ends, key=lambda end: end[0])
        return Exchange(axis.motor.address, NO_OPERATION, send_at_ns=min(until_ns, start_ns), bus=self.bus)
