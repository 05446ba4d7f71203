"""The steps of a motor as a host can see them: each somewhere between two answers.

A position is read again and again. What was answered held at an instant between the end of the question and the begin
of the answer, whatever host, adapter and chip have added to the times of the wire; so every step lies in a window that
is certain:

    steps  3            _______        window of step 2: from the begin of the last answer that had not seen it
           2      ______|              to the end of the first that had
           1  ____|                    (the readings are the ends of the bars)
                [####]

A hypothesis about the chip predicts windows of its own; it *fits* if every step's two windows meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from nmc.budget import BusTiming
from nmc.program import Evidence

CLOCK_TOLERANCE = 0.002
"""No crystal or resonator is further off."""
EXECUTION_MAX_NS = 3_000_000
"""A command is executed within this time of its last byte; the data sheets do not say how soon."""


@dataclass(frozen=True, slots=True)
class Window:
    """Something happened no earlier than ``first_ns`` and no later than ``last_ns``."""

    first_ns: int
    last_ns: int

    @property
    def middle_ns(self) -> float:
        """Half way."""
        return (self.first_ns + self.last_ns) / 2

    def meets(self, other: Window) -> bool:
        """The two have an instant in common."""
        return self.first_ns <= other.last_ns and other.first_ns <= self.last_ns


@dataclass(frozen=True, slots=True)
class Sighting:
    """A position that was read: ``steps`` made so far in the direction of the trial, and the moving bit."""

    window: Window
    steps: int
    moving: bool


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of the data sheet.

    latch: a count loaded while moving acts at the next roll-over, or reloads the timer at once. first: the first step
    comes one period after the start, or at once.
    """

    latch: Literal["rollover", "immediate"]
    first: Literal["period", "immediate"]


READINGS = tuple(Reading(latch, first) for latch in ("rollover", "immediate") for first in ("period", "immediate"))


def received(timing: BusTiming, evidence: Evidence) -> Window:
    """When the module had the last byte of this command: certain, whatever the host has added."""
    first_ns = evidence.sent_ns + timing.command_ns(len(evidence.exchange.data))
    return Window(first_ns, max(first_ns, evidence.replied_ns - timing.reply_ns(len(evidence.extra))))


def executed(timing: BusTiming, evidence: Evidence) -> Window:
    """When the command was executed."""
    window = received(timing, evidence)
    return Window(window.first_ns, window.last_ns + EXECUTION_MAX_NS)


def step_windows(sightings: Sequence[Sighting]) -> list[Window]:
    """The windows of steps 1, 2, ... as far as they were seen; of what was made before the first reading there is none.

    The first sighting must have seen no step.
    """
    found: list[Window] = []
    before = sightings[0]
    for sighting in sightings[1:]:
        while len(found) < sighting.steps:
            found.append(Window(before.window.first_ns, sighting.window.last_ns))
        before = sighting
    return found


@dataclass(frozen=True, slots=True)
class Trial:
    """A run of ``steps`` with the period ``old_ns``, into which the period ``new_ns`` was loaded (0: none)."""

    steps: int
    old_ns: int
    new_ns: int = 0


def predicted(reading: Reading, trial: Trial, start: Window, load: Window | None) -> list[Window] | None:
    """Windows of the steps by one reading; None if it cannot be told between which roll-overs the load fell.

    start, load: execution of the start and of the count-only load.
    """
    rolls = [] if reading.first == "period" else [start]
    changed: Window | None = None
    at = start
    while len(rolls) < trial.steps:
        period_ns = trial.old_ns if changed is None else trial.new_ns
        roll = _later(at, period_ns)
        if changed is None and load is not None:
            if roll.meets(load):
                return None
            if load.last_ns < roll.first_ns:
                changed = load
                if reading.latch == "immediate":
                    at = load
                    continue
        rolls.append(roll)
        at = roll
    return rolls


def _later(window: Window, period_ns: int) -> Window:
    slack_ns = round(period_ns * CLOCK_TOLERANCE)
    return Window(window.first_ns + period_ns - slack_ns, window.last_ns + period_ns + slack_ns)


def fits(seen: Sequence[Window], wanted: Sequence[Window]) -> bool:
    """All steps were seen and each where it was predicted."""
    return len(seen) == len(wanted) and all(a.meets(b) for a, b in zip(seen, wanted, strict=True))
