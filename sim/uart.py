"""Asynchronous bytes: 1 start bit, 8 data bits, 1 stop bit, no parity (both data sheets, communications sections).

The chips' rate is 20 MHz / (16 (BRD + 1)), SPBRG with BRGH = 1; with BRD 10 that is 113 636 baud, not 115 200. A
receiver whose rate differs by at most 4 % reads every byte; beyond that it samples the line at its own pace and sees
what the line happens to carry.
"""

from __future__ import annotations

from collections.abc import Sequence

BITS_PER_BYTE = 10
TOLERANCE = 0.04
POWER_UP_BRD = 63  # 19 531 baud, the sheets' 19 200


def chip_baud(brd: int, ppb: int = 0) -> float:
    """True rate in baud of a 20 MHz chip whose crystal is ``ppb`` parts in 10^9 fast."""
    return 20e6 * (1 + ppb * 1e-9) / (16 * (brd + 1))


def byte_ns(baud: float) -> float:
    """Time in ns that one byte takes on the wire."""
    return BITS_PER_BYTE * 1e9 / baud


def readable(sender_baud: float, receiver_baud: float) -> bool:
    """Whether a receiver at one rate reads bytes sent at the other."""
    return abs(sender_baud / receiver_baud - 1) <= TOLERANCE


def arrivals_ns(start_ns: float, count: int, baud: float) -> list[int]:
    """Ends in ns of ``count`` bytes sent one after another from ``start_ns``."""
    width = BITS_PER_BYTE * 1e9 / baud
    return [int(start_ns + width * (i + 1)) for i in range(count)]


def misread(data: Sequence[int], start_ns: int, sender_baud: float, receiver_baud: float) -> list[tuple[int, int]]:
    """What a receiver at a wrong rate takes ``data`` for: (time in ns, value) of every byte it believes to see.

    The line is idle (high) before and after. Each start edge begins a frame whose bits are sampled in the middle of
    the receiver's own bit times; the next frame may begin after the middle of the stop bit. All of them count as
    framing errors, because the rates differ by more than the tolerance.
    """
    bit = 1e9 / sender_baud
    own = 1e9 / receiver_baud
    levels = [b for value in data for b in (0, *((value >> i) & 1 for i in range(8)), 1)]

    def level(at_ns: float) -> int:
        index = int(at_ns // bit)
        return levels[index] if 0 <= index < len(levels) else 1

    seen: list[tuple[int, int]] = []
    position = 0
    while position < len(levels):
        if levels[position]:
            position += 1
            continue
        edge = position * bit
        value = sum(level(edge + (1.5 + i) * own) << i for i in range(8))
        seen.append((int(start_ns + edge + BITS_PER_BYTE * own), value))
        position = max(position + 1, int((edge + 9.5 * own) // bit) + 1)
        # a frame that ends inside a low stretch needs the line to rise before the next start edge
        while position < len(levels) and not levels[position - 1] and not levels[position]:
            position += 1
    return seen
