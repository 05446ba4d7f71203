"""Lanes: what the adaptive schedule sees of an axis, whatever chip it has, and the lane of a PIC-STEP.

A lane has *appointments* (something must be sent at a certain instant, such as the start of a leg), things that *mend*
(a load that would keep the axis nearer to its plan, worth so many micrometres) and *chores* for free moments.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from bisect import bisect_left
from dataclasses import dataclass

from nmc.budget import BusTiming
from nmc.program import Exchange
from planner.steptrain import LEG_BYTES
from planner.stream_axis import SAFETY_NS, StepAxis
from planner.stream_base import (
    AMP_ENABLE,
    COUNT_BYTES,
    PREPARE_NS,
    STOP_ABRUPTLY,
    STOP_MOTOR,
    Said,
    StepSchedule,
    Stream,
)
from planner.stream_feedback import POSITION_BYTES, POSITION_ITEM, READ_STATUS

HALT_NS = 200_000
"""A Stop Motor into a gap is complete this long after the step before it."""
EARLY_NS = 300_000
"""An axis that would arrive this much before its plan is slowed in good time."""
ASK_DEVIATIONS = 2.0
"""An axis is asked when it has arrived with this much certainty."""
ASK_AGAIN_NS, ASK_AGAIN_EXCHANGES = 2_000_000, 3
"""Between two questions whether an axis has arrived; on a bus of few baud two of three exchanges are for others."""
CALM = 0.2
"""Share of a period after its middle at which a load is still far enough from the next roll-over."""
LAST_NS = 150_000
"""How long before the last safe moment the slowing count is sent."""


@dataclass(frozen=True, slots=True)
class Turn:
    """What a lane needs to know to judge a load: when it would be sent, and when the next one would be."""

    send_ns: int
    horizon_ns: int


class Lane(ABC):
    """One axis of an adaptive stream. All instants are link time in ns."""

    address: int
    timing: BusTiming

    @property
    @abstractmethod
    def moving(self) -> bool:
        """The axis moves, or may."""

    @property
    @abstractmethod
    def done(self) -> bool:
        """Nothing is left to be sent."""

    @abstractmethod
    def settle(self, now_ns: int) -> None:
        """Take note of what must have happened by now."""

    @abstractmethod
    def appointment_ns(self, horizon_ns: int) -> int | None:
        """When the next thing that must be on time has to be sent."""

    @abstractmethod
    def keep(self, turn: Turn) -> Stream:
        """Send it."""

    @abstractmethod
    def delay_um(self, delay_ns: int, turn: Turn) -> float:
        """How far the axis would get from its plan if its appointment were kept so much later."""

    @abstractmethod
    def worth_um(self, turn: Turn) -> float:
        """How much nearer to its plan a load would bring the axis at the horizon; 0 if none can or need be sent."""

    @abstractmethod
    def mend(self, turn: Turn) -> Stream:
        """Send that load."""

    @abstractmethod
    def chore(self, now_ns: int) -> Said:
        """Send something useful in a free moment."""

    @abstractmethod
    def next_change_ns(self) -> int | None:
        """When the axis will stop by itself, if it will."""


class StepLane(Lane):
    """A PIC-STEP axis in the adaptive stream."""

    def __init__(self, axis: StepAxis, schedule: StepSchedule) -> None:
        self.axis = axis
        self.schedule = schedule
        self.timing: BusTiming = schedule.timing
        self.address = axis.motor.address
        self.step_um = 1000.0 / abs(axis.motor.steps_per_unit)
        wires_ns = self.timing.command_ns(0) + self.timing.reply_ns(0)
        self.ask_again_ns = max(ASK_AGAIN_NS, ASK_AGAIN_EXCHANGES * wires_ns)

    @property
    def moving(self) -> bool:
        """A leg has been started and is not known to be over."""
        return self.axis.moving

    @property
    def done(self) -> bool:
        """No leg runs and none is left."""
        return not self.axis.moving and self.axis.next_leg() is None

    def settle(self, now_ns: int) -> None:
        """Close the leg if even the slowest chip has arrived."""
        self.axis.settle(now_ns)

    def appointment_ns(self, horizon_ns: int) -> int | None:
        """When the load that begins the next leg has to be sent, or the last count that can safely slow this one."""
        axis = self.axis
        if axis.halts:
            return max(axis.halt_ns(), self.schedule.now_ns) + HALT_NS - self.timing.command_ns(1)
        if axis.next_leg() is None:
            return self._last_count_ns() if axis.moving else None
        send_ns = axis.lone_start_ns(horizon_ns) - self.schedule.mean_ns(0, LEG_BYTES)
        if axis.needs_stop_motor():
            send_ns -= self.timing.worst_ns(1)
        if not axis.moving:
            return send_ns
        arrived_ns = self._arrived_ns(send_ns)
        last_ns = self._last_count_ns()
        return arrived_ns if last_ns is None else min(last_ns, arrived_ns)

    def delay_um(self, delay_ns: int, turn: Turn) -> float:
        """A leg that begins late is late by the steps that it misses; a last count that comes too late is lost.

        The Stop Motor into a gap has as long as no chip can make another step: a longest period, most often.
        """
        if self.axis.halts:
            stopped_ns = self.schedule.latest_ns(turn.send_ns + self.timing.worst_ns(COUNT_BYTES), 1)
            return 0.0 if self.axis.twin.fast.left_at(stopped_ns) >= self.axis.beyond else math.inf
        if delay_ns <= 0:
            return 0.0
        leg = self.axis.next_leg()
        missed = 0 if leg is None else bisect_left(leg.instants_ns, leg.instants_ns[0] + delay_ns)
        return max(missed * self.step_um, self.worth_um(turn))

    def _arrived_ns(self, wanted_ns: int) -> int:
        """When to ask an axis whether it has arrived, so that its next leg begins at ``wanted_ns``.

        The slowest twin may be far behind where the host hesitates; the moving bit says what the chip does.
        """
        axis = self.axis
        likely_ns = axis.twin.nominal.arrival_ns() + round(ASK_DEVIATIONS * axis.twin.belief.arrival_deviation_ns())
        ask_ns = max(wanted_ns - self.timing.mean_exchange_ns(0), likely_ns - self.timing.command_ns(0))
        return max(ask_ns, axis.asked_ns + self.ask_again_ns)

    def _last_count_ns(self) -> int | None:
        """An axis that would arrive early must be slowed while even its fastest twin has steps to go."""
        axis = self.axis
        if axis.arrives_early_ns() < EARLY_NS:
            return None
        send_ns = axis.twin.surely_moving_until_ns() - SAFETY_NS - self.schedule.latest_ns(0, COUNT_BYTES) - LAST_NS
        return send_ns if send_ns > self.schedule.now_ns - LAST_NS else None

    def keep(self, turn: Turn) -> Stream:
        """Begin the leg, or send the Stop Motor that has to come before; or slow the leg that would end early."""
        axis, schedule = self.axis, self.schedule
        if axis.halts:
            yield from self._halt(turn.send_ns)
            return
        if axis.moving and axis.likely_stopped_at(turn.send_ns + self.timing.command_ns(0)):
            yield from schedule.ask(axis)
            return
        if axis.moving:
            yield from self.mend(turn)
            return
        if (yield from schedule.stop_motor(axis)):
            return
        execute_ns = schedule.mean_ns(turn.send_ns, LEG_BYTES)
        data, load = axis.leg_load(execute_ns, execute_ns + turn.horizon_ns, start_now=True)
        evidence = yield schedule.load(axis, data, turn.send_ns)
        schedule.expect_rest(axis, evidence)
        axis.executed(load, schedule.window(evidence))

    def _halt(self, send_ns: int) -> Stream:
        """Stop Motor into the gap behind the last wanted step, then the counter: what is left begins from there."""
        axis, schedule = self.axis, self.schedule
        stop = bytes((AMP_ENABLE | STOP_ABRUPTLY,))
        yield Exchange(self.address, STOP_MOTOR, stop, send_at_ns=send_ns, bus=schedule.bus)
        read = Exchange(self.address, READ_STATUS, POSITION_ITEM, reply_extra=POSITION_BYTES, bus=schedule.bus)
        evidence = yield read
        schedule.expect_rest(axis, evidence)
        axis.halted(int.from_bytes(evidence.extra, "little", signed=True), schedule.now_ns)

    def worth_um(self, turn: Turn) -> float:
        """See ``StepAxis.urgency_steps``; 0 if the fastest chip might have arrived when the load comes."""
        axis, schedule = self.axis, self.schedule
        latest_ns = schedule.latest_ns(turn.send_ns, COUNT_BYTES)
        if not axis.surely_moving_at(latest_ns):
            return 0.0
        execute_ns = schedule.mean_ns(turn.send_ns, COUNT_BYTES)
        return axis.urgency_steps(execute_ns, turn.horizon_ns, latest_ns - execute_ns) * self.step_um

    def mend(self, turn: Turn) -> Stream:
        """A count-only load, started at once; by an axis that moves alone in the middle between two roll-overs."""
        axis, schedule = self.axis, self.schedule
        send_ns = turn.send_ns
        if schedule.moving == 1:
            calm_ns = self._calm_ns(send_ns)
            if axis.surely_moving_at(schedule.latest_ns(calm_ns, COUNT_BYTES)):
                send_ns = calm_ns
        execute_ns = schedule.mean_ns(send_ns, COUNT_BYTES)
        unsure_ns = schedule.latest_ns(send_ns, COUNT_BYTES) - execute_ns
        data, load = axis.best_load(execute_ns, turn.horizon_ns, unsure_ns)
        evidence = yield schedule.load(axis, data, send_ns)
        if not evidence.sent:
            schedule.late_slices += 1
            return
        schedule.expect_moving(axis, evidence)
        axis.executed(load, schedule.window(evidence))

    def _calm_ns(self, send_ns: int) -> int:
        """The instant from ``send_ns`` on at which a load is furthest from a roll-over, within a period.

        Which of two roll-overs takes a count is then certain, if periods are longer than execution is unsure.
        """
        schedule, timer = self.schedule, self.axis.twin.nominal
        execute_ns = schedule.mean_ns(send_ns, COUNT_BYTES)
        unsure_ns = schedule.latest_ns(send_ns, COUNT_BYTES) - execute_ns
        next_ns, left = timer.ahead(execute_ns)
        if left < 3 or timer.period_ns < 2 * unsure_ns:
            return send_ns
        middle_ns = next_ns - timer.period_ns // 2
        if middle_ns < execute_ns - CALM * timer.period_ns:
            middle_ns += timer.period_ns
        return send_ns + max(middle_ns - execute_ns, 0)

    def chore(self, now_ns: int) -> Said:
        """Stop Motor before a reversal; the moving bit of an axis that has probably arrived."""
        axis = self.axis
        first = axis.first_step_ns()
        if first is None or first - now_ns > PREPARE_NS:
            return False
        if axis.likely_stopped_at(now_ns):
            yield from self.schedule.ask(axis)
            return True
        if axis.moving:
            return False
        return (yield from self.schedule.stop_motor(axis))

    def next_change_ns(self) -> int | None:
        """When even the slowest chip has arrived."""
        return self.axis.twin.surely_stopped_from_ns() + 1 if self.axis.moving else None
