"""Numbers as the chips' registers hold them."""

from __future__ import annotations

WRAP = 1 << 32


def wrap32(value: int) -> int:
    """A position in the 32-bit two's complement counter of both chips (X-51)."""
    return (value + 0x80000000) % WRAP - 0x80000000
