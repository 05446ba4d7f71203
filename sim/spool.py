"""A column that grows for hours: its tail in memory, the rest in a temporary file that vanishes with it."""

from __future__ import annotations

import tempfile
import weakref
from array import array
from typing import IO, Any

import numpy as np
import numpy.typing as npt

LIMIT = 1 << 16  # elements in memory before they are written out
KEEP = 1 << 10  # elements that stay: whoever appends may still change the last one


class Spool:
    """Numbers of one type. ``tail`` is the part that is still in memory: append to it, then call ``settle``."""

    def __init__(self, typecode: str) -> None:
        self.tail: array[Any] = array(typecode)
        self.spilled = 0
        self._file: IO[bytes] | None = None

    def __len__(self) -> int:
        return self.spilled + len(self.tail)

    def settle(self) -> None:
        """Write the older part out if there is much of it."""
        if len(self.tail) < LIMIT:
            return
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="trace-")  # noqa: SIM115  # lives as long as the column
            weakref.finalize(self, self._file.close)
        count = len(self.tail) - KEEP
        self.tail[:count].tofile(self._file)
        self._file.flush()
        del self.tail[:count]
        self.spilled += count

    def read(self) -> npt.NDArray[Any]:
        """Everything, in order. The file is mapped, not read, so only what is looked at comes into memory."""
        tail = np.array(self.tail, dtype=self.tail.typecode)
        if self._file is None:
            return tail
        mapped = np.memmap(self._file, dtype=self.tail.typecode, mode="r", shape=(self.spilled,))
        return np.concatenate([mapped, tail])
