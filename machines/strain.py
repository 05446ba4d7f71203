"""What a bus cannot follow shows in its axes: they leave the path. Then time is stretched, until they keep to it.

How far the host believes the axes to be off the path (``planner.stream_strain``) is looked at every ``EVERY_NS``. A
single look says little: a departure, a corner. Of the looks of the last second the third largest is the *strain*.

    strain  :      . : |                          What an axis misses between two loads goes with its acceleration, so
    limit   ----------[#]----------------------   with the square of how fast the clock of the path goes: the share
              .  :  .  |  : .  . .  .   . .  .    that brings the strain to the limit is known.
    share   -----------+                  +---    It is raised again when the strain has been so low that it may be.
                       +------------------+
"""

from __future__ import annotations

from collections import deque

EVERY_NS = 50_000_000
WINDOW, RANK = 20, 3
SHARE_OF_LIMIT = 0.8
"""The strain that is aimed at, of what the verdict allows; what is in between two looks is larger."""
LEAST_STEPS = 2.0
"""A limit below this is near what the steps themselves are off a path."""
SETTLES_NS = 500_000_000
"""After a change nothing is looked at for so long: what is under way has the old times."""
CALM_LOOKS = 60
"""The share is raised when so many looks on end would allow it."""
SHARE_STEP, SHARE_LEAST = 0.05, 0.1


class Strain:
    """The looks of one run. limit_steps: largest distance from the path that the verdict allows.

    slows: the share may change; without, the axes are looked at all the same, and nothing follows from it.
    """

    def __init__(self, limit_steps: float, slows: bool = True) -> None:
        self.aim_steps = max(SHARE_OF_LIMIT * limit_steps, LEAST_STEPS)
        self.slows = slows
        self.share = 1.0
        self.steps = 0.0
        """The strain that has changed the share last."""
        self.greatest_steps: float | None = None
        """The largest single look so far."""
        self._looks: deque[float] = deque(maxlen=WINDOW)
        self._calm: deque[float] = deque(maxlen=CALM_LOOKS)
        self._next_ns = 0

    def due(self, now_ns: int) -> bool:
        """It is time to look."""
        return now_ns >= self._next_ns

    def look(self, steps: float, now_ns: int, now_share: float) -> bool:
        """The axes are believed to be so far off at this share of the speed; whether another one is wanted now."""
        self._next_ns = now_ns + EVERY_NS
        self._looks.append(steps)
        self._calm.append(steps)
        self.greatest_steps = max(self.greatest_steps or 0.0, steps)
        if not self.slows or len(self._looks) < RANK:
            return False
        strain = sorted(self._looks)[-RANK]
        allowed = self._allowed(strain, now_share)
        if allowed >= self.share and len(self._calm) == CALM_LOOKS:
            allowed = max(self._allowed(max(self._calm), now_share), self.share)
        if allowed == self.share or (allowed > self.share and len(self._calm) < CALM_LOOKS):
            return False
        self.share, self.steps = allowed, strain
        self.pause(now_ns)
        return True

    def skip(self, now_ns: int) -> None:
        """Nothing moves: that says nothing."""
        self._next_ns = now_ns + EVERY_NS

    def pause(self, now_ns: int) -> None:
        """The times have changed, or the machine stands: begin anew."""
        self._looks.clear()
        self._calm.clear()
        self._next_ns = now_ns + SETTLES_NS

    def _allowed(self, strain: float, now_share: float) -> float:
        """The share of the speed that brings a strain to what is aimed at, in whole ``SHARE_STEP``."""
        share = now_share * (self.aim_steps / max(strain, 1e-9)) ** 0.5
        if strain > self.aim_steps:
            share = min(share, now_share - SHARE_STEP)
        return min(max(int(share / SHARE_STEP + 1e-9) * SHARE_STEP, SHARE_LEAST), 1.0)
