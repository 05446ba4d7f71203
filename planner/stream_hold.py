"""Feed hold on a running stream: along the path to rest, steps exact afterwards.

The trajectory is timed anew after what was sent and ends in a rest. A PIC-STEP's stop position cannot be moved while it
runs (data sheet, table 4), so an axis that has to stand before it is brought there by its counts: behind its last
wanted step comes the longest period that the timer knows, and a Stop Motor falls into that gap.

    steps    | | |  |   |     |         .  .  .  .  .  .  .  .  (|)       the step in brackets never comes
    counts                     '-- longest period -->
    bus                            [Stop Motor][read position]

Then the counters are read, and the rest of the path begins at what was read.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from planner.timing import Rate


@runtime_checkable
class Retimed(Protocol):
    """A trajectory that can be timed anew after a moment up to which everything has been sent."""

    def hold(self, sent_s: float) -> Rests:
        """Come to rest along the path."""

    def resume(self, sent_s: float) -> None:
        """Go on from the rest."""

    def override(self, sent_s: float, rate: Rate) -> None:
        """Change the rate of everything after ``sent_s``."""


class Rests(Protocol):
    """Where and when a hold comes to rest."""

    time_s: float


@dataclass(slots=True)
class Hold:
    """One hold: the path rests from ``rest_ns`` on; ``stands`` once every axis has come to rest and been read."""

    rest_ns: int
    stands: bool = False
