"""Pieces: the part of each leg that one slice of profile ``exact`` makes, begun from rest and run at one rate.

All pieces of a slice begin with one group Start. A slice ends in a pause, so it runs a little faster than the plan: the
instants of its stretch of the plan are mapped to the time since the Start, and an axis gets the period that comes
nearest to them, its k-th step falling k periods after the Start.

    plan       |   :   :   :   :   :   |          : an axis should step
    the chip   S  :   :   :   :   :    S          S all axes start; before it they pause together, which leaves the
                                                    path alone

The chip is behind a straight line by up to a step then, for it waits a period first. So a slice takes a step more that
is due up to half a gap after its end, and the axis is half a step ahead or behind at most.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass

from planner.steptrain import Leg, StepTrain, Train

HALF = 0.5
HASTE = 1.5
"""An axis that is behind catches up by steps so much faster."""
LONE_SHARE = 0.2
"""A single step that is late comes this share of the slice after the Start, over ``HASTE``."""


@dataclass(frozen=True, slots=True)
class Slice:
    """A stretch of the plan, ``from_ns`` to ``until_ns``, and the time from the Start in which it is to be made, ns."""

    from_ns: int
    until_ns: int
    run_ns: int

    def since_start_ns(self, instant_ns: int) -> float:
        """When after the Start an instant of the plan comes."""
        return (instant_ns - self.from_ns) * self.run_ns / (self.until_ns - self.from_ns)

    def until(self, until_ns: int) -> Slice:
        """It ends at another instant of the plan, and is made in the same time."""
        return Slice(self.from_ns, max(until_ns, self.from_ns + 1), self.run_ns)


class PieceTrain(Train):
    """The legs of a step train, handed out in pieces; ``cut`` decides how far the next one goes."""

    def __init__(self, train: StepTrain) -> None:
        self.motor = train.motor
        self.trajectory = train.trajectory
        self.start_steps = train.start_steps
        self.gap_s = train.gap_s
        self.alive = train.alive
        self._train = train
        self._leg: Leg | None = None
        self._from = 0
        self._piece: Leg | None = None

    def peek(self) -> Leg | None:
        """The next piece; before ``cut`` it is a single step."""
        if self._leg is None:
            if self._train.peek() is None:
                return None
            self._leg, self._from = self._train.pop(), 0
        if self._piece is None:
            self._piece = self._steps(1)
        return self._piece

    def due(self, until_ns: int) -> list[int]:
        """Planned instants of what is left of the leg, up to ``until_ns`` and one more."""
        if self.peek() is None:
            return []
        assert self._leg is not None
        instants = self._leg.instants_ns
        return instants[self._from : bisect_right(instants, until_ns, self._from) + 1]

    def after(self, steps: int) -> tuple[int, int] | None:
        """Planned instant and direction of the step that follows ``steps`` more; None if the train ends before."""
        leg, at = self._leg, self._from + steps
        if leg is None or at >= len(leg):
            leg, at = self._train.peek(), 0
        return None if leg is None else (leg.instants_ns[at], leg.direction)

    def cut(self, steps: int) -> Leg:
        """Let the next piece be so many steps of its leg."""
        self.peek()
        self._piece = self._steps(steps)
        return self._piece

    def pop(self) -> Leg:
        """Take the next piece."""
        piece = self.peek()
        assert piece is not None
        assert self._leg is not None
        self._from += len(piece)
        if self._from >= len(self._leg):
            self._leg = None
        self._piece = None
        return piece

    def join(self, before_ns: int) -> None:
        """Nothing: a slice takes what is due in it, and ``cut`` says how much of a leg that is."""

    def _steps(self, count: int) -> Leg:
        leg = self._leg
        assert leg is not None
        end = self._from + count
        start = leg.start_steps + leg.direction * self._from
        instants, gaps = leg.instants_ns[self._from : end], leg.gaps_ns[self._from : end - 1]
        stop = start + leg.direction * len(instants)
        return Leg(leg.direction, start, stop, leg.times_ns[self._from : end], instants, gaps)


def best_end_ns(dues_ns: Sequence[Sequence[int]], earliest_ns: int, latest_ns: int) -> int | None:
    """The instant of the plan, of those given, at which as many axes as possible are just about to step.

    dues_ns: instants of steps, a list an axis. A chip waits a whole period after a Start, which is right for an axis
    that would have stepped then: the sum of squares of how far the others are from that, in steps, is the least. None
    if no step falls between ``earliest_ns`` and ``latest_ns``.
    """
    steady = [dues for dues in dues_ns if len(dues) > 2]
    best_ns, least = None, 0.0
    for dues in steady:
        for ns in dues[bisect_left(dues, earliest_ns) : bisect_right(dues, latest_ns)]:
            off = math.fsum(_phase(others, ns) ** 2 for others in steady)
            if best_ns is None or off < least:
                best_ns, least = ns, off
    return best_ns


def _phase(dues_ns: Sequence[int], at_ns: int) -> float:
    """How far, in steps, an instant is from the nearest step."""
    after = min(max(bisect_left(dues_ns, at_ns), 1), len(dues_ns) - 1)
    before_ns, after_ns = dues_ns[after - 1], dues_ns[after]
    return min(abs(at_ns - before_ns), abs(after_ns - at_ns)) / (after_ns - before_ns)


def steps_in(part: Slice, instants_ns: Sequence[int], at_once: bool) -> int:
    """How many of the steps due at ``instants_ns``, with one beyond the slice if there is one, the slice makes.

    at_once: a chip whose first step comes with the Start; it is ahead of the line and takes a step less.
    """
    count = bisect_left(instants_ns, part.until_ns)
    if at_once:
        before_ns = instants_ns[count - 2] if count > 1 else part.from_ns
        return count - (count > 0 and part.until_ns - instants_ns[count - 1] < HALF * (part.until_ns - before_ns))
    if 0 < count < len(instants_ns):
        gap_ns = instants_ns[count] - instants_ns[count - 1]
        count += instants_ns[count] - part.until_ns < HALF * gap_ns
    return count


def period_for(part: Slice, instants_ns: Sequence[int], at_once: bool) -> int:
    """The period, ns, that brings the steps of a slice nearest to their instants: least squares through the Start.

    Steps that are late already do not make it shorter than ``HASTE`` times as fast as the plan, unless the slice has no
    room for them otherwise.
    """
    count = len(instants_ns)
    first = 0 if at_once else 1
    last = first + count - 1
    if not last:
        return part.run_ns  # a single step, with the Start
    times = [part.since_start_ns(ns) for ns in instants_ns]
    fitted = sum(k * t for k, t in enumerate(times, first)) / sum(k * k for k in range(first, last + 1))
    gap = (times[-1] - times[0]) / (count - 1) if count > 1 else part.run_ns * LONE_SHARE
    return int(min(max(fitted, gap / HASTE), part.run_ns / last))
