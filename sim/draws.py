"""Uniform random numbers of one stream, drawn in blocks: the same sequence as one by one, at a tenth of the price."""

from __future__ import annotations

import numpy as np

_BLOCK = 1024


class Draws:
    """Numbers uniform in [0, 1) from a seeded generator."""

    __slots__ = ("_block", "_next", "_rng")

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._block: list[float] = []
        self._next = 0

    def unit(self) -> float:
        """The next number in [0, 1)."""
        if self._next == len(self._block):
            self._block = self._rng.random(_BLOCK).tolist()
            self._next = 0
        value = self._block[self._next]
        self._next += 1
        return value

    def below_ns(self, limit_ns: int) -> int:
        """A whole number of ns in [0, limit_ns]."""
        return int(self.unit() * (limit_ns + 1)) if limit_ns > 0 else 0
