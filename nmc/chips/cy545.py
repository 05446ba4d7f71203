"""The CY545: a single-axis stepper controller with ASCII commands on a serial port of its own.

Source: CY545 manual, chapter 5 (motor commands) and, for syntax, defaults, queries and timing, what is known of
chapters 4, 6, 9, 10, 14, 16 and 17. The chip's Rate Table (chapter 17) is data that the user brings: a CSV with the
columns ``rate,steps_per_s_12mhz``, one row for each of the 256 rates. The tables here are read by the driver, the
planner and the simulator; each has code of its own.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

# The position register, chapter 5 (A, P)
POSITION_BITS = 24
BLOCK = 1 << POSITION_BITS  # 16,777,216: the register counts modulo this
STEPS_MAX = BLOCK - 1  # of one N

# Chapter 5: rates hold for 12 MHz; chapter 17: one rate entry per (256 - s) x 256 us on the ramp
TABLE_CRYSTAL_MHZ = 12.0
RAMP_UNIT_NS = 256_000
SLOPE_MIN, SLOPE_MAX = 1, 255
RATE_MIN, RATE_MAX = 1, 255  # rate 0 is not told: refused
RATES = 256
JOG_DIVISOR = 20  # chapter 2: JOG runs at First Rate / 20

CRYSTAL_SHARE = 1000
"""A motion may last this part longer than reckoned: crystals are better than a thousandth."""

# Chapter 16: three characters are kept while a command executes, everything else is lost
BUFFER_CHARS = 3
END = 0x0D  # carriage return, chapters 4 and 5
BITS_PER_CHAR = 10

# Chapter 10: what power-on and I leave behind
RESET_VALUES: Mapping[str, int] = MappingProxyType({"R": 100, "F": 14, "S": 220, "N": 200, "P": 0, "O": 0x80})
MODE_ASCII = 0x80  # chapter 9, bit 7
MODE_SHOW_POSITION = 0x10  # bit 4: show the position while homing or jogging
MODE_CTS = 0x20
"""Bit of the mode register that turns CTS on. The manual says that one does; which one is this project's stand-in."""


@dataclass(frozen=True, slots=True)
class CommandFact:
    """One letter of chapter 4's list. bits: widths of its arguments. moves: it starts a motion."""

    letter: str
    name: str
    bits: tuple[int, ...] = ()
    moves: bool = False
    section: str = "5"


MOTOR_COMMANDS = (
    CommandFact("A", "at", (24,)),
    CommandFact("C", "continuous"),
    CommandFact("F", "first_rate", (8,)),
    CommandFact("G", "go", moves=True),
    CommandFact("N", "number", (24,)),
    CommandFact("P", "position", (24,), moves=True),
    CommandFact("R", "rate", (8,)),
    CommandFact("S", "slope", (8,)),
    CommandFact("+", "clockwise"),
    CommandFact("-", "counter_clockwise"),
)
OTHER_COMMANDS = (
    CommandFact("B", "bit", (8,), section="6"),
    CommandFact("D", "delay", (16,), section="10"),
    CommandFact("I", "initialize", section="10"),
    CommandFact("O", "mode", (8,), section="9"),
    CommandFact("?", "query", section="14"),
    CommandFact("0", "stop_program", section="8"),
)
COMMANDS: Mapping[str, CommandFact] = MappingProxyType(
    {fact.letter: fact for fact in (*MOTOR_COMMANDS, *OTHER_COMMANDS)}
)
"""The commands that are modelled here, by letter."""
KNOWN_LETTERS = frozenset('ABCDEFGHIJLNOPQRSTWXYZ+-/?0["')
"""Every letter the chip knows (chapter 4); U and V are reserved, M is invalid."""

QUERY_DIGITS: Mapping[str, int] = MappingProxyType(
    {"A": 8, "N": 8, "P": 8, "R": 5, "F": 5, "S": 5, "B": 5, "D": 5, "O": 5}
)
"""Digits of the answer ``X=vvvvv`` to ``?X`` (chapter 14): five, or eight of a 24-bit value."""


def bit_command(register: int, code: int, *, negate: bool = False) -> int:
    """The user bits 0..7 and bus bits 8..15 after B ``code`` (chapter 6), ``/`` exchanging set and clear.

    0-7 and 8-15 set a bit, 16-23 and 24-31 clear one, 64-127 write user bits 0 to 5, 128-191 AND, 192-255 OR them.
    Raises ValueError for 32..63, which the manual leaves out.
    """
    if negate:
        code ^= 0x10
    if code < 16:
        return register | 1 << code
    if code < 32:
        return register & ~(1 << code - 16)
    if code < 64:
        raise ValueError(f"B {code} is not a bit command")
    value = code & 0x3F
    if code < 128:
        return register & ~0x3F | value
    return register & (value | ~0x3F) if code < 192 else register | value


def ramp_entry_ns(slope: int, crystal_mhz: float = TABLE_CRYSTAL_MHZ) -> int:
    """Time the ramp spends on one entry of the rate table: (256 - s) x 256 us at 12 MHz (from chapter 17's formula)."""
    return round((256 - slope) * RAMP_UNIT_NS * TABLE_CRYSTAL_MHZ / crystal_mhz)


@dataclass(frozen=True, slots=True)
class RateTable:
    """Step rates in steps/s at 12 MHz by table index 0..255. stand_in: not the manual's table, ``source`` says so."""

    steps_per_s: tuple[float, ...]
    source: str
    stand_in: bool = False

    def rate_hz(self, index: int, crystal_mhz: float = TABLE_CRYSTAL_MHZ) -> float:
        """Real rate: table x Fcy/12."""
        return self.steps_per_s[index] * crystal_mhz / TABLE_CRYSTAL_MHZ

    def period_ns(self, index: int, crystal_mhz: float = TABLE_CRYSTAL_MHZ) -> int:
        """Step period in whole ns of the nominal crystal."""
        return round(1e9 / self.rate_hz(index, crystal_mhz))


def parse_rate_table(text: str, source: str) -> RateTable:
    """A rate table from CSV text: ``#`` comments, the header, then 256 ascending rows.

    A comment that contains ``stand-in`` marks the table as one. Raises ValueError with the line that is wrong.
    """
    rows: list[tuple[int, float]] = []
    stand_in = False
    header = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("#") or not line.strip():
            stand_in |= "stand-in" in line
            continue
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        if not header:
            if cells != ["rate", "steps_per_s_12mhz"]:
                raise ValueError(f"{source}:{number}: the header must be rate,steps_per_s_12mhz")
            header = True
            continue
        rows.append(_row(cells, rows, f"{source}:{number}"))
    if len(rows) != RATES:
        raise ValueError(f"{source}: {len(rows)} rates, the table has {RATES} (0..255)")
    return RateTable(tuple(value for _, value in rows), source, stand_in)


def _row(cells: list[str], before: list[tuple[int, float]], place: str) -> tuple[int, float]:
    try:
        index, value = int(cells[0]), float(cells[1])
        if len(cells) != 2:
            raise IndexError
    except (ValueError, IndexError):
        raise ValueError(f"{place}: not a rate and a number of steps/s: {','.join(cells)}") from None
    if index != len(before):
        raise ValueError(f"{place}: rate {index} where {len(before)} comes next")
    if not 0 < value < 1e6 or (before and value <= before[-1][1]):
        raise ValueError(f"{place}: the rates must be above 0 and ascend")
    return index, value
