"""PIC-I/O (type 2): digital and analog inputs and outputs on the same bus.

No data sheet of it was at hand: the command and status-item numbers are those of the vendor's published host headers,
which every host program for this module agrees on. Addressing, status, baud, NOP and reset are as on the other chips.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from nmc.chips.common import (
    ADDRESSING_COMMANDS,
    DEFINE_STATUS,
    READ_STATUS,
    ChipFacts,
    CommandFact,
    Field,
    StatusItem,
    status_bytes_table,
)

DEVICE_TYPE = 2
VERSION = 2
IO_BITS = 12
DIRECTION_RESET = 0x0FFF  # all bits are inputs after a reset

STATUS_COMM_ERROR = 0x02
STATUS_BITS = ("bit0", "checksum_error", "bit2", "bit3", "bit4", "bit5", "bit6", "bit7")

ITEM_INPUTS = 0x01
ITEM_AD1 = 0x02
ITEM_AD2 = 0x04
ITEM_AD3 = 0x08
ITEM_TIMER = 0x10
ITEM_TYPE_VERSION = 0x20
ITEM_SYNC_INPUTS = 0x40
ITEM_SYNC_TIMER = 0x80
STATUS_ITEMS = (
    StatusItem("input_word", 0, 2),
    StatusItem("ad1", 1, 1),
    StatusItem("ad2", 2, 1),
    StatusItem("ad3", 3, 1),
    StatusItem("timer", 4, 4),
    StatusItem("type_version", 5, 2),
    StatusItem("sync_input_word", 6, 2),
    StatusItem("sync_timer", 7, 4),
)

_ALL_ITEMS = (Field("items", 1, 0, 0xFF),)

COMMANDS: Mapping[int, CommandFact] = MappingProxyType(
    {
        fact.code: fact
        for fact in (
            *(
                replace(fact, fields=_ALL_ITEMS) if fact.code in (DEFINE_STATUS, READ_STATUS) else fact
                for fact in ADDRESSING_COMMANDS
            ),
            CommandFact(
                "set_io_direction", 0x0, (2,), "SET_IO_DIR", fields=(Field("inputs", 2, 0, 0xFFFF),), repeatable=True
            ),
            CommandFact(
                "set_pwm",
                0x4,
                (2,),
                "SET_PWM",
                fields=(Field("pwm1", 1, 0, 0xFF), Field("pwm2", 1, 0, 0xFF)),
                repeatable=True,
            ),
            CommandFact("synch_output", 0x5, (0,), "SYNCH_OUT"),
            CommandFact(
                "set_output", 0x6, (2,), "SET_OUTPUT", fields=(Field("outputs", 2, 0, 0xFFFF),), repeatable=True
            ),
            CommandFact(
                "set_synch_output",
                0x7,
                (4,),
                "SET_SYNCH_OUT",
                fields=(Field("outputs", 2, 0, 0xFFFF), Field("pwm1", 1, 0, 0xFF), Field("pwm2", 1, 0, 0xFF)),
                repeatable=True,
            ),
            CommandFact("set_timer_mode", 0x8, (1,), "SET_TMR_MODE", fields=(Field("mode", 1, 0, 0x33),)),
            CommandFact("synch_input", 0xC, (0,), "SYNCH_INPUT"),
        )
    }
)

FACTS = ChipFacts(
    name="pic-io",
    device_type=DEVICE_TYPE,
    version=VERSION,
    commands=COMMANDS,
    status_items=STATUS_ITEMS,
    status_bits=STATUS_BITS,
    byte_items=MappingProxyType({}),
    status_bytes=status_bytes_table(STATUS_ITEMS),
)
