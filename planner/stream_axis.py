"""One stepper axis while it is streamed: where its chip is believed to be, and which count comes next.

An axis rests at a counter position or moves along a leg. While it moves, its twin says which step is due next and
when; the next count is chosen deadbeat: the period that puts the step due at the end of the coming slice on its
planned instant. What rounding to timer ticks leaves over stays in the twin and is corrected by the next count.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from nmc.budget import BusTiming, Window
from nmc.twin import StepTimerTwin
from planner.motors import StepMotor
from planner.quantize import NS_PER_S, count_of_period, nearest_speed, period_of_count_ns, period_range_ns
from planner.steptrain import SHORT_CHUNK_S, Leg, StepTrain, Train, longest_gap_s
from planner.types import Trajectory

LOAD_TRAJECTORY = 0x4
COUNT_BYTES = 4
LOAD_POSITION, LOAD_TIMER_COUNT, REVERSE, START_NOW = 0x01, 0x08, 0x10, 0x80
"""Control byte of Load Trajectory (PIC-STEP data sheet, section 5.1)."""
MOVING = 0x01
"""Status bit 0 (section 5.2)."""
SAFETY_NS = 100_000
"""A count-only load is sent only if the fastest possible chip still moves this long after it."""
CATCH_UP = 1.5
"""A late axis steps at most this much faster than the plan does around there."""
PPB = 1_000_000_000
OVERSLEPT_NS = 4_000_000
"""An axis that would step this much after its new plan halts instead: Stop Motor, read and start take about as long."""
SLOW_PERIOD_NS = 2_500_000
"""Steps further apart than this are slow."""
NEAR = 2
"""Which roll-over takes a count is in doubt if the nominal one is within this many times the doubt of its execution."""
BETTER_STEPS = 0.3
"""What another period must mend more than the one that is right for the nominal chip."""


@dataclass(frozen=True, slots=True)
class Load:
    """A load that was sent and may not have been started yet. ``leg``: the one it begins, None: a count only."""

    period_ns: int
    leg: Leg | None


class StepAxis:
    """State of one axis of a stream. All instants are link time in ns."""

    def __init__(self, train: Train, timing: BusTiming, start_ns: int) -> None:
        self.train: Train = train
        self.trajectory = train.trajectory
        self.alive = train.alive
        self.motor: StepMotor = train.motor
        self.timing = timing
        self.start_ns = start_ns
        self.twin = StepTimerTwin(self.motor.crystal_ppm, self.motor.first_at_once)
        self._chip_ppb = PPB + self.motor.crystal_fast_ppb
        self.period_min_ns, self.period_max_ns = period_range_ns(self.motor.speed_mode)
        self.position_steps = train.start_steps
        self.leg: Leg | None = None
        self.last_direction = 0
        self.stop_motor_sent = True
        self.in_stream = False
        self.halts = False
        self.asked_ns = 0
        self.looked_ns = 0
        self.doubt_steps = 0.0
        self._lone: tuple[Leg, int, int] | None = None
        self._asked: tuple[int, int, int, int] | None = None
        self._chosen = (0, 0.0)
        self._last_ns = 0

    # --- what the axis is doing -----------------------------------------------------------------------------------

    @property
    def moving(self) -> bool:
        """A leg has been started and is not yet known to be over."""
        return self.leg is not None

    def surely_moving_at(self, latest_ns: int) -> bool:
        """Even the fastest chip has not arrived by ``latest_ns`` plus the safety margin."""
        return self.leg is not None and self.twin.surely_moving_until_ns() > latest_ns + SAFETY_NS

    def settle(self, now_ns: int) -> None:
        """Close the leg if even the slowest chip has made its last step; of legs to come, what is overdue is one."""
        if self.leg is not None and self.twin.surely_stopped_from_ns() < now_ns:
            self.close(now_ns)
        if self.leg is None:
            self.train.join(now_ns - self.start_ns)

    def close(self, now_ns: int) -> None:
        """The leg is over: the slowest chip has arrived, or the moving bit has been seen clear.

        An axis that should have halted before has run past what was wanted: what is left begins where it stands.
        """
        assert self.leg is not None
        self.position_steps = self.leg.stop_steps
        self.last_direction = self.leg.direction
        self._last_ns = self.leg.instants_ns[-1]
        self.leg = None
        self.doubt_steps = 0.0
        if self.halts:
            self.halts = False
            self._last_ns = max(now_ns - self.start_ns, 0)
            self.train = self.cut(self.trajectory, self._last_ns, self.position_steps)

    def stood(self) -> tuple[int, int]:
        """Of an axis at rest: since when, in ns of the plan, and on which step."""
        return max(self._last_ns, 0), self.position_steps

    def likely_stopped_at(self, now_ns: int) -> bool:
        """The nominal chip has arrived, though a slower one might not have."""
        return self.leg is not None and self.twin.nominal.arrival_ns() < now_ns

    def next_leg(self) -> Leg | None:
        """The leg that this axis begins next."""
        return self.train.peek()

    def first_step_ns(self) -> int | None:
        """Planned instant of the next leg's first step."""
        leg = self.next_leg()
        return None if leg is None else leg.instants_ns[0] + self.start_ns

    def turns_before(self, at_ns: int) -> bool:
        """Its present leg is over by then, most likely, and the next one is due."""
        first = self.first_step_ns()
        return first is not None and first < at_ns and (self.leg is None or self.likely_stopped_at(at_ns))

    def needs_stop_motor(self) -> bool:
        """A reversal asks for Stop Motor first (PIC-STEP data sheet, section 4.1, note)."""
        leg = self.next_leg()
        return leg is not None and not self.stop_motor_sent and leg.direction != self.last_direction

    # --- choosing counts -------------------------------------------------------------------------------------------

    def count_load(self, execute_ns: int, target_ns: int, start_now: bool) -> tuple[bytes, Load]:
        """Count-only load of the running leg, executed about ``execute_ns``, right at about ``target_ns``."""
        period_ns = self._aim(execute_ns, target_ns)
        return self._encode(period_ns, None, self.leg_direction(), start_now)

    def best_load(self, execute_ns: int, horizon_ns: int, unsure_ns: int) -> tuple[bytes, Load]:
        """Count-only load, started at once, whose worth ``urgency_steps`` tells."""
        period_ns, _ = self._choose(execute_ns, horizon_ns, unsure_ns)
        return self._encode(period_ns, None, self.leg_direction(), start_now=True)

    def leg_load(self, execute_ns: int, target_ns: int, start_now: bool) -> tuple[bytes, Load]:
        """Stop position and first count of the next leg, started from rest about ``execute_ns``."""
        leg = self.next_leg()
        assert leg is not None
        times = leg.instants_ns
        last = min(bisect_left(times, target_ns - self.start_ns), len(times) - 1)
        period_ns = (times[last] + self.start_ns - execute_ns) // (last + 1)
        gaps = leg.gaps_ns[: last + 1]
        period_ns = max(period_ns, int(min(gaps) / CATCH_UP) if gaps else self.period_min_ns)
        return self._encode(period_ns, leg, leg.direction, start_now)

    def piece_load(self, period_ns: int) -> tuple[bytes, Load]:
        """Stop position and count of the next leg, to be run at one rate from the next group Start on."""
        leg = self.next_leg()
        assert leg is not None
        return self._encode(period_ns, leg, leg.direction, start_now=False)

    def lone_start_ns(self, ahead_ns: int) -> int:
        """Instant at which the next leg must start: its first step and the one ``ahead_ns`` later are on time."""
        leg = self.next_leg()
        assert leg is not None
        if self._lone is not None and self._lone[0] is leg and self._lone[1] == ahead_ns:
            return self._lone[2]
        times = leg.instants_ns
        last = min(max(bisect_left(times, times[0] + ahead_ns), 1), len(times) - 1)
        period_ns = (times[last] - times[0]) // last if last else self.period_max_ns // 2
        period_ns = min(max(period_ns, self.period_min_ns), self.period_max_ns)
        self._lone = (leg, ahead_ns, times[0] + self.start_ns - period_ns)
        return self._lone[2]

    def leg_direction(self) -> int:
        """Direction of the running leg."""
        assert self.leg is not None
        return self.leg.direction

    def arrives_early_ns(self) -> int:
        """How long before its planned instant the last step would come if the present count stayed."""
        assert self.leg is not None
        return self.leg.instants_ns[-1] + self.start_ns - self.twin.nominal.arrival_ns()

    def aim_error_steps(self, execute_ns: int, target_ns: int) -> float:
        """How many steps off the plan the axis would be at ``target_ns`` without a new count at ``execute_ns``."""
        wanted = self._aim(execute_ns, target_ns)
        next_ns, left = self.twin.nominal.ahead(execute_ns)
        span_ns = max(target_ns - next_ns, min(self.twin.nominal.period_ns, wanted))
        return abs(1.0 / max(self.twin.nominal.period_ns, 1) - 1.0 / max(wanted, 1)) * span_ns if left > 1 else 0.0

    def urgency_steps(self, execute_ns: int, horizon_ns: int, unsure_ns: int) -> float:
        """What a new count at ``execute_ns`` would mend, in steps; 0 while the next roll-over can wait for a later one.

        It would be executed within ``unsure_ns`` of that. Judged is every chip that this one may be: those that roll
        over in that time take the count one period sooner or later than the others, so such instants are avoided,
        above all where a long period is to be followed by a short.
        """
        timer = self.twin.nominal
        next_ns, left = timer.ahead(execute_ns)
        if left <= 1 or next_ns - execute_ns > horizon_ns:
            return 0.0
        return self._choose(execute_ns, horizon_ns, unsure_ns)[1]

    def _choose(self, execute_ns: int, horizon_ns: int, unsure_ns: int) -> tuple[int, float]:
        """The period that a count at ``execute_ns`` should bring, and the steps that it would mend.

        Whoever sends a load has asked before what it is worth: that answer is kept until something is learnt or sent.
        """
        asked = (self.twin.revision, execute_ns, horizon_ns, unsure_ns)
        if self._asked != asked:
            self._chosen = self._best_period(execute_ns, horizon_ns, unsure_ns)
            self._asked = asked
        return self._chosen

    def _best_period(self, execute_ns: int, horizon_ns: int, unsure_ns: int) -> tuple[int, float]:
        """The same, reckoned anew.

        Right for the nominal chip, most often. Where it is in doubt which roll-over takes the count, what would be
        right if it were the other one is tried as well, and what lies between: the possible chips decide. There is no
        roll-over before a leg's first; an axis that halts needs its longest period, whatever takes it.
        """
        timer, mends = self.twin.nominal, self.twin.belief.mends_steps
        next_ns, left = timer.ahead(execute_ns)
        end_ns = execute_ns + horizon_ns
        period_ns = max(self._aim_from(next_ns, left, end_ns), 1)
        target_ns = max(end_ns, next_ns + min(timer.period_ns, period_ns))
        wanted = self._planned_to_go(target_ns)
        most = mends(execute_ns, 2 * unsure_ns, target_ns, wanted, period_ns)
        apart_ns = abs(timer.period_ns - period_ns)
        if self.halts or apart_ns < BETTER_STEPS * min(timer.period_ns, period_ns):
            return period_ns, most  # either side is as good
        doubt_ns, others = NEAR * unsure_ns, []
        if next_ns - execute_ns < doubt_ns and left > 2:
            others.append(self._aim_from(next_ns + timer.period_ns, left - 1, end_ns))
        if next_ns - execute_ns > timer.period_ns - doubt_ns and left < self.twin.belief.steps:
            others.append(self._aim_from(next_ns - timer.period_ns, left + 1, end_ns))
        for other_ns in others:
            for exact_ns in (other_ns, 2 * period_ns * other_ns // (period_ns + other_ns)):
                tried_ns = max(exact_ns, 1)
                value = mends(execute_ns, 2 * unsure_ns, target_ns, wanted, tried_ns)
                if value > most + BETTER_STEPS:
                    most, period_ns = value, tried_ns
        return period_ns, most

    def _planned_to_go(self, at_ns: int) -> float:
        """Steps to the stop position that the plan has left, with the part of the gap that is not over."""
        leg = self.leg
        assert leg is not None
        instants = leg.instants_ns
        beyond = abs(leg.stop_steps - leg.start_steps) - len(instants)
        made = bisect_left(instants, at_ns - self.start_ns)
        to_go = float(beyond + len(instants) - made)
        if 0 < made < len(instants):
            to_go -= (at_ns - self.start_ns - instants[made - 1]) / max(instants[made] - instants[made - 1], 1)
        return to_go

    @property
    def slow(self) -> bool:
        """Its steps are further apart than a few loads: it is led better alone than by the group's slices."""
        return self.twin.nominal.period_ns > SLOW_PERIOD_NS

    def _aim(self, execute_ns: int, target_ns: int) -> int:
        """Period after the next roll-over that puts the step due at ``target_ns`` on its planned instant.

        A late axis catches up only a little faster than the plan itself goes there, and an early one waits only a
        little longer: a period that stays in force for one roll-over more than foreseen must not cost more than a few
        steps, and there may be no safe moment left to change it before the leg ends.
        """
        return self._aim_from(*self.twin.nominal.ahead(execute_ns), target_ns)

    def _aim_from(self, next_ns: int, left: int, target_ns: int) -> int:
        """The same, if the roll-over that takes the count is at ``next_ns`` with ``left`` steps to go before it."""
        leg = self.leg
        assert leg is not None
        due = abs(leg.stop_steps - leg.start_steps) - left
        wanted = len(leg.instants_ns)
        if due >= wanted - 1:
            return self.period_max_ns if self.halts else self.twin.nominal.period_ns
        aim = min(bisect_left(leg.instants_ns, target_ns - self.start_ns), len(leg.instants_ns) - 1)
        aim = max(aim, due + 1)
        period_ns = (leg.instants_ns[aim] + self.start_ns - next_ns) // (aim - due)
        even_ns = (leg.instants_ns[-1] + self.start_ns - next_ns) // (wanted - 1 - due)
        near_ns = leg.gaps_ns[max(due - 1, 0)]
        if int(near_ns / CATCH_UP) <= period_ns <= max(even_ns, int(near_ns * CATCH_UP)):
            return period_ns  # most often one gap says already that neither bound is reached
        gaps = leg.gaps_ns[max(due - 1, 0) : aim + 1]
        period_ns = min(period_ns, max(even_ns, int(max(gaps) * CATCH_UP)))
        return max(period_ns, int(min(gaps) / CATCH_UP))

    def _encode(self, period_ns: int, leg: Leg | None, direction: int, start_now: bool) -> tuple[bytes, Load]:
        mode = self.motor.speed_mode
        count = count_of_period(max(period_ns, self.period_min_ns) * self._chip_ppb // PPB, mode)
        period_ns = period_of_count_ns(count, mode) * PPB // self._chip_ppb  # by the host's clock
        control = LOAD_TIMER_COUNT | (REVERSE if direction < 0 else 0) | (START_NOW if start_now else 0)
        position = b""
        if leg is not None:
            control |= LOAD_POSITION
            position = leg.stop_steps.to_bytes(4, "little", signed=True)
        tail = count.to_bytes(2, "little") + bytes((nearest_speed(period_ns, mode),))
        return bytes((control,)) + position + tail, Load(period_ns, leg)

    # --- new times for the same path -------------------------------------------------------------------------------

    def retime(self, trajectory: Trajectory, now_ns: int) -> None:
        """The trajectory has new times after what was sent: the steps to come get new instants.

        The stop position of a running leg stands in the chip. If the new times end before it (a hold), the axis
        *halts*: behind the last wanted step the longest count is loaded, and a Stop Motor ends the leg in that gap.
        """
        self.trajectory = trajectory
        self._asked = None
        leg = self.leg
        if leg is None:
            self.train = self.cut(trajectory, max(self._last_ns, 0), self.position_steps)
            return
        made = min(max(self.twin.done(now_ns), 1), len(leg.instants_ns))
        level = leg.start_steps + leg.direction * made
        self.train = self.cut(trajectory, leg.instants_ns[made - 1] + 1, level)
        instants = leg.instants_ns[:made]
        left = abs(leg.stop_steps - level)
        ahead = self.train.peek()
        if left and ahead is not None and ahead.direction == leg.direction and not self._overslept(ahead, now_ns):
            instants = instants + self.train.pop().instants_ns[:left]
            if len(ahead) > left:  # beyond the stop that the chip holds a new leg begins
                self.train = self.cut(trajectory, instants[-1] + 1, leg.stop_steps)
        times = np.array(instants, dtype=np.int64)
        self.leg = Leg(leg.direction, leg.start_steps, leg.stop_steps, times, instants, np.diff(times).tolist())
        self.halts = len(instants) < abs(leg.stop_steps - leg.start_steps)

    def cut(self, trajectory: Trajectory, from_ns: int, steps: int, together: int = 0) -> StepTrain:
        """What is left of a trajectory from an instant of the plan on; the machine moves meanwhile.

        together: as in ``longest_gap_s``. What was believed of the bus at the beginning counts at least.
        """
        gap_s = max(self.train.gap_s, longest_gap_s(self.motor, self.timing, together))
        from_s = from_ns / NS_PER_S
        return StepTrain(trajectory, self.motor, from_s, steps, SHORT_CHUNK_S, alive=self.alive, gap_s=gap_s)

    def _overslept(self, ahead: Leg, now_ns: int) -> bool:
        """The period that runs (from the gap of a hold, perhaps) ends much later than the next step is wanted.

        No count can shorten it; a Stop Motor can end it, and what is left begins anew.
        """
        soonest_ns = now_ns + self.timing.worst_ns(COUNT_BYTES)
        timer = self.twin.nominal
        next_ns, left = timer.ahead(soonest_ns)
        wanted = min(timer.left - left, len(ahead.instants_ns) - 1)
        if timer.period_ns - max(ahead.gaps_ns[:2], default=timer.period_ns) > OVERSLEPT_NS:
            return True  # it may be in force already: a roll-over is never known to the microsecond
        return next_ns - max(ahead.instants_ns[wanted] + self.start_ns, soonest_ns) > OVERSLEPT_NS

    @property
    def beyond(self) -> int:
        """Steps of the running leg that are not wanted any more: it halts before them."""
        leg = self.leg
        assert leg is not None
        return abs(leg.stop_steps - leg.start_steps) - len(leg.instants_ns)

    def halt_ns(self) -> int:
        """Of an axis that halts: when the Stop Motor into its gap may be executed.

        That is when the last wanted step has most likely been made. Certainty may be a longest period away (which
        roll-over took the last count?) and is not needed: the counter is read, and a step that is missing then comes
        first in what is left. The same holds where the longest count has come into force a step too early.
        """
        leg = self.leg
        assert leg is not None
        timer, slow = self.twin.nominal, self.twin.slow
        likely_ns = timer.next_ns + (timer.left - self.beyond - 1) * timer.period_ns
        surely_ns = slow.next_ns + (slow.left - self.beyond - 1) * slow.period_ns
        unsure_ns = self.timing.jitter_max_ns + self.timing.start_delay_max_ns
        if timer.period_ns > self.period_max_ns // 2 and likely_ns > leg.instants_ns[-1] + self.start_ns + unsure_ns:
            return timer.next_ns - timer.period_ns + unsure_ns
        return min(surely_ns, likely_ns + unsure_ns)

    def halted(self, position_steps: int, now_ns: int) -> None:
        """A Stop Motor has been executed in the gap and the counter read: what is left begins from here."""
        assert self.leg is not None
        self.last_direction = self.leg.direction
        self.leg = None
        self.halts = False
        self.stop_motor_sent = True
        self.position_steps = position_steps
        self._last_ns = max(now_ns - self.start_ns, 0)
        self.train = self.cut(self.trajectory, self._last_ns, position_steps)

    # --- what has happened -----------------------------------------------------------------------------------------

    def executed(self, load: Load, window: Window) -> None:
        """``load`` was started within the given window."""
        if load.leg is None:
            self.twin.load(window, load.period_ns)
            self.doubt_steps = self.twin.belief.deviation_steps(window.latest_ns)
            return
        self.leg = self.train.pop()
        assert self.leg is load.leg
        self.stop_motor_sent = False
        self.doubt_steps = 0.0
        self.twin.start(window, load.period_ns, len(self.leg))
        self.halts = False
