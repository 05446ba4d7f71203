"""A source that never keeps the host waiting long: in a dwell it asks a module how it is, instead of sleeping.

So a stop request is noticed within ``LONGEST_WAIT_NS`` whatever the program waits for, and a machine that has lost
power during a dwell is noticed then and not at its end.
"""

from __future__ import annotations

from nmc.chips.common import NOP, START_MOTION
from nmc.program import Evidence, Exchange, ExchangeSource

LONGEST_WAIT_NS = 50_000_000


class PatientSource:
    """Wraps an ``ExchangeSource``; before an exchange that is due late it polls the module at ``address``."""

    def __init__(self, inner: ExchangeSource, address: int) -> None:
        self._inner = inner
        self._address = address
        self._waiting: Exchange | None = None
        self._recalled = False

    def recall(self) -> None:
        """A group Start that is waited for must not leave any more: the times have changed."""
        self._recalled = self._waiting is not None and self._waiting.command == START_MOTION

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        """The inner source's next exchange, or a No Operation while that is still far off."""
        if self._recalled and self._waiting is not None:
            evidence = Evidence(self._waiting, now_ns, now_ns, None, sent=False)
            self._waiting, self._recalled = None, False
        exchange = self._waiting
        if exchange is None:
            exchange = self._inner.next(now_ns, evidence)
            if exchange is None:
                return None
        if exchange.command == NOP or exchange.send_at_ns - now_ns <= 2 * LONGEST_WAIT_NS:
            self._waiting = None
            return exchange
        self._waiting = exchange
        at_ns = now_ns + LONGEST_WAIT_NS
        return Exchange(self._address, NOP, send_at_ns=at_ns, line=exchange.line, bus=exchange.bus)
