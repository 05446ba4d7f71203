"""The step timer and the profile generator of a PIC-STEP, in closed form (data sheet sections 4.1 to 4.3).

Between two things that happen (a load, a change of profile speed, a switch edge, the goal) the pulses are equally
spaced, so advancing the axis by any time costs one step of arithmetic for each of them, never one for each pulse. All
times here are base ticks of the chip's own clock (200 ns at 20 MHz, the timer clock of speed mode 8x).

Picture of a constant rate: the timer rolls over at ``next_roll``; a pulse is made there and the timer is reloaded with
the count that is loaded then, so a new count acts from the next roll-over on (X-61).
"""

from __future__ import annotations

from collections.abc import Callable

from sim.registers import WRAP, wrap32
from sim.stepmodes import Mode
from sim.trace import StepRuns

BASE_TICK_NS = 200
QUARTER_MS_TICKS = 1250  # unit of the acceleration time
FOREVER = 1 << 62


def speed_period(speed: int) -> int:
    """Timer clocks of one step at an integer profile speed: rate = speed x 25 x mode, clock = 625 kHz x mode (X-67)."""
    return (50000 + speed) // (2 * speed)  # 25000 / speed to the nearest integer


class StepTimer:
    """Position, pulses and profile of one axis. ``on_edge`` is called when the mechanics pass a switch edge."""

    def __init__(self, runs: StepRuns, on_edge: Callable[[], None]) -> None:
        self.runs = runs
        self.on_edge = on_edge
        self.tick = 0
        self.position = 0
        self.mechanical = 0
        self.driven = False  # AMP_EN: whether pulses move the mechanics
        self.edge_above = FOREVER  # the mechanics notice something when reaching these
        self.edge_below = -FOREVER
        self.stopped_at = -FOREVER
        self.clear()

    def clear(self) -> None:
        """At rest, nothing loaded."""
        self.mode = Mode.STOPPED
        self.direction = 1
        self.prescale = 1  # base ticks per timer clock
        self.next_roll = FOREVER
        self.active_period = 0  # base ticks: in the timer now
        self.reload_period = 0  # base ticks: at the next roll-over
        self.stop_position: int | None = None
        self.reached_stop = False
        self.speed = 0
        self.goal_speed = 0
        self.least_speed = 1
        self.accel_ticks = QUARTER_MS_TICKS
        self.stage_begin = 0
        self.stage_end = FOREVER  # when the profile speed changes next
        self.braking = False  # trapezoid: on the way down
        self.ending = False  # smooth stop
        self.ramp_steps = 0  # trapezoid: pulses spent on the way up

    # -- commands ----------------------------------------------------------------------------------------------------

    def run_count(self, mode: Mode, period: int, direction: int, stop: int | None, at_once: bool) -> None:
        """Unprofiled motion with ``period`` base ticks, from rest or from any running mode."""
        from_rest = self.mode == Mode.STOPPED
        self.mode = mode
        self.stop_position = stop
        self.reload_period = period
        self.stage_end = FOREVER
        self.braking = self.ending = False
        if from_rest:
            self._leave(period, direction, at_once)
        elif at_once:
            self.active_period = period
            self.next_roll = self.tick + period

    def run_profile(
        self, mode: Mode, speed: int, accel_ticks: int, direction: int, goal: int | None, now: bool
    ) -> None:
        """Profiled motion towards ``speed`` (>= 1); from rest it begins at the least profile speed (X-68)."""
        from_rest = self.mode == Mode.STOPPED
        self.mode = mode
        self.stop_position = goal
        self.goal_speed = max(speed, self.least_speed)
        self.accel_ticks = accel_ticks
        self.braking = self.ending = False
        if from_rest:
            self.speed = self.least_speed
            self.ramp_steps = 0
            self.stage_end = FOREVER
            self.reload_period = speed_period(self.speed) * self.prescale
            self._leave(self.reload_period, direction, now)
        self._schedule_stage()

    def _leave(self, period: int, direction: int, at_once: bool) -> None:
        self.direction = direction
        self.active_period = period
        self.next_roll = self.tick + (1 if at_once else period)
        self.reached_stop = False

    def _schedule_stage(self) -> None:
        if self.speed == self.goal_speed:
            self.stage_end = FOREVER
        elif self.stage_end == FOREVER:
            self.stage_begin = self.tick
            self.stage_end = self.tick + self.accel_ticks

    def begin_smooth_stop(self, ramp_from: int) -> None:
        """Goal speed 0; the motor halts when the least profile speed is reached (section 5.1, Stop Motor)."""
        if self.mode in (Mode.UNPROFILED, Mode.UNPROFILED_STOP):
            self.speed = ramp_from
            self.reload_period = speed_period(self.speed) * self.prescale
        self.mode = Mode.VELOCITY
        self.stop_position = None
        self.braking = False
        self.ending = True
        self.goal_speed = self.least_speed
        if self.speed <= self.least_speed:
            self.halt()
            return
        self.stage_end = FOREVER
        self._schedule_stage()

    def halt(self) -> None:
        """Stop abruptly at the present position."""
        if self.mode != Mode.STOPPED:
            self.mode = Mode.STOPPED
            self.stopped_at = self.tick
        self.next_roll = FOREVER
        self.stage_end = FOREVER
        self.braking = self.ending = False

    @property
    def at_speed(self) -> bool:
        """Status bit 4; set while a count is running (X-69)."""
        if self.mode in (Mode.UNPROFILED, Mode.UNPROFILED_STOP):
            return True
        return self.mode != Mode.STOPPED and not self.braking and not self.ending and self.speed == self.goal_speed

    # -- the passing of time -----------------------------------------------------------------------------------------

    def advance(self, tick: int) -> None:
        """Let everything up to and including ``tick`` happen."""
        while self.mode != Mode.STOPPED:
            bound = min(tick, self.stage_end)
            if self.next_roll <= bound and self._pulses(bound):
                continue
            if self.stage_end > tick:
                break
            self.tick = self.stage_end
            self._next_stage()
        self.tick = max(self.tick, tick)

    def _pulses(self, bound: int) -> bool:
        """Make the pulses up to ``bound`` or to the next thing that a pulse causes; True: something was caused."""
        period = self.reload_period
        count = (bound - self.next_roll) // period + 1
        cause = count + 1
        if self.stop_position is not None:
            cause = self._steps_to_cause()
        edge = FOREVER
        if self.driven:
            mechanical = self.mechanical
            edge = self.edge_above - mechanical if self.direction > 0 else mechanical - self.edge_below
        count = min(count, cause, edge)
        first = self.next_roll
        self.runs.add(first, period, count, self.direction)
        self.tick = first + (count - 1) * period
        self.next_roll = first + count * period
        self.active_period = period
        steps = count * self.direction
        self.position = wrap32(self.position + steps)
        if self.driven:
            self.mechanical += steps
        if self.mode == Mode.TRAP and not self.braking and self.stage_end != FOREVER:
            self.ramp_steps += count
        if count == edge:
            self.on_edge()
        if count == cause and self.mode != Mode.STOPPED:
            self._caused()
        return count in (cause, edge)

    def _remaining(self) -> int:
        """Pulses to the stop position in the present direction; in the other direction it is nearly 2^32 away."""
        assert self.stop_position is not None
        return (self.stop_position - self.position) * self.direction % WRAP or WRAP

    def _steps_to_cause(self) -> int:
        remaining = self._remaining()
        if self.mode != Mode.TRAP or self.braking:
            return remaining
        if self.stage_end == FOREVER:  # slewing: the way down takes as many pulses as the way up took
            return min(remaining, max(1, remaining - self.ramp_steps))
        return min(remaining, max(1, (remaining - self.ramp_steps + 1) // 2))

    def _caused(self) -> None:
        """The goal is reached, or the point from which the goal is reached by braking."""
        if self.position == self.stop_position:
            self.reached_stop = True
            self.halt()
        elif self.mode == Mode.TRAP and not self.braking:
            self.braking = True
            spent = self.tick - self.stage_begin if self.stage_end != FOREVER else 0
            self.goal_speed = self.least_speed
            self.stage_begin = self.tick
            # the mirror image of the way up: what was spent at this speed is spent again, then one speed less
            self.stage_end = self.tick + max(spent, 1) if self.speed > self.least_speed else FOREVER

    def _next_stage(self) -> None:
        """The profile speed changes by one (section 4.2)."""
        self.speed += 1 if self.goal_speed > self.speed else -1
        self.reload_period = speed_period(self.speed) * self.prescale
        self.stage_begin = self.tick
        if self.speed == self.goal_speed:
            self.stage_end = FOREVER
            if self.ending:
                self.halt()
        else:
            self.stage_end = self.tick + self.accel_ticks
