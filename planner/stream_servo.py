"""Lanes of PIC-SERVO axes: ``stop-here`` points and ``smooth`` velocity slices, one trajectory.

``stop-here``: each Stop Motor with Stop Here (PIC-SERVO data sheet, section 5.2) makes the command jump to a point,
taken from the plan in the middle of the time that it will stand. A silent host leaves the axis standing.

``smooth``: velocity mode, a goal velocity and an acceleration a turn. The profiler's arithmetic is known to the last
bit, so the host knows the command position at every tick and steers it back onto the plan:

    v
      |        ____v1        v1 = plan's velocity at the end of the turn + (what is missing there) / n ticks
      |   ___/               a  = |v1 - v0| / n: the ramp ends with the turn; a late turn goes on at v1
      | v0
      +----|----|----> tick
"""

from __future__ import annotations

import math

from nmc.budget import BusTiming
from nmc.program import Evidence, Exchange
from nmc.servo_twin import FRACTION_BITS, Profiler, TickClock
from planner.motors import ServoMotor
from planner.quantize import NS_PER_S, nearest_step
from planner.stream_axis import LOAD_TRAJECTORY
from planner.stream_base import AMP_ENABLE, NO_OPERATION, STOP_MOTOR, Said, StepSchedule, Stream
from planner.stream_lane import Turn
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
CORRECTION = 0.8
"""Share of a missing distance that the end velocity of a turn is raised by; below 4/3 the corrections die out."""
REST_COUNTS = 2.0
REST_VELOCITY = 0.4
"""A command this close to a resting plan, and this slow (counts a tick), is put onto it by Stop Here."""
STILL_COUNTS = 0.05
STILL_NS = 5_000_000
"""A plan that stays within ``STILL_COUNTS`` for this time rests."""
ONE = 1 << FRACTION_BITS


class ServoLane:
    """What both profiles share: the plan in counts, the servo clock, Stop Here."""

    def __init__(self, trajectory: Trajectory, motor: ServoMotor, schedule: StepSchedule, start_ns: int) -> None:
        self.motor = motor
        self.schedule = schedule
        start_ns -= motor.lead_ns  # the whole plan that much earlier: the shaft is then where the plan is
        self.timing: BusTiming = schedule.timing
        self.address = motor.address
        self.track = Track(trajectory, motor.axis, motor.counts_per_unit, start_ns)
        self.count_um = 1000.0 / abs(motor.counts_per_unit)
        self.clock = TickClock(motor.crystal_fast_ppb)
        self.point = nearest_step(self.track.at(start_ns), 1.0)

    def prelude(self) -> Stream:
        """Make the command position known and lock onto the servo clock, all at rest."""
        yield from self.stop_here(self.point, 0)
        for _ in range(LOCK_EXCHANGES):
            self.observe((yield Exchange(self.address, NO_OPERATION, bus=self.schedule.bus)))

    def stop_here(self, point: int, send_ns: int) -> Stream:
        """Put the command onto ``point`` (counts)."""
        data = bytes((AMP_ENABLE | STOP_HERE,)) + point.to_bytes(4, "little", signed=True)
        self.observe((yield Exchange(self.address, STOP_MOTOR, data, send_at_ns=send_ns, bus=self.schedule.bus)))
        self.point = point

    def observe(self, evidence: Evidence) -> int:
        """The number of the tick at whose end the exchange was executed and answered (section 4.1)."""
        return self.clock.observe(evidence.replied_ns - self.timing.reply_ns(len(evidence.extra)))

    def execution_tick(self, send_ns: int, data_bytes: int) -> int:
        """The tick at whose end a command sent at ``send_ns`` will most likely be executed."""
        complete_ns = send_ns + self.timing.command_ns(data_bytes) + self.timing.jitter_max_ns // 2
        return self.clock.next_after(complete_ns)

    def retime(self) -> None:
        """The trajectory has new times: look everything up again."""
        self.track.forget()

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


class StopHereLane(ServoLane):
    """Positions, each sampled for the instant at which it is executed."""

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
        """Distance of the next point from the one that stands."""
        return abs(self._next_point(turn) - self.point) * self.count_um

    def mend(self, turn: Turn) -> Stream:
        """Send the point."""
        yield from self.stop_here(self._next_point(turn), turn.send_ns)

    def _next_point(self, turn: Turn) -> int:
        tick = self.execution_tick(turn.send_ns, STOP_HERE_BYTES)
        return nearest_step(self.track.at(self.clock.end_ns(tick) + turn.horizon_ns / 2), 1.0)


class SmoothLane(ServoLane):
    """Velocity and acceleration a turn, Stop Here at rests and at the end."""

    def __init__(self, trajectory: Trajectory, motor: ServoMotor, schedule: StepSchedule, start_ns: int) -> None:
        super().__init__(trajectory, motor, schedule, start_ns)
        self.profiler = Profiler(self.point * ONE)
        self.tick = 0
        self.resting = True
        self._leaves_ns = self._next_leaving(self.track.start_ns)

    def retime(self) -> None:
        """A resting axis must look again when the plan leaves its place."""
        super().retime()
        if self.resting:
            self._leaves_ns = self._next_leaving(self.schedule.now_ns)

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
        return self._leaves_ns - self.timing.command_ns(VELOCITY_BYTES) - self.timing.jitter_max_ns // 2

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
        """Goal velocity and acceleration for the ticks from ``begin`` to ``end``."""
        ticks = end - begin
        now = self.profiler.after(begin - self.tick)
        end_ns = self.clock.end_ns(end)
        velocity = self.track.rate(end_ns) * self.clock.period_ns / NS_PER_S * ONE
        reached = now.position + ticks * now.velocity + (velocity - now.velocity) / ticks * (ticks * (ticks + 1) / 2)
        missing = self.track.at(end_ns) * ONE - reached
        goal = round(velocity + CORRECTION * missing / ticks)
        change = abs(goal - now.velocity)
        return goal, max(round(change / ticks), 1 if change else 0)

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
        return self.track.leaves_ns(time_ns, self.point, 0.5 + STILL_COUNTS, self.track.end_ns)
