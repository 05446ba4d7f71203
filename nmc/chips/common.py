"""What all NMC chips share: framing, baud rates, addresses and the shape of a fact table.

Source: PIC-STEP data sheet sections 3 and 5.1, PIC-SERVO data sheet sections 3, 4.1 and 5 (they agree word for word
on everything here). The tables are read by the driver and by the simulator; each decodes with code of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

# Framing, PIC-STEP section 3.1
HEADER = 0xAA
NULL = 0x00
DATA_MAX = 15
PACKET_MIN_BYTES = 4
PACKET_MAX_BYTES = 19
REPLY_MIN_BYTES = 2
BITS_PER_BYTE = 10  # one start bit, eight data bits, one stop bit

# Time, PIC-STEP sections 3.1 and 3.3, PIC-SERVO sections 3.1 and 4.1
SERVO_TICK_NS = 512_000
REPLY_DELAY_MAX_NS = 512_000  # 0.5 ms (PIC-STEP) and 0.51 ms (PIC-SERVO): the longer is one servo tick
SILENT_WAIT_NS = 512_000  # after a command nobody answers
RESYNC_NULLS = 16  # section 3.4 step 2: 15 data bytes and a checksum
RESYNC_WAIT_NS = 1_000_000

# Baud rates, section 5.1 "Set Baud Rate": the divisor goes to SPBRG with BRGH = 1, on a 20 MHz crystal
CRYSTAL_HZ = 20_000_000
DEFAULT_BAUD = 19_200
BAUD_DIVISORS: Mapping[int, int] = MappingProxyType({9_600: 129, 19_200: 63, 57_600: 20, 115_200: 10})

# Addresses, sections 3.2 and 3.3
MODULES_MAX = 32
DEFAULT_ADDRESS = 0x00
DEFAULT_GROUP = 0xFF
GROUP_MIN = 0x80
MEMBER_BIT = 0x80  # of the group byte of Set Address: set = member, clear = leader

POSITION_MAX = 0x7FFF_FFFF

# Command codes every NMC module understands
SET_ADDRESS = 0x1
DEFINE_STATUS = 0x2
READ_STATUS = 0x3
LOAD_TRAJECTORY = 0x4
START_MOTION = 0x5
STOP_MOTOR = 0x7
SET_BAUD = 0xA
SAVE_HOME = 0xC
NOP = 0xE
HARD_RESET = 0xF

STATUS_COMM_ERROR = 0x02  # status bit 1 of every chip


def true_baud(divisor: int) -> float:
    """Rate in baud that a chip really runs at: 20e6 / (16 (BRD + 1)), PIC-STEP section 5.1 and PIC16C73."""
    return CRYSTAL_HZ / (16 * (divisor + 1))


@dataclass(frozen=True, slots=True)
class Bits:
    """Some bits of a command's control byte (its first data byte)."""

    name: str
    shift: int
    width: int = 1

    @property
    def mask(self) -> int:
        """The bits in place."""
        return ((1 << self.width) - 1) << self.shift


@dataclass(frozen=True, slots=True)
class Field:
    """A number in a command's data, least significant byte first.

    when: name of the control bit that says the field is present; None: always there.
    """

    name: str
    size: int
    least: int
    greatest: int
    signed: bool = False
    when: str | None = None


@dataclass(frozen=True, slots=True)
class CommandFact:
    """One row of a chip's command reference.

    lengths: data lengths the sheet allows. control: bits of data byte 1, empty if that byte is no control byte.
    fields: what follows (from data byte 1 on if there is no control byte). repeatable: sending it twice does what
    sending it once does, so a lost reply may be answered by sending again. while_moving: "yes", "no" or "depends"
    (on the mode: Table 4 of the PIC-STEP, notes 1 and 2 of the PIC-SERVO). answered: a status packet comes back.
    """

    name: str
    code: int
    lengths: tuple[int, ...]
    section: str
    control: tuple[Bits, ...] = ()
    fields: tuple[Field, ...] = ()
    repeatable: bool = False
    while_moving: str = "yes"
    answered: bool = True


@dataclass(frozen=True, slots=True)
class StatusItem:
    """One thing that Define Status or Read Status can ask for; items come in ascending bit order."""

    name: str
    bit: int
    size: int
    signed: bool = False


@dataclass(frozen=True, slots=True)
class ChipFacts:
    """One chip as its data sheet tells it.

    status_bits: names of bits 0..7 of the status byte. byte_items: names of the bits of one-byte status items.
    status_bytes: mask -> number of bytes between status and checksum, for all 256 masks. command_interval_ns: least
    time between two commands to one module, 0 where the sheet names none.
    """

    name: str
    device_type: int
    version: int
    commands: Mapping[int, CommandFact]
    status_items: tuple[StatusItem, ...]
    status_bits: tuple[str, ...]
    byte_items: Mapping[str, tuple[str, ...]]
    status_bytes: tuple[int, ...]
    command_interval_ns: int = 0

    def command(self, name: str) -> CommandFact:
        """The row of that name; KeyError if the chip has no such command."""
        for fact in self.commands.values():
            if fact.name == name:
                return fact
        raise KeyError(f"{self.name} has no command {name!r}")


def status_bytes_table(items: tuple[StatusItem, ...]) -> tuple[int, ...]:
    """Bytes a status packet carries between status and checksum, for every mask 0..255."""
    return tuple(sum(item.size for item in items if mask >> item.bit & 1) for mask in range(256))


ADDRESSING_COMMANDS = (
    CommandFact(
        "set_address",
        SET_ADDRESS,
        (2,),
        "5.1 Set Address",
        fields=(Field("individual", 1, 0, 0xFF), Field("group_byte", 1, 0, 0xFF)),
    ),
    CommandFact(
        "define_status",
        DEFINE_STATUS,
        (1,),
        "5.1 Define Status",
        fields=(Field("items", 1, 0, 0x3F),),
        repeatable=True,
    ),
    CommandFact(
        "read_status", READ_STATUS, (1,), "5.1 Read Status", fields=(Field("items", 1, 0, 0x3F),), repeatable=True
    ),
    CommandFact("set_baud_rate", SET_BAUD, (1,), "5.1 Set Baud Rate", fields=(Field("divisor", 1, 0, 0xFF),)),
    CommandFact("no_operation", NOP, (0,), "5.1 No Operation", repeatable=True),
    CommandFact("hard_reset", HARD_RESET, (0,), "5.1 Hard Reset", answered=False),
)
"""Rows that are the same on every NMC chip."""
