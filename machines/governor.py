"""Watches what the bus really takes, and slows the motion before a load comes too late.

A stream assumes how long a host needs at most before the first byte of a packet leaves (``BusTiming.jitter_max_ns``).
Every answered exchange shows how long it took and how late it was sent. What goes beyond the assumption is its
*excess*; the third largest of the last exchanges counts, so that one or two hiccups are no reason and a busy host is.

    excess   :  .  . |.  .    .|. ||.|  .  .  .    .   .   .   .
    assumed  --------+ raised at once                            +--- lowered after a calm time
    rate     --------+ lowered at once, in the same proportion   +--- raised
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from dataclasses import dataclass, field

from nmc.budget import BusTiming
from nmc.program import Evidence

WINDOW = 128
RANK = 3
"""The excess that counts is the third largest of the window."""
FIRST_AFTER = 6
"""Exchanges that are seen before anything is said."""
TOLERATED_NS = 150_000
"""Excess below this is within what the streams keep in hand."""
STEP_NS = 250_000
"""The assumption is raised in such steps."""
EXCESS_MAX_NS = 30_000_000
CALM_NS = 2_000_000_000
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


class Governor:
    """One bus. timing: what its stream assumes at the beginning."""

    def __init__(self, timing: BusTiming) -> None:
        self.timing = timing
        self.delays = HostDelays()
        self.excess_ns = 0
        """What is assumed at present beyond the beginning's assumption."""
        self.share = 1.0
        self.least_share = 1.0
        self._recent: deque[int] = deque()
        self._sorted: list[int] = []
        self._calm_from_ns = 0
        self._calm_excess_ns = 0

    def observe(self, evidence: Evidence) -> Advice | None:
        """Look at an exchange; advice only when something is to change."""
        excess_ns = self._excess(evidence)
        if excess_ns is None:
            return None
        self._recent.append(excess_ns)
        insort(self._sorted, excess_ns)
        if len(self._recent) > WINDOW:
            del self._sorted[bisect_left(self._sorted, self._recent.popleft())]
        if len(self._recent) < FIRST_AFTER:
            return None
        return self._judge(self._sorted[-RANK], evidence.replied_ns)

    def _excess(self, evidence: Evidence) -> int | None:
        """What an exchange took beyond what is foreseen; None if it says nothing."""
        exchange, timing = evidence.exchange, self.timing
        late_ns = evidence.sent_ns - exchange.send_at_ns if exchange.send_at_ns else 0
        self.delays.late += late_ns > LATE_NS
        if not evidence.sent:
            return timing.worst_ns(LOAD_BYTES)
        if evidence.status is None:
            return None
        data, extra = len(exchange.data), len(evidence.extra)
        took_ns = evidence.replied_ns - evidence.sent_ns
        self.delays.add(took_ns - timing.command_ns(data) - timing.reply_ns(extra))
        return max(took_ns - timing.worst_ns(data, extra), 0) + max(late_ns - LATE_NS, 0)

    def _judge(self, measured_ns: int, now_ns: int) -> Advice | None:
        wanted_ns = 0
        if measured_ns > TOLERATED_NS:
            wanted_ns = min(-(-measured_ns // STEP_NS) * STEP_NS, EXCESS_MAX_NS)
        if wanted_ns > self.excess_ns:  # by a quarter at least: every change times the path anew
            return self._assume(min(max(wanted_ns, self.excess_ns * 5 // 4), EXCESS_MAX_NS), now_ns)
        if wanted_ns == self.excess_ns:
            self._calm_from_ns, self._calm_excess_ns = now_ns, 0
            return None
        self._calm_excess_ns = max(self._calm_excess_ns, wanted_ns)
        if now_ns - self._calm_from_ns > CALM_NS:
            return self._assume(self._calm_excess_ns, now_ns)
        return None

    def _assume(self, excess_ns: int, now_ns: int) -> Advice:
        self.excess_ns = excess_ns
        self._calm_from_ns, self._calm_excess_ns = now_ns, 0
        worst_ns = self.timing.worst_ns(LOAD_BYTES)
        steps = int(worst_ns / (worst_ns + excess_ns) / SHARE_STEP + 1e-9)
        self.share = max(steps * SHARE_STEP, SHARE_LEAST)
        self.least_share = min(self.least_share, self.share)
        return Advice(self.timing.jitter_max_ns + excess_ns, self.share)
