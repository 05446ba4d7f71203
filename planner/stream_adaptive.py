"""Profile ``adaptive``: inside a run the bus goes to the axis that would be furthest off its plan without it.

There is no slice and, while anything moves, no group Start: every load is a "start now" to one axis, so no stale Start
can happen by construction. A load of a PIC-STEP acts at the next roll-over only, so the instant at which it is sent
matters little and the period it carries is chosen for what comes after that roll-over.

                 X      Y   X      Z        X    Y              a load is worth its bus time only if it brings the
    bus   ...--[##]---[##][##]---[##]-----[##]-[##]--...        axis a fifth of a micrometre nearer; if none
                                                                does, the bus waits until one will
"""

from __future__ import annotations

from collections.abc import Sequence

from nmc.budget import BusTiming
from nmc.program import Exchange
from planner.steptrain import LEG_BYTES
from planner.stream_axis import StepAxis
from planner.stream_base import COUNT_BYTES, NO_OPERATION, StepSchedule, Stream
from planner.stream_feedback import Feedback
from planner.stream_hold import Hold
from planner.stream_lane import Lane, StepLane, Turn
from planner.stream_servo import VELOCITY_BYTES, ServoLane, SmoothLane, StopHereLane
from planner.types import Trajectory

WORTH_UM = 0.2
"""A load is sent only if it mends at least this much."""
ALARMING_UM = 5.0
"""A load that mends this much comes before a counter that is due to be read."""
ASTRAY_UM = 1.5
"""A load that mends this much comes before an axis is taken into the group."""
HORIZON = 0.6
"""Share of the time between two turns of an axis after which a load should have put it right, plus one turn."""
OVERDUE = 2
"""An appointment is overdue when so many exchanges have come before it."""
LOOK_NS = 400_000
"""First step of the search for the next moment at which something is worth sending; it grows by a quarter a step."""
LOOK_AHEAD_NS = 20_000_000
UNHEARD_NS = 250_000_000
"""A servo that rests is asked when it has been silent for so long: that it has switched itself off shows in its answers
only. Where others have much to mend, after twice the time."""
IDLE_NS = 20_000_000
"""A held machine is asked how it is this often."""


class AdaptiveSchedule(StepSchedule):
    """Event-driven single loads to lanes of any chip."""

    def __init__(self, axes: Sequence[StepAxis], timing: BusTiming, bus: int) -> None:
        super().__init__(axes, timing, bus)
        self.lanes: list[Lane] = [StepLane(axis, self) for axis in axes]
        self.servos: list[ServoLane] = []
        self.exchange_ns = timing.mean_exchange_ns(COUNT_BYTES)
        self.soon_ns = timing.worst_ns(COUNT_BYTES)
        """An appointment this near is waited for. A host that proves slower does not make it longer: slow axes, whose
        every step is an appointment, would keep all others from the bus."""
        self.feedback = Feedback(self, axes)
        self.hold: Hold | None = None
        self._new_times: Trajectory | None = None

    def add_servo(self, lane: SmoothLane | StopHereLane) -> None:
        """A PIC-SERVO shares the bus; its loads are longer, and it has no part in group Starts."""
        self.lanes.append(lane)
        self.servos.append(lane)
        self.exchange_ns = self.timing.mean_exchange_ns(VELOCITY_BYTES if isinstance(lane, SmoothLane) else COUNT_BYTES)

    def assume(self, timing: BusTiming) -> None:
        """What is assumed of the bus has changed."""
        super().assume(timing)
        for lane in self.lanes:
            lane.timing = timing
        smooth = any(isinstance(lane, SmoothLane) for lane in self.servos)
        self.exchange_ns = timing.mean_exchange_ns(VELOCITY_BYTES if smooth else COUNT_BYTES)

    def run(self) -> Stream:
        """Lock onto the servo clocks, then play; a bus of steppers alone leaves every rest on a group Start."""
        for servo in self.servos:
            yield from servo.prelude()
        if not all(lane.done for lane in self.lanes):
            yield from self.regroup({axis.motor.address for axis in self.axes})
        while True:
            for lane in self.lanes:
                lane.settle(self.now_ns)
            self._take_new_times()
            over = all(lane.done for lane in self.lanes)
            if self.hold is not None and over and self.now_ns > self.hold.rest_ns:
                self.hold.stands = True
            if not over:
                yield from self._play()
            elif self.hold is not None:
                yield from self._idle()
            else:
                return

    def _idle(self) -> Stream:
        """A machine that is held is asked how it is, each servo in its turn."""
        at_ns = self.now_ns + IDLE_NS
        silent = self._silent()
        if silent is not None:
            yield from silent.ask(at_ns)
        else:
            yield Exchange(self.lanes[0].address, NO_OPERATION, send_at_ns=at_ns, bus=self.bus)

    def _silent(self, worth_um: float = 0.0) -> ServoLane | None:
        """The servo not heard for longest, if that is too long. worth_um: what another load would mend."""
        before_ns = self.now_ns - (UNHEARD_NS if worth_um < ALARMING_UM else 2 * UNHEARD_NS)
        found: ServoLane | None = None
        for lane in self.servos:
            if lane.heard_ns < before_ns:
                found, before_ns = lane, lane.heard_ns
        return found

    def _play(self) -> Stream:
        due = [ns for axis in self.axes if not axis.moving and (ns := axis.first_step_ns()) is not None]
        if self.servos or not due or any(axis.moving for axis in self.axes):
            yield from self.proceed()
        else:
            yield from self.depart(min(due))

    @property
    def changing(self) -> bool:
        """New times have come and are not taken yet."""
        return self._new_times is not None

    @property
    def moving(self) -> int:
        """How many lanes move: a servo beside a stepper takes its share of the bus."""
        return sum(1 for lane in self.lanes if lane.moving)

    def retime(self, trajectory: Trajectory, rest_ns: int | None) -> None:
        """The trajectory has new times after what was sent. rest_ns: when a hold comes to rest, None without one."""
        self.hold = None if rest_ns is None else Hold(rest_ns)
        self._new_times = trajectory

    def departure_ns(self) -> int:
        """What has to be waited for and said, at worst, before a held machine sets out again.

        That is the end of an idle moment, then Stop Motor, group and load of each stepper, and the Start.
        """
        timing = self.timing
        said_ns = timing.worst_ns(1) + timing.worst_ns(2) + timing.worst_ns(LEG_BYTES)
        return IDLE_NS + len(self.axes) * said_ns + timing.worst_ns(0)

    def _take_new_times(self) -> None:
        """Between two things said: a leg that is loaded but not started must not lose its place."""
        if self._new_times is None:
            return
        for axis in self.axes:
            self.alive()
            axis.retime(self._new_times, self.now_ns)
        for servo in self.servos:
            self.alive()
            servo.retime()
        self._new_times = None

    def proceed(self) -> Stream:
        """The most urgent thing; or, if nothing is, whatever will be, at its time."""
        turn = Turn(self.now_ns, self._horizon_ns())
        first = self._next_appointment(turn)
        lane, worth_um = self._most_urgent(turn)
        if first is not None and first[0] <= self.now_ns + self.soon_ns:
            if lane is None or not self._comes_first(first, lane, worth_um, turn):
                yield from first[1].keep(Turn(max(first[0], self.now_ns), turn.horizon_ns))
            else:
                yield from lane.mend(turn)
            return
        silent = self._silent(worth_um)
        if silent is not None:
            yield from silent.ask()
            return
        doubtful = self.feedback.doubtful()
        if doubtful is not None and worth_um < ALARMING_UM:
            yield from self.feedback.look(doubtful)
            return
        if self.feedback.due() and self.feedback.overdue() and worth_um < ALARMING_UM:
            yield from self.feedback.step()
            return
        if worth_um < ASTRAY_UM:
            astray = {axis.motor.address for axis in self.axes if axis.moving and not axis.in_stream}
            if astray:
                yield from self.regroup(self.groups.streaming | astray)
                return
        if lane is not None:
            yield from lane.mend(turn)
            return
        for lane in self.lanes:
            if (yield from lane.chore(self.now_ns)):
                return
        if self.feedback.due():
            yield from self.feedback.step()
            return
        yield from self._later(first, turn.horizon_ns)

    def _comes_first(self, first: tuple[int, Lane], urgent: Lane, worth_um: float, turn: Turn) -> bool:
        """Whether an exchange comes before an appointment, because another lane would lose more by waiting."""
        at_ns, lane = first
        delay_ns = self.now_ns + self.exchange_ns - at_ns
        if lane is urgent:
            return lane.moving
        return worth_um > lane.delay_um(delay_ns, turn)

    def _horizon_ns(self) -> int:
        """When an axis will get its next turn: the moving ones share the bus."""
        return int(HORIZON * self.exchange_ns * max(self.moving, 1)) + self.exchange_ns

    def _next_appointment(self, turn: Turn) -> tuple[int, Lane] | None:
        """The appointment that comes first; of several that are long overdue the one that loses most by waiting."""
        first: tuple[int, Lane] | None = None
        overdue, overdue_ns = 0, self.now_ns - OVERDUE * self.soon_ns
        for lane in self.lanes:
            at_ns = lane.appointment_ns(turn.horizon_ns)
            if at_ns is None:
                continue
            overdue += at_ns < overdue_ns
            if first is None or at_ns < first[0]:
                first = at_ns, lane
        return first if overdue < 2 else self._dearest(overdue_ns, turn)

    def _dearest(self, overdue_ns: int, turn: Turn) -> tuple[int, Lane]:
        """Of the appointments before ``overdue_ns``, of which there are some, the one that loses most by waiting."""
        next_ns = self.now_ns + self.exchange_ns
        missed = [
            (at_ns, lane)
            for lane in self.lanes
            if (at_ns := lane.appointment_ns(turn.horizon_ns)) is not None and at_ns < overdue_ns
        ]
        return max(missed, key=lambda each: each[1].delay_um(next_ns - each[0], turn))

    def _most_urgent(self, turn: Turn) -> tuple[Lane | None, float]:
        """The lane for which a load mends most, if it mends enough, and how much."""
        best: Lane | None = None
        worth = WORTH_UM
        for lane in self.lanes:
            mends = lane.worth_um(turn)
            if mends > worth:
                best, worth = lane, mends
        return best, worth

    def _later(self, first: tuple[int, Lane] | None, horizon_ns: int) -> Stream:
        """Nothing is worth sending now: send what will be first, when it will be."""
        ends = [ns for lane in self.lanes if (ns := lane.next_change_ns()) is not None]
        limit_ns = min([self.now_ns + LOOK_AHEAD_NS, *ends])
        if first is not None:
            limit_ns = min(limit_ns, first[0] - self.soon_ns)
        look_ns = LOOK_NS
        at_ns = self.now_ns + look_ns
        while at_ns < limit_ns:
            lane, _ = self._most_urgent(Turn(at_ns, horizon_ns))
            if lane is not None:
                yield from lane.mend(Turn(at_ns, horizon_ns))
                return
            look_ns += LOOK_NS // 4
            at_ns += look_ns
        if first is not None and first[0] <= at_ns + self.soon_ns:
            yield from first[1].keep(Turn(max(first[0], self.now_ns), horizon_ns))
            return
        asked = next((lane for lane in self.lanes if lane.moving), None)
        silent = self._silent() if asked is None else None
        if silent is not None:
            yield from silent.ask(max(limit_ns, self.now_ns))
            return
        address = self.lanes[0].address if asked is None else asked.address
        yield Exchange(address, NO_OPERATION, send_at_ns=max(limit_ns, self.now_ns), bus=self.bus)
