"""Canonical commands to batches of moves.

The reader keeps the path mode (G61, G61.1, G64 P Q), turns commands and blocks of the program into columns over the
planned axes, and notes every command that waits for rest as a mark after a number of moves. It knows no time. Source:
RS274/NGC, sections 3.5.14 (path control) and 4.3 (canonical machining functions).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gcode import canon
from gcode.canon import Command, MoveBlock, PathControl
from planner.errors import PlanError
from planner.moves import (
    KIND_ARC,
    KIND_FEED,
    KIND_RAPID,
    MODE_CONTINUOUS,
    MODE_CURVE,
    MODE_EXACT_PATH,
    MODE_EXACT_STOP,
    Mark,
    Moves,
    join,
    no_moves,
)
from planner.types import F8, I4

MODES = {"exact_stop": MODE_EXACT_STOP, "exact_path": MODE_EXACT_PATH, "continuous": MODE_CONTINUOUS}
IN_MOTION = (canon.Message, canon.Text)
"""Commands that never stop the axes."""
FEED_OVERRIDE = {"DISABLE_FEED_OVERRIDE()": False, "ENABLE_FEED_OVERRIDE()": True}
"""M49 and M50 P0, M48 and M50: where the path reaches one of these, overrides of feed and rapids end or begin again."""


@dataclass(slots=True)
class _Columns:
    """Growing columns of single commands, turned into arrays together."""

    kind: list[int] = field(default_factory=list)
    line: list[int] = field(default_factory=list)
    end: list[canon.Position] = field(default_factory=list)
    feed: list[float] = field(default_factory=list)
    plane: list[int] = field(default_factory=list)
    center: list[tuple[float, float]] = field(default_factory=list)
    turns: list[int] = field(default_factory=list)


def needs_encoder(item: Command | MoveBlock) -> PlanError | None:
    """The refusal of a motion that follows a spindle encoder, which nobody reads here; None of any other command."""
    if isinstance(item, canon.RigidTap):
        hint = "use a floating tap holder with G84"
        return PlanError(item.line, "", "rigid tapping (G33.1) needs a spindle encoder", hint)
    if isinstance(item, canon.SpindleSynch) and item.pitch_mm is not None:
        hint = "mill the thread as a helix (G2 or G3 with Z), or cut it by hand"
        return PlanError(item.line, "", "threads (G33, G76) need a spindle encoder", hint)
    return None


class MoveReader:
    """Reads commands and blocks, hands out batches of moves with their marks.

    axes: planned axes. start: f8[A]. tolerance_mm: default of G64 P. Position and mode carry over from batch to
    batch, so any split into batches reads the same.
    """

    def __init__(self, axes: tuple[str, ...], start: F8, tolerance_mm: float) -> None:
        self.axes = axes
        self.default_mm = tolerance_mm
        self.position = np.array(start, dtype=np.float64)
        self.mode = MODE_CONTINUOUS
        self.tolerance_mm = tolerance_mm
        self.merge_mm = 0.0
        self._columns_of = [canon.AXES.index(a) for a in axes]
        self._foreign = [k for k in range(len(canon.AXES)) if canon.AXES[k] not in axes]
        self._foreign_at: dict[int, float] = {}
        self._parts: list[Moves] = []
        self._open = _Columns()
        self._count = 0
        self._marks: list[Mark] = []
        self._rest_first = True

    def batches(self, commands: Iterable[Command | MoveBlock], size: int) -> Iterator[tuple[Moves, list[Mark]]]:
        """Batches of ``size`` moves or a little more, the last one shorter, perhaps without any move."""
        for item in commands:
            if isinstance(item, MoveBlock):
                for at in range(0, len(item), size):
                    self.read(_rows(item, at, at + size))
                    if self._count >= size:
                        yield self.take()
                continue
            self.read(item)
            if self._count >= size:
                yield self.take()
        yield self.take()

    def read(self, item: Command | MoveBlock) -> None:
        """Take one command or block. Raises PlanError."""
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
        moves = join([no_moves(self.position, self._rest_first), *self._parts])
        if len(moves):
            self.position = moves.end[-1].copy()
        marks = self._marks
        self._parts, self._marks, self._count, self._rest_first = [], [], 0, False
        return moves, marks

    def _other(self, item: Command) -> None:
        if isinstance(item, PathControl):
            self._close()
            self.mode = MODES[item.mode]
            self.tolerance_mm = self.default_mm if item.tolerance_mm is None else item.tolerance_mm
            self.merge_mm = item.merge_mm or 0.0
        elif isinstance(item, canon.Nurbs | canon.TiltedArc):
            self._curve(item)
        elif isinstance(item, canon.Probe):
            self._rest()
            self._marks.append(Mark(self._count, item, rest=True))
            self._add(KIND_FEED, item.line, item.end, item.feed_mm_s)
            self._rest()
        elif isinstance(item, canon.RigidTap | canon.SpindleSynch):
            refused = needs_encoder(item)
            if refused is not None:
                raise refused
        else:
            moving = isinstance(item, IN_MOTION) or (isinstance(item, canon.Output) and item.synchronised)
            if not moving:
                self._rest()
            if not isinstance(item, canon.Text) or item.function in FEED_OVERRIDE:
                self._marks.append(Mark(self._count, item, rest=not moving))

    def _rest(self) -> None:
        """The move read last ends at rest."""
        self._close()
        if self._parts:
            self._parts[-1].stop[-1] = True
        else:
            self._rest_first = True

    def _curve(self, item: canon.Nurbs | canon.TiltedArc) -> None:
        """A curve becomes short feed moves whose inner joints belong together."""
        self._close()
        begin = self._parts[-1].end[-1] if self._parts else self.position
        smooth = True
        if isinstance(item, canon.TiltedArc):
            from planner.tilted import control_points

            end = control_points(item, begin, np.array(item.end)[self._columns_of], self.axes)
        else:
            end, smooth = self._spline(item, begin), item.order > 2
        n = len(end)
        self._count += n
        self._append(
            np.full(n, KIND_FEED, np.uint8), np.full(n, item.line, np.int32), end, np.full(n, item.feed_mm_s),
            np.zeros(n, np.uint8), np.zeros((n, 2)), np.zeros(n, np.int32),
        )  # fmt: skip
        if smooth:
            self._parts[-1].mode[:-1] = MODE_CURVE
            self._parts[-1].stop[:-1] = False

    def _spline(self, item: canon.Nurbs, begin: F8) -> F8:
        from planner.nurbs import polyline

        missing = next((a for a in "XY" if a not in self.axes), None)
        if missing:
            raise PlanError(item.line, missing, f"a spline moves axis {missing}, but the machine has none")
        x, y = self.axes.index("X"), self.axes.index("Y")
        points = polyline(item, (float(begin[x]), float(begin[y])))
        end = np.tile(begin, (len(points), 1))
        end[:, [x, y]] = points
        return end

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
        for k in self._foreign:
            self._refuse_foreign(k, end[:, k], line)
        self._append(
            np.array(c.kind, dtype=np.uint8), line, end[:, self._columns_of], np.array(c.feed, dtype=np.float64),
            np.array(c.plane, dtype=np.uint8), np.array(c.center, dtype=np.float64), np.array(c.turns, dtype=np.int32),
        )  # fmt: skip
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
        feed = np.where(kind == KIND_RAPID, np.inf, feed_mm_s)
        mode, stop = np.full(n, self.mode, dtype=np.uint8), np.full(n, self.mode == MODE_EXACT_STOP)
        merge = np.full(n, self.merge_mm if self.mode == MODE_CONTINUOUS else 0.0)
        tolerance = np.full(n, self.tolerance_mm)
        self._parts.append(
            Moves(self.position, False, kind, line, end, feed, plane, center, turns, mode, tolerance, merge, stop)
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
            else:
                self._refuse_foreign(canon.AXES.index(name), block.end[:, column], block.line)
        self._count += len(block)
        self._append(block.kind, block.line, end, block.feed_mm_s, block.plane, block.center, block.turns)

    def _refuse_foreign(self, axis: int, values: F8, line: I4) -> None:
        """An axis the machine does not have must stay where the program first has it."""
        at = self._foreign_at.setdefault(axis, float(values[0]))
        moved = np.flatnonzero(values != at)
        if len(moved):
            name = canon.AXES[axis]
            raise PlanError(int(line[moved[0]]), name, f"axis {name} moves, but the machine has none")


def _rows(block: MoveBlock, first: int, last: int) -> MoveBlock:
    s = slice(first, last)
    return MoveBlock(
        block.axes, block.kind[s], block.line[s], block.end[s], block.feed_mm_s[s], block.plane[s], block.center[s],
        block.turns[s],
    )  # fmt: skip


def switch_of(command: Command) -> bool | None:
    """True and False where a command allows or forbids overrides of feed and rapids, None elsewhere."""
    return FEED_OVERRIDE.get(command.function) if isinstance(command, canon.Text) else None
