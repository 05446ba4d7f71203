"""Bus arithmetic: how long an exchange takes on the wire, in integer ns.

The host's bytes leave at the host's baud; a module answers at the true rate of its divisor, 20 MHz / (16 (BRD + 1)).
A byte is ten bits (PIC-STEP data sheet, section 3.1: one start bit, eight data bits, one stop bit).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from nmc.chips.common import BAUD_DIVISORS, true_baud

BITS_PER_BYTE = 10
PACKET_OVERHEAD_BYTES = 4
"""Header, address, command and checksum (section 3.1)."""
REPLY_OVERHEAD_BYTES = 2
"""Status byte and checksum (section 3.1)."""
REPLY_DELAY_MAX_NS = 500_000
"""The first reply byte comes within 0.5 ms of the last command byte (section 3.1)."""
SILENT_WAIT_NS = 512_000
"""After a command that nobody answers: at least 0.5 ms (section 3.3), 0.51 ms on a bus with PIC-SERVOs."""

CLOCKS_NS = 100_000
"""What clocks that are a little off may add to a reply."""


def module_byte_ns(baud: int) -> int:
    """Duration of one byte sent by a module that was set to ``baud`` (a key of the sheet's table of divisors)."""
    return round(BITS_PER_BYTE * 1_000_000_000 / true_baud(BAUD_DIVISORS[baud]))


class Window(NamedTuple):
    """When a command was executed, link time in ns.

    earliest_ns, latest_ns: certain. likely_ns: not before this if the host noted the answer when it came: the sheet
    lets a module take ``REPLY_DELAY_MAX_NS`` at most, but a host may look at its port later.
    """

    earliest_ns: int
    latest_ns: int
    likely_ns: int

    @property
    def middle_ns(self) -> int:
        """The best guess."""
        return (self.likely_ns + self.latest_ns) // 2


@dataclass(frozen=True, slots=True)
class BusTiming:
    """What a stream assumes of its bus. All ns.

    jitter_max_ns: longest host delay before the first byte of a packet. start_delay_max_ns: longest time from the last
    command byte to its execution in a PIC-STEP (not given by the data sheet; measured or assumed).
    """

    byte_ns: int
    reply_byte_ns: int
    jitter_max_ns: int = 0
    start_delay_max_ns: int = 250_000
    reply_delay_max_ns: int = REPLY_DELAY_MAX_NS

    @classmethod
    def at(cls, baud: int, *, jitter_max_ns: int = 0, start_delay_max_ns: int = 250_000) -> BusTiming:
        """Timing of a bus at ``baud`` (the host's nominal rate)."""
        return cls(
            byte_ns=BITS_PER_BYTE * 1_000_000_000 // baud,
            reply_byte_ns=module_byte_ns(baud),
            jitter_max_ns=jitter_max_ns,
            start_delay_max_ns=start_delay_max_ns,
        )

    def command_ns(self, data_bytes: int) -> int:
        """Wire time of a command packet with ``data_bytes`` data bytes."""
        return (PACKET_OVERHEAD_BYTES + data_bytes) * self.byte_ns

    def reply_ns(self, extra_bytes: int) -> int:
        """Wire time of a status packet with ``extra_bytes`` beyond the status byte."""
        return (REPLY_OVERHEAD_BYTES + extra_bytes) * self.reply_byte_ns

    def worst_ns(self, data_bytes: int, extra_bytes: int = 0) -> int:
        """Longest time from handing over the first byte to having the whole reply."""
        return self.command_ns(data_bytes) + self.jitter_max_ns + self.reply_delay_max_ns + self.reply_ns(extra_bytes)

    def mean_exchange_ns(self, data_bytes: int, extra_bytes: int = 0) -> int:
        """Like ``worst_ns`` with jitter and reply delay at half of their greatest values."""
        waits = self.jitter_max_ns + self.reply_delay_max_ns
        return self.command_ns(data_bytes) + waits // 2 + self.reply_ns(extra_bytes)

    def execution_window_ns(self, sent_ns: int, replied_ns: int, data_bytes: int, extra_bytes: int = 0) -> Window:
        """When a PIC-STEP executed the command of this exchange.

        The reply bounds the outbound delay from above: the command was complete before the reply began. A reply that
        comes later than anything assumed of host and module says that the assumption on the host is wrong; then it is
        the only bound.
        """
        first = sent_ns + self.command_ns(data_bytes)
        reply_ns = max(first, replied_ns - self.reply_ns(extra_bytes))
        foreseen_ns = first + self.jitter_max_ns
        broken = reply_ns > foreseen_ns + self.reply_delay_max_ns + CLOCKS_NS
        last = reply_ns if broken else min(foreseen_ns, reply_ns)
        likely = min(max(first, reply_ns - self.reply_delay_max_ns), last)
        return Window(first, last + self.start_delay_max_ns, likely)

    def reading_window_ns(self, sent_ns: int, replied_ns: int, data_bytes: int, extra_bytes: int) -> Window:
        """When what a module answers was read in it: after the command's end and before the answer began."""
        first = sent_ns + self.command_ns(data_bytes)
        last = max(first, replied_ns - self.reply_ns(extra_bytes))
        return Window(first, last, max(first, last - self.reply_delay_max_ns))
