"""Arrays and texts as blocks of a page: quantised, differenced, bytes sorted by weight, compressed, base64.

The page undoes it with what browsers have built in (``DecompressionStream``), outside its main thread. A million
samples of a smooth path need about two bytes a number this way.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

LEVEL = 6
MOST_STEPS = 2**29
Array = npt.NDArray[Any]


@dataclass(slots=True)
class Block:
    """Arrays that are decoded together. ``add`` gives each a name; ``manifest`` tells the page how to read them."""

    name: str
    manifest: list[dict[str, Any]] = field(default_factory=list)
    _data: list[bytes] = field(default_factory=list)

    def add(self, name: str, values: Array, unit: float = 1.0) -> None:
        """An array, rounded to multiples of ``unit`` (coarser where 30 bits demand it)."""
        flat = np.asarray(values, dtype=np.float64).ravel()
        most = float(np.abs(flat).max(initial=0.0))
        unit = max(unit, most / MOST_STEPS)
        whole = np.rint(flat / unit).astype(np.int32)
        self.manifest.append({"name": name, "length": len(whole), "unit": unit})
        self._data.append(shuffled(whole))

    def columns(self, name: str, values: Array, unit: float) -> None:
        """A two-dimensional array, one array a column: ``name0``, ``name1``, ..."""
        for k in range(values.shape[1]):
            self.add(f"{name}{k}", values[:, k], unit)

    def html(self) -> str:
        """The block as elements of a page."""
        head = json.dumps(self.manifest, separators=(",", ":"))
        return (
            f'<script type="application/json" id="{self.name}-manifest">{head}</script>\n'
            f'<script type="application/octet-stream" id="{self.name}">{packed(b"".join(self._data))}</script>\n'
        )


def shuffled(whole: npt.NDArray[np.int32]) -> bytes:
    """Differences of int32, folded to unsigned, first all lowest bytes, then the next: what repeats stands together."""
    step = np.diff(whole.astype(np.int64), prepend=0)
    folded = np.where(step < 0, -2 * step - 1, 2 * step).astype(np.uint32)
    return np.ascontiguousarray(folded.view(np.uint8).reshape(-1, 4).T).tobytes() if len(folded) else b""


def packed(data: bytes) -> str:
    """gzip and base64, the same text for the same data."""
    return base64.b64encode(gzip.compress(data, LEVEL, mtime=0)).decode("ascii")


def text_block(name: str, text: str) -> str:
    """A text as element of a page."""
    return f'<script type="application/octet-stream" id="{name}">{packed(text.encode("utf-8"))}</script>\n'


def json_block(name: str, data: Mapping[str, Any]) -> str:
    """JSON as element of a page; no text in it can end the element."""
    words = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return f'<script type="application/json" id="{name}">{words}</script>\n'
