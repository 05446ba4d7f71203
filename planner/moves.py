"""Canonical commands to columns of moves: what the path stage eats, thousands at a time.

The reader keeps the path mode (G61, G61.1, G64 P Q), turns commands and blocks of the program into one columnar form
over the planned axes, and notes every command that must wait for rest as an event after a number of moves. It knows no
geometry and no time. Source: RS274/NGC, sections 3.5.14 (path control), 4.3 (canonical machining functions).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gcode import canon
from gcode.canon import Command, MoveBlock, PathControl
from planner.errors import PlanError
from planner.types import F8, I4

MODE_EXACT_STOP, MODE_EXACT_PATH, MODE_CONTINUOUS = 0, 1, 2
KIND_RAPID, KIND_FEED, KIND_ARC, KIND_NURBS = canon.KIND_RAPID, canon.KIND_FEED, canon.KIND_ARC, 3
MODES = {"exact_stop": MODE_EXACT_STOP, "exact_path": MODE_EXACT_PATH, "continuous": MODE_CONTINUOUS}
IN_MOTION = (canon.Message, canon.Text)
"""Commands that never stop the axes."""


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """N moves in columns over A planned axes.

    start: f8[A]. kind: u1[N]. line: i4[N]. end: f8[N, A], mm and degrees. feed_mm_s: f8[N], inf of rapids. plane:
    u1[N]; center: f8[N, 2]; turns: i4[N], of arcs. mode: u1[N], tolerance_mm: f8[N], merge_mm: f8[N] of the junction
    at the move's end. stop: bool[N], rest at the move's end. nurbs: of kind KIND_NURBS, by index of the move.
    rest_first: the axes rest before the first move (always so at the start of a program).
    """

    start: F8
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
    nurbs: dict[int, canon.Nurbs] = field(default_factory=dict)
    rest_first: bool = True

    def __len__(self) -> int:
        return len(self.kind)


@dataclass(frozen=True, slots=True)
class Mark:
    """``command`` happens after ``moves`` moves of its batch; ``rest``: the axes stand still for it."""

    moves: int
    command: Command
    rest: bool


@dataclass(slots=True)
class _Columns:
    """Growing columns; a tuple of parts is joined once per batch."""

    kind: list[int] = field(default_factory=list)
    line: list[int] = field(default_factory=list)
    end: list[canon.Position] = field(default_factory=list)
    feed: list[float] = field(default_factory=list)
    plane: list[int] = field(default_factory=list)
    center: list[tuple[float, float]] = field(default_factory=list)
    turns: list[int] = field(default_factory=list)


class MoveReader:
    """Reads commands and blocks, hands out batches of moves with their marks.

    axes: planned axes. start: f8[A]. tolerance_mm: default of G64 P. The reader's position and mode carry over from
    batch to batch, so any split into batches reads the same.
    """

    def __init__(self, axes: tuple[str, ...], start: F8, tolerance_mm: float) -> None:
        self.axes = axes
        self.default_mm = tolerance_mm
        self.position = np.array(start, dtype=np.float64)
        self.mode = MODE_CONTINUOUS
        self.tolerance_mm = tolerance_mm
        self.merge_mm = np.nan
        self._columns_of = [canon.AXES.index(a) for a in axes]
        self._foreign = [k for k in range(len(canon.AXES)) if canon.AXES[k] not in axes]
        self._foreign_at: list[float] | None = None
        self._parts: list[Moves] = []
        self._open = _Columns()
        self._nurbs: dict[int, canon.Nurbs] = {}
        self._count = 0
        self._marks: list[Mark] = []
        self._rest_first = True

    def batches(self, commands: Iterable[Command | MoveBlock], size: int) -> Iterator[tuple[Moves, list[Mark]]]:
        """Batches of about ``size`` moves, the last one shorter (perhaps without any move)."""
        for item in commands:
            self.read(item)
            if self._count >= size:
                yield self.take()
        yield self.take()

    def read(self, item: Command | MoveBlock) -> None:
        """Take one command or block."""
        if isinstance(item, MoveBlock):
            self._block(item)
        elif isinstance(item, canon.Feed):
            self._add(KIND_FEED, item.line, item.end, item.feed_mm_s)
        elif isinstance(item, canon.Rapid):
            self._add(KIND_RAPID, item.line, item.end, np.inf)
        elif isinstance(item, canon.Arc):
            plane = canon.PLANES.index(item.plane)
            self._add(KIND_ARC, item.line, item.end, item.feed_mm_s, plane, item.center, item.turns)
        else:
            self._other(item)

    def take(self) -> tuple[Moves, list[Mark]]:
        """All moves read since the last call."""
        self._close()
        moves = _join(self._parts, self._nurbs, self.position, self._rest_first)
        if len(moves):
            self.position = moves.end[-1].copy()
        marks = self._marks
        self._parts, self._marks, self._nurbs, self._count = [], [], {}, 0
        self._rest_first = False
        return moves, marks

    def _other(self, item: Command) -> None:
        if isinstance(item, PathControl):
            self._close()
            self.mode = MODES[item.mode]
            self.tolerance_mm = self.default_mm if item.tolerance_mm is None else item.tolerance_mm
            self.merge_mm = np.nan if item.merge_mm is None else item.merge_mm
        elif isinstance(item, canon.Nurbs):
            self._nurbs[self._count] = item
            self._add(KIND_NURBS, item.line, item.end, item.feed_mm_s)
        elif isinstance(item, canon.Probe):
            self._rest()
            self._marks.append(Mark(self._count, item, rest=True))
            self._add(KIND_FEED, item.line, item.end, item.feed_mm_s)
            self._rest()
        elif isinstance(item, canon.RigidTap):
            raise PlanError(
                item.line, "", "rigid tapping (G33.1) needs a spindle encoder", "use a floating tap holder with G84"
            )
        else:
            moving = isinstance(item, IN_MOTION) or (isinstance(item, canon.Output) and item.synchronised)
            if not moving:
                self._rest()
            if not isinstance(item, canon.Text):
                self._marks.append(Mark(self._count, item, rest=not moving))

    def _rest(self) -> None:
        """The move read last ends at rest."""
        self._close()
        if self._parts:
            self._parts[-1].stop[-1] = True
        else:
            self._rest_first = True

    def _add(
        self,
        kind: int,
        line: int,
        end: canon.Position,
        feed_mm_s: float,
        plane: int = 0,
        center: tuple[float, float] = (0.0, 0.0),
        turns: int = 0,
    ) -> None:
        c = self._open
        c.kind.append(kind)
        c.line.append(line)
        c.end.append(end)
        c.feed.append(feed_mm_s)
        c.plane.append(plane)
        c.center.append(center)
        c.turns.append(turns)
        self._count += 1

    def _close(self) -> None:
        """Turn the open lists into arrays under the mode that held while they were read."""
        c = self._open
        if not c.kind:
            return
        end = np.array(c.end, dtype=np.float64)
        line = np.array(c.line, dtype=np.int32)
        self._refuse_foreign(end, line)
        self._append(
            np.array(c.kind, dtype=np.uint8),
            line,
            end[:, self._columns_of],
            np.array(c.feed),
            np.array(c.plane, dtype=np.uint8),
            np.array(c.center, dtype=np.float64),
            np.array(c.turns, dtype=np.int32),
        )
        self._open = _Columns()

    def _append(
        self,
        kind: npt.NDArray[np.uint8],
        line: I4,
        end: F8,
        feed_mm_s: F8,
        plane: npt.NDArray[np.uint8],
        center: F8,
        turns: I4,
    ) -> None:
        n = len(kind)
        bad = (kind != KIND_RAPID) & ~(feed_mm_s > 0)
        if bad.any():
            raise PlanError(int(line[bad][0]), "", "feed move with a feed of zero", "program an F word")
        stop = np.full(n, self.mode == MODE_EXACT_STOP)
        self._parts.append(
            Moves(
                self.position,
                kind,
                line,
                end,
                np.where(kind == KIND_RAPID, np.inf, feed_mm_s),
                plane,
                center,
                turns,
                np.full(n, self.mode, dtype=np.uint8),
                np.full(n, self.tolerance_mm),
                np.full(n, self.merge_mm),
                stop,
            )
        )

    def _block(self, block: MoveBlock) -> None:
        self._close()
        if not len(block):
            return
        last = self._parts[-1].end[-1] if self._parts else self.position
        end = np.tile(last, (len(block), 1))
        for column, name in enumerate(block.axes):
            if name in self.axes:
                end[:, self.axes.index(name)] = block.end[:, column]
            elif np.ptp(block.end[:, column]) > 0:
                moved = int(np.flatnonzero(np.diff(block.end[:, column]))[0]) + 1
                raise PlanError(int(block.line[moved]), name, f"axis {name} moves, but the machine has none")
        self._count += len(block)
        self._append(block.kind, block.line, end, block.feed_mm_s, block.plane, block.center, block.turns)

    def _refuse_foreign(self, end: F8, line: I4) -> None:
        """Axes the machine does not have must stay where the program first has them."""
        if not self._foreign:
            return
        if self._foreign_at is None:
            self._foreign_at = [float(end[0, k]) for k in self._foreign]
        for k, at in zip(self._foreign, self._foreign_at, strict=True):
            moved = np.flatnonzero(end[:, k] != at)
            if len(moved):
                name = canon.AXES[k]
                raise PlanError(int(line[moved[0]]), name, f"axis {name} moves, but the machine has none")


def _join(parts: list[Moves], nurbs: dict[int, canon.Nurbs], start: F8, rest_first: bool) -> Moves:
    if len(parts) == 1:
        p = parts[0]
        columns = [getattr(p, name) for name in _COLUMN_NAMES]
    elif parts:
        columns = [np.concatenate([getattr(p, name) for p in parts]) for name in _COLUMN_NAMES]
    else:
        columns = _empty(len(start))
    columns_by_name = dict(zip(_COLUMN_NAMES, columns, strict=True))
    return Moves(start.copy(), nurbs=nurbs, rest_first=rest_first, **columns_by_name)


_COLUMN_NAMES = (
    "kind", "line", "end", "feed_mm_s", "plane", "center", "turns", "mode", "tolerance_mm", "merge_mm", "stop",
)  # fmt: skip


def _empty(axes: int) -> list[Any]:
    u1, f8, i4 = np.zeros(0, np.uint8), np.zeros(0), np.zeros(0, np.int32)
    return [u1, i4, np.zeros((0, axes)), f8, u1, np.zeros((0, 2)), i4, u1, f8, f8, np.zeros(0, np.bool_)]
