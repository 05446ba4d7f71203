"""What a chip is most likely doing: a set of possible chips, narrowed by the positions that it reports.

Unknown are the instants at which commands were executed, the crystal, and so, where a load came near a roll-over, which
period it has changed. No formula holds all of that, but a hundred possible chips do: each has a crystal and instants of
its own and does what the data sheet says. Those that could not have shown the counter that was read are replaced by
copies of those that could (a particle filter: Gordon, Salmond and Smith, 1993).

    loads      |     P     |     P'                two possible chips a moment apart, and a load between their
    chip 1     '    '    '      '      '           roll-overs: the one makes a period more than the other
    chip 2      '    '        '      '      '

The bounding twins, which keep the machine safe, do not depend on any of this.
"""

from __future__ import annotations

import numpy as np

from nmc.belief_kernel import CHIPS, F8, RATE, ROOT, ROWS, begin, errors, load, mean, spread, step_spread, weigh
from nmc.budget import Window

PPM = 1e-6
UNKNOWN = -1.0
FAR_STEPS = 2.0
"""If the distances without and with a load sum up to more, what it mends counts for more in proportion."""


class Belief:
    """The possible chips of one axis. Crystals outlive the legs.

    crystal_ppm: the crystal lies within plus and minus this.
    """

    __slots__ = ("_arrival_deviation_ns", "_chips", "_multiplier", "_seen", "steps")

    def __init__(self, crystal_ppm: int) -> None:
        self.steps = 0
        self._chips: F8 = np.zeros((ROWS, CHIPS))
        self._chips[RATE] = crystal_ppm * PPM * (2.0 * (np.arange(CHIPS) + 0.5) / CHIPS - 1.0)
        self._chips[1:3] = 1.0
        self._seen: tuple[Window, F8] | None = None
        self._multiplier = 1
        self._arrival_deviation_ns = UNKNOWN

    @property
    def rate(self) -> float:
        """Crystal error: periods are most likely longer by this share."""
        return float(np.mean(self._chips[RATE]))

    def start(self, window: Window, period_ns: int, steps: int, at_once: bool = False) -> None:
        """A run of ``steps`` from rest was started within a window; ``at_once``: its first step came with it."""
        self.steps = steps
        self._seen = None
        begin(self._chips, self._turn(), window.likely_ns, window.latest_ns, period_ns, steps, at_once)

    def load(self, window: Window, period_ns: int) -> None:
        """A count was executed within a window."""
        load(self._chips, self._turn(), window.likely_ns, window.latest_ns, period_ns)

    def latch(self, window: Window) -> None:
        """The position was saved within a window and will be read later."""
        self._seen = window, self._chips.copy()

    def latched(self, left: int) -> bool:
        """The saved position was read: ``left`` steps were to go.

        False if that was thought next to impossible: the belief begins anew around it. Without a latch, and after a new
        start, there is nothing to learn.
        """
        if self._seen is None:
            return True
        (window, then), self._seen = self._seen, None
        return bool(weigh(self._chips, then, self._turn(), window.likely_ns, window.latest_ns + 1.0, left, self.steps))

    def mean(self, at_ns: int) -> tuple[int, int, int]:
        """(next step's instant, period after it, steps left) of the mean chip, as it is at ``at_ns``."""
        next_ns, period_ns, left = mean(self._chips, at_ns, self.steps)
        return round(next_ns), round(period_ns), int(left)

    def next_deviation_ns(self, left: int) -> float:
        """Standard deviation of the instant of the step that is made with ``left`` steps to go."""
        return float(step_spread(self._chips, left))

    def deviation_steps(self, at_ns: int) -> float:
        """Standard deviation of the steps to go at an instant to come."""
        return float(spread(self._chips, at_ns))

    def arrival_deviation_ns(self) -> float:
        """Standard deviation of the instant of the last step; asked for far more often than the chips change."""
        if self._arrival_deviation_ns == UNKNOWN:
            self._arrival_deviation_ns = self.next_deviation_ns(1)
        return self._arrival_deviation_ns

    def mends_steps(self, execute_ns: int, width_ns: int, target_ns: int, wanted: float, period_ns: int) -> float:
        """What a load would mend at ``target_ns``, where ``wanted`` steps should be to go; negative if it would harm.

        In steps, but more than that for what is far off before and after: an axis that can be brought nearer only
        slowly must not wait for others that a load would put right by as many steps. The load would be executed within
        ``width_ns`` around ``execute_ns`` and give it ``period_ns``. See ``nmc.belief_kernel.errors`` for what counts.
        """
        without, with_load = errors(self._chips, execute_ns, width_ns, target_ns, wanted, period_ns)
        return float((without - with_load) * max(1.0, (without + with_load) / FAR_STEPS))

    def _turn(self) -> int:
        """Of what changes the chips: another set of quantiles."""
        self._arrival_deviation_ns = UNKNOWN
        self._multiplier = self._multiplier * ROOT % CHIPS
        return self._multiplier
