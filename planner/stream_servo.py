"""Lanes of PIC-SERVO axes: ``stop-here`` points and ``smooth`` velocity slices, one trajectory.

``stop-here``: each Stop Motor with Stop Here (PIC-SERVO data sheet, section 5.2) makes the command jump to a point,
taken from the plan in the middle of the time that it will stand. A silent host leaves the axis standing. Between two
points the command stands, and what counts is how far it is from the path: ``Pace`` and ``across``.

``smooth``: velocity mode, a goal velocity and an acceleration a turn. The profiler's arithmetic is known to the last
bit, so the host knows the command position at every tick and steers it back onto the plan:

    v
      |        ____v1        v1 and the length of the ramp: least squares of the distance from the plan at the
      |   ___/               ticks of the turn and a few beyond it, for a late turn goes on at v1
      | v0
      +----|----|----> tick
"""

from __future__ import annotations

import math
import operator

from nmc.budget import BusTiming
from nmc.program import Evidence, Exchange
from nmc.servo_twin import FRACTION_BITS, Profiler, TickClock
from planner.motors import ServoMotor
from planner.quantize import nearest_step
from planner.stream_axis import LOAD_TRAJECTORY
from planner.stream_base import AMP_ENABLE, NO_OPERATION, STOP_MOTOR, Said, StepSchedule, Stream
from planner.stream_lane import Lane, Turn
from planner.stream_track import Track
from planner.types import Trajectory

STOP_HERE = 0x10
"""Stop control byte (section 5.2)."""
LOAD_VELOCITY, LOAD_ACCELERATION, SERVO_MODE, VELOCITY_MODE, REVERSE, START_NOW = 0x02, 0x04, 0x10, 0x20, 0x40, 0x80
"""Control byte of Load Trajectory (section 5.2)."""
STOP_HERE_BYTES, VELOCITY_BYTES = 5, 9
LOCK_EXCHANGES = 12
"""Answers observed before motion to find the phase and rate of a servo clock."""
TICKS_MIN = 4
BEYOND = 0.5
"""The end of a turn comes late as a rule: the plan is looked at this share of the turn beyond it."""
RAMPS = (0.2, 0.4, 0.6, 0.8, 1.0, 1.2)
"""Lengths of the velocity ramp that are tried, shares of the turn."""
ACROSS_MIN = 0.3
"""What a distance along the path counts for: it is lag, but must not grow."""
PACE_LOST_NS = 8_000_000
"""A pace that is this far from real time begins anew: nothing was worth sending in between."""
PACE_PHASE, PACE_RATE = 0.15, 0.02
"""How the pace follows real time, shares of what it is behind: a loop with a damping of a half."""
STANDS_LOW, STANDS_HIGH = 0.9, 2.0
"""Bounds for how long a point is thought to stand, over the horizon of the turn."""
STANDS_FOLLOWS = 0.2
"""That follows how long the points of the axis stood, by this share of the difference a point."""
REST_COUNTS = 2.0
REST_VELOCITY = 0.4
"""A command this close to a resting plan, and this slow (counts a tick), is put onto it by Stop Here."""
STILL_COUNTS = 0.05
STILL_NS = 5_000_000
"""A plan that stays within ``STILL_COUNTS`` for this time rests."""
BEGINS_NS, BEGINS_STEP_NS, BEGINS_COUNTS_S = 8_000_000, 250_000, 20.0
"""A plan that leaves its count began to do so when it was this slow, or this long before; step of the search."""
TOGETHER_NS = 10_000_000
"""Axes that begin within this time begin together."""
EARLY, EARLY_MAX_NS = 2.0 / 3.0, 3_500_000
"""Share of the exchanges of a common beginning that come before it, and for how long they may."""
ONE = 1 << FRACTION_BITS


class ServoLane(Lane):
    """What both profiles share: the plan in counts, the servo clock, Stop Here."""

    def __init__(self, trajectory: Trajectory, motor: ServoMotor, schedule: StepSchedule, start_ns: int) -> None:
        self.motor = motor
        self.schedule = schedule
        start_ns -= motor.lead_ns  # the whole plan that much earlier: the shaft is then where the plan is
        self.timing: BusTiming = schedule.timing
        self.address = motor.address
        self.track = Track(trajectory, motor.axis, motor.counts_per_unit, start_ns, schedule.alive)
        self.count_um = 1000.0 / abs(motor.counts_per_unit)
        self.clock = TickClock(motor.crystal_fast_ppb)
        self.heard_ns = 0
        """When it last answered: nobody else tells that its servo is still on."""
        self.point = nearest_step(self.track.at(start_ns), 1.0)

    def prelude(self) -> Stream:
        """Make the command position known and lock onto the servo clock, all at rest."""
        yield from self.stop_here(self.point, 0)
        for _ in range(LOCK_EXCHANGES):
            yield from self.ask()

    def ask(self, send_ns: int = 0) -> Stream:
        """Only the answer."""
        self.observe((yield Exchange(self.address, NO_OPERATION, send_at_ns=send_ns, bus=self.schedule.bus)))

    def stop_here(self, point: int, send_ns: int) -> Stream:
        """Put the command onto ``point`` (counts)."""
        data = bytes((AMP_ENABLE | STOP_HERE,)) + point.to_bytes(4, "little", signed=True)
        self.observe((yield Exchange(self.address, STOP_MOTOR, data, send_at_ns=send_ns, bus=self.schedule.bus)))
        self.point = point

    def observe(self, evidence: Evidence) -> int:
        """The number of the tick at whose end the exchange was executed and answered (section 4.1)."""
        self.heard_ns = evidence.replied_ns
        return self.clock.observe(evidence.replied_ns - self.timing.reply_ns(len(evidence.extra)))

    def execution_tick(self, send_ns: int, data_bytes: int) -> int:
        """The tick at whose end a command sent at ``send_ns`` will most likely be executed."""
        complete_ns = send_ns + self.timing.command_ns(data_bytes) + self.timing.jitter_max_ns // 2
        return self.clock.next_after(complete_ns)

    def retime(self) -> None:
        """The trajectory has new times: look everything up again."""
        self.track.forget()

    def off(self, now_ns: int) -> float:
        """How far the command is believed to be behind its plan, counts (signed)."""
        return self.track.at(now_ns) - self.point

    def delay_um(self, delay_ns: int, turn: Turn) -> float:
        """The begin of a motion cannot wait: a command that falls behind has to catch up."""
        return math.inf

    def settle(self, now_ns: int) -> None:
        """A servo lane learns nothing from time alone."""

    def chore(self, now_ns: int) -> Said:
        """Nothing to do in free moments."""
        yield from ()
        return False

    def next_change_ns(self) -> int | None:
        """Nothing happens by itself."""
        return None


class Pace:
    """The instants of the plan that Stop Here points are taken at, common to all axes of a bus.

    Between two executions the command stands, so how far it is from the path depends on the points alone and not on
    when they were executed: points at even distances make even stairs, whatever the host does. The pace follows real
    time slowly; what it is behind or ahead is lag along the path, if no other axis keeps to the time. alone: the servos
    of this bus are all axes there are.
    """

    def __init__(self, alone: bool = True) -> None:
        self.alone = alone
        self.last_ns = -math.inf
        self.step_ns = 0.0
        self.lanes: list[StopHereLane] = []

    def across(self, lane: StopHereLane, time_ns: float) -> float:
        """Which share of a distance along the axis of ``lane`` is a distance from the path; at least ``ACROSS_MIN``."""
        mine = lane.track.rate(time_ns) * lane.count_um
        square = math.fsum((each.track.rate(time_ns) * each.count_um) ** 2 for each in self.lanes)
        return max(math.sqrt(max(1.0 - mine * mine / square, 0.0)), ACROSS_MIN) if square else 1.0

    def next_ns(self, execution_ns: float) -> float:
        """Where the next point is taken if it is executed at ``execution_ns``."""
        behind = execution_ns - self.last_ns - self.step_ns
        if abs(behind) > PACE_LOST_NS or not self.step_ns or not self.alone:
            return execution_ns
        return self.last_ns + self.step_ns + PACE_PHASE * behind

    def take(self, execution_ns: float) -> float:
        """It is executed then: the instant at which the point is taken."""
        behind = execution_ns - self.last_ns - self.step_ns
        self.last_ns = self.next_ns(execution_ns)
        if abs(behind) <= PACE_LOST_NS:
            self.step_ns = max(self.step_ns + PACE_RATE * behind, 0.0) if self.step_ns else behind
        return self.last_ns


class StopHereLane(ServoLane):
    """Positions, each sampled for the middle of the time that it will stand."""

    def __init__(
        self, trajectory: Trajectory, motor: ServoMotor, schedule: StepSchedule, start_ns: int, pace: Pace
    ) -> None:
        super().__init__(trajectory, motor, schedule, start_ns)
        self.pace = pace
        pace.lanes.append(self)
        self._taken_ns = 0.0
        self._stands_ns = 0.0
        self._free_ns = 0

    @property
    def moving(self) -> bool:
        """The plan is not over, or its end has not been sent."""
        return not self.done

    @property
    def done(self) -> bool:
        """The last point has been sent and the plan is over."""
        over = self.schedule.now_ns >= self.track.end_ns
        return over and self.point == nearest_step(self.track.at(self.track.end_ns), 1.0)

    def appointment_ns(self, horizon_ns: int) -> int | None:
        """Points have no appointment: they are worth more the further the plan has gone."""
        return None

    def keep(self, turn: Turn) -> Stream:
        """Never asked for."""
        raise AssertionError("a lane without appointments")

    def worth_um(self, turn: Turn) -> float:
        """Distance of the next point from the one that stands, as far as it is across the path."""
        if turn.send_ns < self._free_ns:
            return 0.0
        away_um = abs(self._next_point(turn) - self.point) * self.count_um
        return away_um * self.pace.across(self, turn.send_ns)

    def mend(self, turn: Turn) -> Stream:
        """Send the point."""
        point, execution_ns = self._next_point(turn), self._execution_ns(turn)
        self._stands_ns = self._stood_ns(turn)
        self._taken_ns = self.pace.take(execution_ns)
        yield from self.stop_here(point, turn.send_ns)
        self._free_ns = self.schedule.now_ns + self._others_ns()

    def _others_ns(self) -> int:
        """How long the bus belongs to the others after a point: nothing, or a turn each if there are steppers.

        A point always mends more than a count does, so steppers would get the bus only when they are as far off.
        """
        if not self.schedule.axes:
            return 0
        return (len(self.pace.lanes) + len(self.schedule.axes) - 1) * self.timing.mean_exchange_ns(STOP_HERE_BYTES)

    def _execution_ns(self, turn: Turn) -> float:
        return self.clock.end_ns(self.execution_tick(turn.send_ns, STOP_HERE_BYTES))

    def _next_point(self, turn: Turn) -> int:
        """The plan in the middle of the time that the point will stand."""
        at_ns = self._at_ns(turn)
        return nearest_step(self.track.at(at_ns + self._stood_ns(turn) / 2), 1.0)

    def _at_ns(self, turn: Turn) -> float:
        return self.pace.next_ns(self._execution_ns(turn))

    def _stood_ns(self, turn: Turn) -> float:
        """An axis stands as long as it did on average.

        Now and then a slow axis comes between two fast ones: if these took the longer time for what comes next, they
        would jump twice as far, and half of that is a distance from the path.
        """
        stood_ns = self._at_ns(turn) - self._taken_ns
        stood_ns = min(max(stood_ns, turn.horizon_ns * STANDS_LOW), turn.horizon_ns * STANDS_HIGH)
        return stood_ns if not self._stands_ns else self._stands_ns + STANDS_FOLLOWS * (stood_ns - self._stands_ns)


class SmoothLane(ServoLane):
    """Velocity and acceleration a turn, Stop Here at rests and at the end."""

    def __init__(
        self,
        trajectory: Trajectory,
        motor: ServoMotor,
        schedule: StepSchedule,
        start_ns: int,
        mates: list[SmoothLane],
    ) -> None:
        super().__init__(trajectory, motor, schedule, start_ns)
        self.mates = mates
        mates.append(self)
        self.profiler = Profiler(self.point * ONE)
        self.tick = 0
        self.resting = True
        self._leaves_ns = self._next_leaving(self.track.start_ns)

    def retime(self) -> None:
        """A resting axis must look again when the plan leaves its place."""
        super().retime()
        if self.resting:
            self._leaves_ns = self._next_leaving(self.schedule.now_ns)

    def off(self, now_ns: int) -> float:
        """The profiler moves tick by tick: judged at the end of one, for half a tick of way is no error."""
        if self.resting:
            return super().off(now_ns)
        tick = max(self.clock.next_after(now_ns), self.tick)
        return self._wanted(tick) - self.profiler.after(tick - self.tick).position / ONE

    @property
    def moving(self) -> bool:
        """The profiler runs."""
        return not self.resting

    @property
    def done(self) -> bool:
        """It rests and the plan does not leave that place any more."""
        return self.resting and self._leaves_ns is None

    def appointment_ns(self, horizon_ns: int) -> int | None:
        """The first load of a motion: about when the plan begins to leave the place of rest."""
        if not self.resting or self._leaves_ns is None:
            return None
        before_ns = self.timing.command_ns(VELOCITY_BYTES) + self.timing.jitter_max_ns // 2
        return self._leaves_ns - before_ns + self._turn_of_departure_ns(self._leaves_ns)

    def _turn_of_departure_ns(self, leaves_ns: int) -> int:
        """Axes that begin to move together are loaded one after the other, most of them before their time.

        A plan begins slowly and a command can be fitted to the slow part of it: an axis that is loaded three
        milliseconds early is off by half a micrometre, one that late by ten times as much.
        """
        together = [lane for lane in self.mates if lane.begins_with(leaves_ns)]
        place = together.index(self) - EARLY * (len(together) - 1)
        return max(round(place * self.timing.mean_exchange_ns(VELOCITY_BYTES)), -EARLY_MAX_NS)

    def begins_with(self, leaves_ns: int) -> bool:
        """It rests and will begin to move at about the same time as another axis."""
        return self.resting and self._leaves_ns is not None and abs(self._leaves_ns - leaves_ns) < TOGETHER_NS

    def keep(self, turn: Turn) -> Stream:
        """Begin to move."""
        self.resting = False
        self.tick = self.clock.next_after(turn.send_ns)
        yield from self.mend(turn)

    def worth_um(self, turn: Turn) -> float:
        """Distance from the plan at the end of the turn if nothing were sent; a rest that is due is worth most."""
        if self.resting:
            return 0.0
        begin, end = self._ticks(turn)
        if self._rest_point(begin) is not None:
            return 1e6
        ahead = self.profiler.after(end - self.tick)
        return abs(ahead.position / ONE - self.track.at(self.clock.end_ns(end))) * self.count_um

    def mend(self, turn: Turn) -> Stream:
        """Steer the command back onto the plan, or put it to rest."""
        begin, end = self._ticks(turn)
        point = self._rest_point(begin)
        if point is not None:
            yield from self.stop_here(point, turn.send_ns)
            self.profiler = Profiler(point * ONE)
            self.resting = True
            self._leaves_ns = self._next_leaving(int(self.clock.end_ns(begin)))
            return
        goal, acceleration = self._steer(begin, end)
        control = LOAD_VELOCITY | LOAD_ACCELERATION | SERVO_MODE | VELOCITY_MODE | START_NOW
        control |= REVERSE if goal < 0 else 0
        data = bytes((control,)) + abs(goal).to_bytes(4, "little") + acceleration.to_bytes(4, "little")
        exchange = Exchange(self.address, LOAD_TRAJECTORY, data, send_at_ns=turn.send_ns, bus=self.schedule.bus)
        executed = self.observe((yield exchange))
        self.profiler.run(executed - self.tick)
        self.tick = executed
        self.profiler.goal, self.profiler.acceleration = goal, acceleration

    def _ticks(self, turn: Turn) -> tuple[int, int]:
        begin = self.execution_tick(turn.send_ns, VELOCITY_BYTES)
        return begin, begin + max(round(turn.horizon_ns / self.clock.period_ns), TICKS_MIN)

    def _steer(self, begin: int, end: int) -> tuple[int, int]:
        """Goal velocity and acceleration for the ticks from ``begin`` to ``end``: least squares to the plan.

        A ramp of m ticks to v0 + d, and d from then on, moves the command by k v0 + d r(k) in k ticks; for each of some
        lengths m the best d is known, and the best of those is taken. The plan is looked at a little beyond the end.
        """
        now = self.profiler.after(begin - self.tick)
        ticks = end - begin
        last = ticks + round(BEYOND * ticks)
        missing = [self._wanted(begin + k) * ONE - now.position - k * now.velocity for k in range(1, last + 1)]
        best, change, length = math.inf, 0.0, ticks
        for ramp in sorted({max(round(share * ticks), 1) for share in RAMPS}):
            moved = [k * (k + 1) / (2 * ramp) if k <= ramp else k - (ramp - 1) / 2 for k in range(1, last + 1)]
            d = math.fsum(map(operator.mul, moved, missing)) / math.fsum(map(operator.mul, moved, moved))
            off = math.fsum((e - d * r) ** 2 for e, r in zip(missing, moved, strict=True))
            if off < best:
                best, change, length = off, d, ramp
        goal = round(now.velocity + change)
        gap = abs(goal - now.velocity)
        return goal, max(round(gap / length), 1 if gap else 0)

    def _wanted(self, tick: int) -> float:
        return self.track.at(self.clock.end_ns(tick))

    def _rest_point(self, tick: int) -> int | None:
        """The point to stop at if the plan rests from ``tick`` on and the command is near enough."""
        time_ns = int(self.clock.end_ns(tick))
        wanted = self.track.at(time_ns)
        if self.track.leaves_ns(time_ns, wanted, STILL_COUNTS, time_ns + STILL_NS) is not None:
            return None
        wanted = self.track.at(time_ns + STILL_NS)  # the last steps of the plan may round to another count
        now = self.profiler.after(tick - self.tick)
        if abs(now.position / ONE - wanted) > REST_COUNTS or abs(now.velocity) > REST_VELOCITY * ONE:
            return None
        return nearest_step(wanted, 1.0)

    def _next_leaving(self, time_ns: int) -> int | None:
        """When the plan begins to go where it will leave the count that the command stands on."""
        at_ns = self.track.leaves_ns(time_ns, self.point, 0.5 + STILL_COUNTS, self.track.end_ns)
        if at_ns is None:
            return None
        first_ns = max(at_ns - BEGINS_NS, time_ns)
        while at_ns > first_ns and abs(self.track.rate(at_ns)) > BEGINS_COUNTS_S:
            at_ns -= BEGINS_STEP_NS
        return at_ns
