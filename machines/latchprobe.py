"""Measures what the PIC-STEP data sheet leaves open about its step timer, on a real module or on the twin.

X-61: when a timer count that is loaded while the motor moves takes effect. X-62: when the first step comes after the
motion was begun. Both are seen by reading the position again and again during runs of two to six slow steps: periods of
tens of milliseconds, so that even an adapter that adds 16 ms to an answer cannot blur one reading into the other.

    count 100 ms         count 20 ms loaded here
    |--------------------v------------|----|----|----|      takes effect at the roll-over
                         |----|----|----|----|              takes effect at once

A reading is believed only if every trial fits it and most trials exclude the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Literal

from machines.commission import Asker, UndecidedError
from machines.schema import CountLatch
from machines.staircase import (
    READINGS,
    Reading,
    Sighting,
    Trial,
    Window,
    executed,
    fits,
    predicted,
    received,
    step_windows,
)
from nmc.budget import BusTiming
from nmc.chips import picstep
from nmc.chips.common import LOAD_TRAJECTORY, READ_STATUS, START_MOTION
from nmc.picstep import PicStep
from nmc.program import Evidence, Exchange
from planner.quantize import count_of_period, nearest_speed, period_of_count_ns

FirstStep = Literal["period", "immediate", "unknown"]
SPEED_MODE = 1
"""The slowest timer clock: its periods are the longest, and no motor stalls at these rates."""
NS_PER_MS = 1_000_000
START_TRIALS = 64
LOAD_TRIALS = 24
TRIALS = START_TRIALS + LOAD_TRIALS
START_PERIOD_NS = 30 * NS_PER_MS
LOAD_PLANS: tuple[tuple[Trial, int], ...] = (
    (Trial(5, 100 * NS_PER_MS, 20 * NS_PER_MS), 25 * NS_PER_MS),  # faster, in the first period
    (Trial(3, 60 * NS_PER_MS, 100 * NS_PER_MS), 22 * NS_PER_MS),  # slower, in the first period
    (Trial(6, 100 * NS_PER_MS, 20 * NS_PER_MS), 135 * NS_PER_MS),  # faster, in the second
    (Trial(4, 50 * NS_PER_MS, 100 * NS_PER_MS), 72 * NS_PER_MS),  # slower, in the second
)
"""What is tried in turn: the run, and how long after its begin the new count is loaded."""
STAGGER_NS = 1_300_000
"""The load moves by so much from one round of trials to the next."""
STEPS_MOST = max(trial.steps for trial, _ in LOAD_PLANS)
LATE_NS = 250 * NS_PER_MS
"""A count-only load is not sent any more after this time: the run must surely not have ended."""
SHARE_DECIDED = 0.75
CRYSTAL = 100e-6
"""What a crystal does to a period is taken off the start delay as an uncertainty."""


@dataclass(frozen=True, slots=True)
class Seen:
    """One trial as it was seen. start, load: when the commands were received."""

    trial: Trial
    start: Window
    start_executed: Window
    load: Window | None
    steps: tuple[Window, ...]
    by_group: bool

    def fitting(self) -> frozenset[Reading]:
        """The readings that this trial allows; all of them where it cannot tell."""
        allowed = set()
        for reading in READINGS:
            wanted = predicted(reading, self.trial, self.start_executed, self.load)
            if wanted is None or fits(self.steps, wanted):
                allowed.add(reading)
        return frozenset(allowed)


@dataclass(frozen=True, slots=True)
class LatchFinding:
    """What was found out about one module. Counts are trials.

    delay_ms, delay_error_ms: mean time from the last byte of a start to its execution, and its standard error;
    delay_least_ms: at least one start surely took this long.
    """

    count_latch: CountLatch
    first_step: FirstStep
    load_trials: int
    only_rollover: int
    only_immediate: int
    neither: int
    start_trials: int
    only_period: int
    only_at_once: int
    delay_ms: float
    delay_error_ms: float
    delay_least_ms: float

    @property
    def decided(self) -> bool:
        """Both questions have an answer."""
        return self.count_latch != "unknown" and self.first_step != "unknown"


class LatchProbe:
    """Trials on one axis, there and back, so that it ends where it began."""

    def __init__(self, chip: PicStep, timing: BusTiming, asker: Asker) -> None:
        self.chip = chip
        self.timing = timing
        self.asker = asker
        self._position = 0
        self._reverse = False

    def measure(self, progress: Callable[[], None] = lambda: None) -> LatchFinding:
        """All ``TRIALS``, each told to ``progress``. Raises UndecidedError.

        The chip must be in speed mode 1x, at rest, its amplifier on.
        """
        self._position = self.chip.position()
        starts: list[Seen] = []
        for number in range(START_TRIALS):
            starts.append(self._run(Trial(2, START_PERIOD_NS), 0, number % 4 >= 2))
            progress()
        loads: list[Seen] = []
        for number in range(LOAD_TRIALS):
            trial, after_ns = LOAD_PLANS[number // 2 % len(LOAD_PLANS)]
            after_ns += STAGGER_NS * (number // (2 * len(LOAD_PLANS)))
            loads.append(self._run(trial, after_ns, number // 2 % 2 == 1))
            progress()
        return judge(starts, loads)

    def _run(self, trial: Trial, load_after_ns: int, by_start: bool) -> Seen:
        """One run; the next one goes back."""
        old_ns, new_ns = _exact(trial.old_ns), _exact(trial.new_ns)
        chip, asker = self.chip, self.asker
        chip.stop_motor("abruptly")
        begin = self._position
        goal = begin + (-trial.steps if self._reverse else trial.steps)
        started = self._begin(goal, old_ns, by_start)
        sightings = [Sighting(received(self.timing, started), 0, True)]
        load: Window | None = None
        if new_ns:
            at_ns = started.sent_ns + load_after_ns
            while asker.now_ns < at_ns - 2 * NS_PER_MS:
                sightings.append(self._look(begin))
            load = executed(self.timing, self._change(new_ns, at_ns, started))
        end_ns = asker.now_ns + trial.steps * max(old_ns, new_ns) + 400 * NS_PER_MS
        while sightings[-1].moving:
            sightings.append(self._look(begin))
            if asker.now_ns > end_ns:
                raise UndecidedError(f"the motor still moves, {sightings[-1].steps} steps after its start")
        if sightings[-1].steps != trial.steps:
            raise UndecidedError(
                f"the motor stopped after {sightings[-1].steps} of {trial.steps} steps: is it at a limit switch?"
            )
        self._position = goal
        self._reverse = not self._reverse
        exact = Trial(trial.steps, old_ns, new_ns)
        steps = tuple(step_windows(sightings))
        return Seen(exact, received(self.timing, started), executed(self.timing, started), load, steps, by_start)

    def _begin(self, goal: int, period_ns: int, by_start: bool) -> Evidence:
        """Stop position and count, begun by the load itself or by a Start Motion of its own."""
        control = picstep.LOAD_POSITION | picstep.LOAD_COUNT | (picstep.LOAD_REVERSE if self._reverse else 0)
        control |= 0 if by_start else picstep.LOAD_START_NOW
        data = bytes((control,)) + goal.to_bytes(4, "little", signed=True) + _count(period_ns)
        loaded = self.asker.exchange(Exchange(self.chip.address, LOAD_TRAJECTORY, data))
        return self.asker.exchange(Exchange(self.chip.address, START_MOTION)) if by_start else loaded

    def _change(self, period_ns: int, at_ns: int, started: Evidence) -> Evidence:
        """A count-only load at ``at_ns``."""
        control = picstep.LOAD_COUNT | picstep.LOAD_START_NOW | (picstep.LOAD_REVERSE if self._reverse else 0)
        data = bytes((control,)) + _count(period_ns)
        last_ns = started.sent_ns + LATE_NS
        exchange = Exchange(self.chip.address, LOAD_TRAJECTORY, data, send_at_ns=at_ns, not_after_ns=last_ns)
        evidence = self.asker.exchange(exchange)
        if not evidence.sent:
            raise UndecidedError("this computer was held up: a load left too late to be safe; try again")
        return evidence

    def _look(self, begin: int) -> Sighting:
        """Read the position."""
        item = bytes([picstep.ITEM_POSITION])
        evidence = self.asker.exchange(Exchange(self.chip.address, READ_STATUS, item, reply_extra=4))
        steps = int.from_bytes(evidence.extra, "little", signed=True) - begin
        status = evidence.status or 0
        made = -steps if self._reverse else steps
        return Sighting(received(self.timing, evidence), made, bool(status & picstep.STATUS_MOVING))


def judge(starts: Sequence[Seen], loads: Sequence[Seen]) -> LatchFinding:
    """What the trials say, taken together."""
    first, only_period, only_at_once = _first_step(starts)
    allowed = [{reading.latch for reading in seen.fitting() if first in ("unknown", reading.first)} for seen in loads]
    rollover = sum(latches == {"rollover"} for latches in allowed)
    immediate = sum(latches == {"immediate"} for latches in allowed)
    neither = sum(not latches for latches in allowed)
    enough = SHARE_DECIDED * len(loads)
    latch: CountLatch = "unknown"
    if not neither and not (rollover and immediate):
        latch = "rollover" if rollover >= enough else "immediate" if immediate >= enough else "unknown"
    mean, error, least = _delays(starts, first)
    return LatchFinding(
        count_latch=latch,
        first_step=first,
        load_trials=len(loads),
        only_rollover=rollover,
        only_immediate=immediate,
        neither=neither,
        start_trials=len(starts),
        only_period=only_period,
        only_at_once=only_at_once,
        delay_ms=mean,
        delay_error_ms=error,
        delay_least_ms=least,
    )


def _first_step(starts: Sequence[Seen]) -> tuple[FirstStep, int, int]:
    allowed = [{reading.first for reading in seen.fitting()} for seen in starts]
    period = sum(firsts == {"period"} for firsts in allowed)
    at_once = sum(firsts == {"immediate"} for firsts in allowed)
    enough = SHARE_DECIDED * len(starts)
    if any(not firsts for firsts in allowed) or (period and at_once):
        return "unknown", period, at_once
    return ("period" if period >= enough else "immediate" if at_once >= enough else "unknown"), period, at_once


def _delays(starts: Sequence[Seen], first: FirstStep) -> tuple[float, float, float]:
    """Mean delay of execution, its standard error, and what was surely reached, ms.

    The windows of the start and of the step are as wide as host and chip have made them by chance, in the same way on
    both, so the differences of their middles spread around the true delay. Every trial counts by the width of its own.
    A first step that comes at once is over before the first look at it: then the delay is known to be below that only.
    """
    if first == "unknown":
        return 0.0, 0.0, 0.0
    if first == "immediate":
        most = max(min(seen.steps[0].last_ns - seen.start.first_ns for seen in starts), 0.0) / NS_PER_MS
        return most / 2, most / sqrt(12.0), 0.0
    wait_ns = [seen.trial.old_ns for seen in starts]
    delays = [seen.steps[0].middle_ns - seen.start.middle_ns - wait for seen, wait in zip(starts, wait_ns, strict=True)]
    widths = [_width(seen.start) + _width(seen.steps[0]) for seen in starts]
    weights = [1.0 / (width * width) for width in widths]
    mean = sum(w * d for w, d in zip(weights, delays, strict=True)) / sum(weights)
    spread = sum(w * (d - mean) ** 2 for w, d in zip(weights, delays, strict=True)) / sum(weights)
    effective = sum(weights) ** 2 / sum(w * w for w in weights)
    surely = max(
        seen.steps[0].first_ns - seen.start.last_ns - wait * (1 + CRYSTAL)
        for seen, wait in zip(starts, wait_ns, strict=True)
    )
    error = sqrt(spread / max(effective - 1, 1))
    return mean / NS_PER_MS, error / NS_PER_MS, max(surely, 0.0) / NS_PER_MS


def _width(window: Window) -> float:
    return max(window.last_ns - window.first_ns, 50_000)


def _count(period_ns: int) -> bytes:
    return count_of_period(period_ns, SPEED_MODE).to_bytes(2, "little") + bytes((nearest_speed(period_ns, SPEED_MODE),))


def _exact(period_ns: int) -> int:
    """The period that the nearest timer count gives."""
    return period_of_count_ns(count_of_period(period_ns, SPEED_MODE), SPEED_MODE) if period_ns else 0
