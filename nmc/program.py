"""What the executor accepts: one bus exchange at a time, pulled from a source that sees what came back.

The executor owns this protocol; planner implements it. A source never runs further ahead than one load an axis,
because it is asked for the next exchange only when the previous one has been answered.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Exchange:
    """One command packet and its answer.

    address: individual or group address 0..255. command: low nibble, 0..15. data: 0..15 bytes.
    reply_extra: status bytes expected after the status byte, before the checksum; None: nobody answers (a group
    without leader), the bus then waits 0.512 ms as data sheet section 3.3 asks.
    send_at_ns: link time before which the first byte must not leave; 0: at once. line: G-code line it serves.
    at_rest: addresses of PIC-STEPs that the source knows to have come to rest at their stop positions (its twins say
    so), stated to the mode guard before this exchange is judged. endless: this load is meant to run without any stop
    position; a count-only load from Stopped is refused without it. for_rest: this load of a running PIC-STEP is only to
    be kept ("no effect whatsoever until a Start Motion", section 5.1) and is started when it has come to rest at its
    stop position; it is judged as a load from Stopped, and a Start before the rest is stated is refused.
    not_after_ns: link time after which the first byte must not leave any more (0: no such time); a host that was held
    up then sends nothing and says so in the evidence, for what was safe when it was decided may not be any more.
    The bus knows the reply length of modules it has started up and then ignores ``reply_extra``.
    """

    address: int
    command: int
    data: bytes = b""
    reply_extra: int | None = 0
    send_at_ns: int = 0
    line: int = 0
    bus: int = 0
    at_rest: tuple[int, ...] = ()
    endless: bool = False
    not_after_ns: int = 0
    for_rest: bool = False


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is known after an exchange.

    sent_ns: link time at which the first byte was handed over. replied_ns: link time at which the last reply byte was
    in (of a silent group: when the wait ended). status: the status byte, None if nobody answers. extra: the bytes
    between status and checksum. sent: False if it was too late for the exchange and nothing left.
    """

    exchange: Exchange
    sent_ns: int
    replied_ns: int
    status: int | None
    extra: bytes = b""
    sent: bool = True


class ExchangeSource(Protocol):
    """A stream of exchanges; ``next`` is given the link's time and the evidence of the exchange before."""

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        """The next exchange, or None when the stream is over."""
