"""Watches what the bus really takes, and slows the motion before a load comes too late.

A stream assumes how long a host needs at most before the first byte of a packet leaves (``BusTiming.jitter_max_ns``).
Every answered exchange shows how long it took and how late it was sent. What goes beyond the assumption is its
*excess*. The largest of the last exchanges is assumed from then on, for a count that comes too late must not leave at
all; the third largest slows the motion, so that one or two hiccups do not and a busy host does.

    excess   :  .  . |.  .    .|. ||.|  .  .  .    .   .   .   .
    assumed  --------+ raised at once                            +--- lowered after a calm time
    rate     --------+ lowered, by the root of it, every 0.4 s   +--- raised
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from dataclasses import dataclass, field

from nmc.budget import BusTiming
from nmc.program import Evidence

WINDOW = 128
RANK = 3
"""The excess that slows is the third largest of the window."""
FIRST_AFTER = 6
"""Exchanges that are seen before anything is said."""
TOLERATED_NS = 150_000
"""Excess below this is within what the streams keep in hand."""
STEP_NS = 250_000
"""The assumption is raised in such steps."""
EXCESS_MAX_NS = 30_000_000
CALM_NS = 2_000_000_000
SLOW_EVERY_NS = 400_000_000
"""The speed is changed no more often than this: each time the path is timed anew, which itself makes the host late."""
OWN_DOING = 4
"""Exchanges after a change of speed that say nothing of the host."""
LATE_NS = 500_000
"""An exchange that leaves this much after its time is counted as late."""
LOAD_BYTES = 4
SHARE_STEP = 0.05
SHARE_LEAST = 0.1
BIN_NS = 50_000


@dataclass(frozen=True, slots=True)
class Advice:
    """What to assume of the host from now on, and the share of the programmed speed that the bus can carry."""

    jitter_max_ns: int
    share: float


@dataclass(slots=True)
class HostDelays:
    """What the host and the answers have added to the bytes on the wire, as counts in bins of ``BIN_NS``."""

    bins: dict[int, int] = field(default_factory=dict)
    greatest_ns: int = 0
    late: int = 0

    def add(self, delay_ns: int) -> None:
        """Count one exchange."""
        number = max(delay_ns, 0) // BIN_NS
        self.bins[number] = self.bins.get(number, 0) + 1
        self.greatest_ns = max(self.greatest_ns, delay_ns)

    def quantile_ns(self, share: float) -> int:
        """Upper end of the bin in which this share of all exchanges is reached; 0 without any."""
        left = share * sum(self.bins.values())
        for number in sorted(self.bins):
            left -= self.bins[number]
            if left <= 0:
                return (number + 1) * BIN_NS
        return 0


class Level:
    """An excess that is followed upwards at once, by a quarter at least, and downwards after a calm time."""

    def __init__(self) -> None:
        self.excess_ns = 0
        self._calm_from_ns = 0
        self._calm_excess_ns = 0

    def follow(self, measured_ns: int, now_ns: int) -> bool:
        """Whether it changes."""
        wanted_ns = 0
        if measured_ns > TOLERATED_NS:
            wanted_ns = min(-(-measured_ns // STEP_NS) * STEP_NS, EXCESS_MAX_NS)
        if wanted_ns > self.excess_ns:
            self._set(min(max(wanted_ns, self.excess_ns * 5 // 4), EXCESS_MAX_NS), now_ns)
            return True
        if wanted_ns == self.excess_ns:
            self._calm_from_ns, self._calm_excess_ns = now_ns, 0
            return False
        self._calm_excess_ns = max(self._calm_excess_ns, wanted_ns)
        if now_ns - self._calm_from_ns > CALM_NS:
            self._set(self._calm_excess_ns, now_ns)
            return True
        return False

    def _set(self, excess_ns: int, now_ns: int) -> None:
        self.excess_ns = excess_ns
        self._calm_from_ns, self._calm_excess_ns = now_ns, 0


class Governor:
    """One bus. timing: what its stream assumes at the beginning."""

    def __init__(self, timing: BusTiming) -> None:
        self.timing = timing
        self.delays = HostDelays()
        self.share = 1.0
        self._recent: deque[int] = deque()
        self._sorted: list[int] = []
        self._trust, self._slow = Level(), Level()
        self._changed_ns = -SLOW_EVERY_NS
        self._ignore = 0
        self._answered_ns = 0

    @property
    def excess_ns(self) -> int:
        """What is assumed at present beyond the beginning's assumption."""
        return self._trust.excess_ns

    def observe(self, evidence: Evidence) -> Advice | None:
        """Look at an exchange; advice only when something is to change."""
        excess_ns = self._excess(evidence)
        if excess_ns is None:
            return None
        if self._ignore:
            self._ignore -= 1
            return None
        self._recent.append(excess_ns)
        insort(self._sorted, excess_ns)
        if len(self._recent) > WINDOW:
            del self._sorted[bisect_left(self._sorted, self._recent.popleft())]
        if len(self._recent) < FIRST_AFTER:
            return None
        now_ns = evidence.replied_ns
        assumed = self._trust.follow(self._sorted[-1], now_ns)
        self._slow.follow(self._sorted[-RANK], now_ns)
        share = self._carried()
        due = now_ns - self._changed_ns >= SLOW_EVERY_NS
        if share != self.share and due:
            self.share = share
            self._changed_ns, self._ignore = now_ns, OWN_DOING
        elif not assumed:
            return None
        return Advice(self.timing.jitter_max_ns + self.excess_ns, self.share)

    def _excess(self, evidence: Evidence) -> int | None:
        """What an exchange took beyond what is foreseen; None if it says nothing."""
        exchange, timing = evidence.exchange, self.timing
        # what was asked for only when its time had passed is the stream's own doing
        due_ns = max(exchange.send_at_ns, self._answered_ns)
        late_ns = evidence.sent_ns - due_ns if exchange.send_at_ns else 0
        self._answered_ns = evidence.replied_ns
        self.delays.late += late_ns > LATE_NS
        if not evidence.sent:
            return timing.worst_ns(LOAD_BYTES)
        if evidence.status is None:
            return None
        data, extra = len(exchange.data), len(evidence.extra)
        took_ns = evidence.replied_ns - evidence.sent_ns
        self.delays.add(took_ns - timing.command_ns(data) - timing.reply_ns(extra))
        return max(took_ns - timing.worst_ns(data, extra), 0) + max(late_ns - LATE_NS, 0)

    def _carried(self) -> float:
        """The share of the speed that goes with what is assumed.

        An axis misses between two loads what its acceleration makes of the square of that time. Accelerations go with
        the square of the share: with the root of the time it misses as much more as its turns are longer, not more.
        """
        worst_ns = self.timing.worst_ns(LOAD_BYTES)
        steps = int((worst_ns / (worst_ns + self._slow.excess_ns)) ** 0.5 / SHARE_STEP + 1e-9)
        return max(steps * SHARE_STEP, SHARE_LEAST) if self._slow.excess_ns else 1.0
