"""Step trains: the instants at which each motor should step, cut into legs.

A leg is a monotone run without a long gap: what one stop position and a chain of timer counts can produce, or several
stop positions where all axes stand in between. Its end is the axis's next reversal or rest, known before its first step
leaves.

      position            leg 1: 4 steps up          leg 2: 2 down
        4 |        .-'''-.
        3 |      .'       '-._                        A single step up that is taken back at once (an apex which
        2 |    .'                                     overshoots by less than 0.4 step) is left out of both legs.
        1 |  .'
          +------------------------ t
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from nmc.budget import BusTiming
from planner.motors import StepMotor
from planner.quantize import I8, NS_PER_S, nearest_step, period_range_ns, step_crossings
from planner.types import F8, Coordinates, Trajectory, nobody_asks

SAMPLE_S = 1e-4
CHUNK_S = 2.0
GAP_SHARE = 0.9
GAP_MAX_S = 0.012
"""A gap longer than this, or than this share of the longest period, begins a new leg: slow steps are single moves
timed exactly, for a count that meets a long period at the wrong side of its roll-over puts the axis that period off."""
GAP_LOADS, GAP_EXCHANGES = 9.0, 4.8
"""On a bus of few baud, or with a host that hesitates, a gap may be so many loads of a leg on the wires, or exchanges
with one: single moves would leave the bus to nothing else."""
GAP_TOGETHER = 2.4
"""Where axes begin and stand together, so many exchanges of each: none may end a slice before the next is loaded."""
LEG_BYTES = 8
"""Data bytes of such a load (PIC-STEP data sheet, section 5.1)."""
COARSE, REST_STEPS = 5, 0.1
"""A resting axis is looked at every fifth sample: between two of them it cannot go so far and come back (a t^2 / 4: at
500 mm/s2 in half a millisecond 0.03 um)."""
APEX_OVERSHOOT_STEPS = 0.4
APEX_GAP_S = 0.02
NOISE_STEPS = 1e-6
SHORT_CHUNK_S = 0.3
"""Chunk of a train that is cut while the machine moves: the first steps are wanted at once."""
SETTLE_STEP_S = 1e-3
"""Steps that make up a difference to the plan are this far apart."""
KEPT = 8
"""Chunks of samples that wait for the axes that are not there yet: one that rests may be seconds ahead."""
_TAIL = 2 * round(APEX_GAP_S / SAMPLE_S)
"""Samples of the past that an apex across a chunk's border may need."""


@dataclass(frozen=True, slots=True, eq=False)
class Leg:
    """One monotone run: direction +1/-1, counter before and after, planned step instants i8[n] in ns of the plan.

    instants_ns, gaps_ns: the same and its differences as lists, for look-ups one by one while streaming.
    """

    direction: int
    start_steps: int
    stop_steps: int
    times_ns: I8
    instants_ns: list[int]
    gaps_ns: list[int]

    def __len__(self) -> int:
        return len(self.times_ns)


class Train(ABC):
    """Where an axis gets its legs from."""

    motor: StepMotor
    trajectory: Trajectory
    start_steps: int
    gap_s: float
    alive: Callable[[], None]

    @abstractmethod
    def peek(self) -> Leg | None:
        """The next leg, or None when the train is over."""

    @abstractmethod
    def pop(self) -> Leg:
        """Take the next leg."""

    @abstractmethod
    def join(self, before_ns: int) -> None:
        """Make one leg of the next and those behind it that go on its way and are due before ``before_ns``."""


def longest_gap_s(motor: StepMotor, timing: BusTiming | None = None, together: int = 0) -> float:
    """The longest gap within a leg of a motor; on a bus of this timing.

    together: how many axes begin their steps together, and wait for each other (profile ``exact``).
    """
    longest_s = GAP_SHARE * period_range_ns(motor.speed_mode)[1] / NS_PER_S
    if timing is None:
        return min(longest_s, GAP_MAX_S)
    wires_s = (timing.command_ns(LEG_BYTES) + timing.reply_ns(0)) / NS_PER_S
    exchange_s = timing.mean_exchange_ns(LEG_BYTES) / NS_PER_S
    gap_s = min(longest_s, max(GAP_MAX_S, GAP_LOADS * wires_s, GAP_EXCHANGES * exchange_s))
    return max(gap_s, together * GAP_TOGETHER * exchange_s)


class Samples:
    """Positions at the instants that the trains of a trajectory look at, taken once for all of them."""

    def __init__(self, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self._kept: dict[tuple[float, int], F8] = {}

    def q(self, t_s: F8) -> F8:
        """Positions f8[len(t), A]; of instants from the same one on, and as many, they are the same."""
        key = (float(t_s[0]), len(t_s))
        found = self._kept.get(key)
        if found is None:
            if len(self._kept) >= KEPT:
                del self._kept[next(iter(self._kept))]
            found = self.trajectory.q(t_s)
            self._kept[key] = found
        return found


class StepTrain(Train):
    """Legs of one motor, pulled from a trajectory chunk by chunk; memory holds one leg, what is overdue, and one chunk.

    from_s: where in the trajectory the train begins. start_steps: where the motor stands then, if that is not the step
    nearest to the plan; the difference is made up, or saved, on the way. chunk_s: how much is sampled at once.
    samples: of the same trajectory, shared by trains that begin and are cut alike. alive: called before each chunk.
    gap_s: a longer gap begins a new leg; 0: as on a fast bus.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        motor: StepMotor,
        from_s: float = 0.0,
        start_steps: int | None = None,
        chunk_s: float = CHUNK_S,
        samples: Samples | None = None,
        alive: Callable[[], None] = nobody_asks,
        gap_s: float = 0.0,
    ) -> None:
        self.motor = motor
        self.alive = alive
        self._sampled = samples
        self._single = trajectory if isinstance(trajectory, Coordinates) else None
        self.trajectory = trajectory
        self.from_s = from_s
        self.chunk_s = chunk_s
        self.column = trajectory.axes.index(motor.axis)
        self._level = nearest_step(float(trajectory.q(np.array([from_s]))[0, self.column]), motor.steps_per_unit)
        self.start_steps = self._level if start_steps is None else start_steps
        self.gap_s = gap_s or longest_gap_s(motor)
        self._legs = self._cut()
        self._ahead: deque[Leg] = deque()

    def peek(self) -> Leg | None:
        """The next leg, or None when the train is over."""
        if not self._ahead:
            leg = next(self._legs, None)
            if leg is None:
                return None
            self._ahead.append(leg)
        return self._ahead[0]

    def pop(self) -> Leg:
        """Take the next leg."""
        leg = self.peek()
        assert leg is not None
        self._ahead.popleft()
        return leg

    def join(self, before_ns: int) -> None:
        """Make one leg of the next and those behind it that go on its way and are due before ``before_ns``."""
        first = self.peek()
        if first is None or first.instants_ns[-1] >= before_ns:
            return
        joined: list[Leg] = []
        while (leg := self.peek()) is not None:
            if joined and (leg.direction != joined[0].direction or leg.instants_ns[0] >= before_ns):
                break
            joined.append(self.pop())
        self._ahead.appendleft(joined[0] if len(joined) == 1 else _joined(joined))

    def _steps(self) -> Iterator[tuple[F8, I8]]:
        """Chunks of (time, direction) of all steps, apex pairs removed; what may still pair is carried on."""
        times, directions = np.empty(0), np.empty(0, dtype=np.int64)
        seen_t, seen_p = np.empty(0), np.empty(0)
        owed = self._level - self.start_steps
        for t, p in self._samples():
            more, direction, _ = step_crossings(t, p)
            if owed:
                more, direction = _settled(owed, self.from_s, more, direction)
                owed = 0
            times = np.concatenate((times, more))
            directions = np.concatenate((directions, direction))
            seen_t, seen_p = np.concatenate((seen_t, t)), np.concatenate((seen_p, p))
            keep = _without_apexes(times, directions, seen_t, seen_p)
            seen_t, seen_p = seen_t[-_TAIL:], seen_p[-_TAIL:]
            times, directions = times[keep], directions[keep]
            settled = max(int(np.searchsorted(times, t[-1] - APEX_GAP_S)) - 1, 0)
            yield times[:settled], directions[:settled]
            times, directions = times[settled:], directions[settled:]
        yield times, directions

    def _samples(self) -> Iterator[tuple[F8, F8]]:
        duration_s = self.trajectory.duration_s
        total = max(int(np.ceil((duration_s - self.from_s) / SAMPLE_S)), 1)
        size = round(self.chunk_s / SAMPLE_S)
        for first in range(0, total, size):
            self.alive()
            t = np.minimum(self.from_s + np.arange(first, min(first + size, total) + 1) * SAMPLE_S, duration_s)
            few = np.append(t[:-1:COARSE], t[-1])
            p = self._q(few) * self.motor.steps_per_unit
            if np.floor(p.min() + 0.5 - REST_STEPS) == np.floor(p.max() + 0.5 + REST_STEPS):
                yield few, p  # no step lies in here
                continue
            yield t, self._q(t) * self.motor.steps_per_unit

    def _q(self, t_s: F8) -> F8:
        """Positions of the axis; what several trains look at comes for all their axes at once."""
        if self._sampled is not None:
            return self._sampled.q(t_s)[:, self.column]
        if self._single is not None:
            return self._single.coordinate(t_s, self.column)
        return self.trajectory.q(t_s)[:, self.column]

    def _cut(self) -> Iterator[Leg]:
        position = self.start_steps
        times, directions = np.empty(0), np.empty(0, dtype=np.int64)
        for more, direction in self._steps():
            times, directions = np.concatenate((times, more)), np.concatenate((directions, direction))
            if not len(times):
                continue
            breaks = np.flatnonzero((np.diff(directions) != 0) | (np.diff(times) > self.gap_s)) + 1
            first = 0
            for last in breaks:
                leg = _leg(times[first:last], int(directions[first]), position)
                position = leg.stop_steps
                first = int(last)
                yield leg
            times, directions = times[first:], directions[first:]
        if len(times):
            yield _leg(times, int(directions[0]), position)


def _settled(owed: int, from_s: float, times: F8, directions: I8) -> tuple[F8, I8]:
    """Steps with a difference made up: planned steps the other way are saved, the rest of it is stepped first."""
    against = directions == -np.sign(owed)
    saved = min(int(np.argmin(against)) if not against.all() else len(against), abs(owed))
    count = abs(owed) - saved
    first = from_s + SETTLE_STEP_S * np.arange(1, count + 1)
    times = np.maximum.accumulate(np.concatenate((first, times[saved:])))
    made = np.full(count, np.sign(owed), dtype=np.int64)
    return times, np.concatenate((made, directions[saved:]))


def _joined(legs: list[Leg]) -> Leg:
    """One leg of several that follow each other the same way."""
    return _leg_of(np.concatenate([leg.times_ns for leg in legs]), legs[0].direction, legs[0].start_steps)


def _leg(times_s: F8, direction: int, start_steps: int) -> Leg:
    return _leg_of(np.rint(times_s * NS_PER_S).astype(np.int64), direction, start_steps)


def _leg_of(times_ns: I8, direction: int, start_steps: int) -> Leg:
    stop_steps = start_steps + direction * len(times_ns)
    return Leg(direction, start_steps, stop_steps, times_ns, times_ns.tolist(), np.diff(times_ns).tolist())


def _without_apexes(times: F8, directions: I8, t: F8, p: F8) -> I8:
    """Indices that remain when steps which are taken back at once are dropped, pair by pair, from a chunk.

    The kept sequence is a stack: a reversing step meets the step on top; if the excursion between the two is small
    and short, both go. Only reversals are visited, so a long monotone chunk costs nothing.
    """
    reversals = np.flatnonzero(np.diff(directions) != 0)
    if not any(_is_apex(times[at], times[at + 1], t, p) for at in reversals):
        return np.arange(len(times), dtype=np.int64)
    kept: list[int] = []
    done = 0
    while done < len(times):
        if kept and directions[kept[-1]] != directions[done] and _is_apex(times[kept[-1]], times[done], t, p):
            kept.pop()
            done += 1
            continue
        ahead = reversals[np.searchsorted(reversals, done)] if done <= reversals[-1] else len(times) - 1
        kept.extend(range(done, int(ahead) + 1))
        done = int(ahead) + 1
    return np.array(kept, dtype=np.int64)


def _is_apex(up_s: float, down_s: float, t: F8, p: F8) -> bool:
    first, last = np.searchsorted(t, (up_s, down_s))
    inside = p[first:last]
    overshoot = float(np.ptp(np.append(inside, np.interp(up_s, t, p)))) if len(inside) else 0.0
    return overshoot < NOISE_STEPS or (overshoot < APEX_OVERSHOOT_STEPS and down_s - up_s < APEX_GAP_S)
