"""Columns of moves: the form in which the path stage eats a program, thousands of moves at a time."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from gcode import canon
from gcode.canon import Command
from planner.types import F8, I4

MODE_EXACT_STOP, MODE_EXACT_PATH, MODE_CONTINUOUS, MODE_CURVE = 0, 1, 2, 3
"""What holds at the end of a move: rest, the exact vertex, a blend within tolerance, or a joint inside one curve."""
KIND_RAPID, KIND_FEED, KIND_ARC = canon.KIND_RAPID, canon.KIND_FEED, canon.KIND_ARC


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """N moves in columns over A planned axes.

    start: f8[A]. rest_first: the axes rest before the first move. kind: u1[N]. line: i4[N]. end: f8[N, A], mm and
    degrees. feed_mm_s: f8[N], inf of rapids. plane: u1[N]; center: f8[N, 2]; turns: i4[N], of arcs. mode: u1[N],
    tolerance_mm: f8[N], merge_mm: f8[N] (0: none) of the junction at the move's end. stop: bool[N], rest at the
    move's end.
    """

    start: F8
    rest_first: bool
    kind: npt.NDArray[np.uint8]
    line: I4
    end: F8
    feed_mm_s: F8
    plane: npt.NDArray[np.uint8]
    center: F8
    turns: I4
    mode: npt.NDArray[np.uint8]
    tolerance_mm: F8
    merge_mm: F8
    stop: npt.NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.kind)

    def begin(self) -> F8:
        """Where each move starts, f8[N, A]."""
        return np.concatenate([self.start[None, :], self.end[:-1]]) if len(self) else self.end

    def part(self, first: int, last: int) -> Moves:
        """Moves first .. last - 1."""
        if first == 0 and last == len(self):
            return self
        start = self.end[first - 1] if first else self.start
        rest = bool(self.stop[first - 1]) if first else self.rest_first
        columns = {name: getattr(self, name)[first:last] for name in COLUMNS}
        return Moves(start, rest, **columns)


COLUMNS = tuple(f.name for f in fields(Moves) if f.name not in ("start", "rest_first"))


def no_moves(start: F8, rest_first: bool = True) -> Moves:
    """A batch of no moves at ``start``."""
    u1, f8, i4 = np.zeros(0, np.uint8), np.zeros(0), np.zeros(0, np.int32)
    none, end = np.zeros(0, np.bool_), np.zeros((0, len(start)))
    return Moves(start, rest_first, u1, i4, end, f8, u1, np.zeros((0, 2)), i4, u1, f8, f8, none)


def join(parts: list[Moves]) -> Moves:
    """One batch of consecutive batches; a later ``rest_first`` becomes a stop of the move before it."""
    parts = [p for k, p in enumerate(parts) if len(p) or k == 0 or p.rest_first]
    if len(parts) == 1:
        return parts[0]
    columns = {name: np.concatenate([getattr(p, name) for p in parts]) for name in COLUMNS}
    out = Moves(parts[0].start, parts[0].rest_first, **columns)
    at = len(parts[0])
    for p in parts[1:]:
        if p.rest_first and at == 0:
            out = replace(out, rest_first=True)
        elif p.rest_first:
            out.stop[at - 1] = True
        at += len(p)
    return out


@dataclass(frozen=True, slots=True)
class Mark:
    """``command`` happens after ``moves`` moves of its batch; ``rest``: the axes stand still for it."""

    moves: int
    command: Command
    rest: bool
