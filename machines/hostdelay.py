"""How late this host is, measured on its ports while nothing moves.

Some tens of No Operations a bus, each asked for a little later than the last answer came. Late is what leaves after its
time, and what an answer takes beyond the bytes and the half millisecond that a module may take (PIC-STEP data sheet,
section 3.1): the two add up as they would for a load.

    due   leaves                       answered
     |~~~~~~[bytes]...[<= 0.5 ms]...[bytes]~~~~|
      late                                 late
"""

from __future__ import annotations

from machines.bringup import Connection
from machines.pauses import nothing_old_looked_at
from machines.wiring import nmc_buses
from nmc.budget import REPLY_DELAY_MAX_NS, BusTiming
from nmc.chips.common import NOP
from nmc.program import Exchange

EXCHANGES = 64
WARMING = 8
"""The first ones are not counted: they go ways through the program that nothing has gone before."""
APART_NS = 2_000_000


def host_delay_ns(connection: Connection, addresses: dict[int, int]) -> int:
    """The longest delay of the host on these buses, ns. addresses: of a module to ask, by number of its bus.

    Raises NmcError where a bus does not answer.
    """
    longest_ns = 0
    with nothing_old_looked_at():
        for number, address in addresses.items():
            bus = connection.buses[number]
            timing = BusTiming.at(list(nmc_buses(connection.config).values())[number].baud)
            for turn in range(WARMING + EXCHANGES):
                due_ns = bus.link.now_ns() + APART_NS
                told = bus.exchange(Exchange(address, NOP, send_at_ns=due_ns, bus=number))
                took_ns = told.replied_ns - told.sent_ns - timing.command_ns(0) - timing.reply_ns(len(told.extra))
                late_ns = max(told.sent_ns - due_ns, 0) + max(took_ns - REPLY_DELAY_MAX_NS, 0)
                if turn >= WARMING:
                    longest_ns = max(longest_ns, late_ns)
    return longest_ns
