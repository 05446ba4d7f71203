"""A program cut at the moves of CY545 axes: what is between them is planned as ever, they are stops of their own.

A CY545 moves by itself and cannot be interpolated, so a command that moves such an axis together with any other is
refused with its line, its axis and the two ways out.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from gcode import canon
from gcode.canon import AXES, KIND_RAPID, Command, MoveBlock, PathControl
from planner.errors import PlanError
from planner.types import F8

SAME = 1e-9
"""mm or degrees: nearer places are the same."""
WAYS_OUT = "split the move: index alone, then cut; or put the axis on an NMC chip (pic-step, pic-servo)"


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """Commands that the other axes do while the CY545 axes stand. start: f8[A], where all axes are before them."""

    commands: list[Command | MoveBlock]
    start: F8


@dataclass(frozen=True, slots=True, eq=False)
class Index:
    """One CY545 axis goes from ``start`` to ``end`` (mm or degrees); feed: cap in units/s, None of a rapid."""

    line: int
    axis: str
    start: float
    end: float
    feed: float | None


Stage = Together | Index


@dataclass(slots=True)
class _Splitter:
    axes: tuple[str, ...]
    alone: tuple[str, ...]
    position: F8
    stages: list[Stage] = field(default_factory=list)
    commands: list[Command | MoveBlock] = field(default_factory=list)
    begin: F8 = field(init=False)
    columns: list[int] = field(init=False)
    mode: PathControl | None = None
    refused: list[PlanError] | None = None
    """Where refusals are gathered; None: the first one is raised."""

    def __post_init__(self) -> None:
        self.begin = self.position.copy()
        self.columns = [AXES.index(axis) for axis in self.axes]

    def command(self, item: Command) -> None:
        if isinstance(item, PathControl):
            self.mode = item
        end = getattr(item, "end", None)
        if not isinstance(end, tuple):
            self.commands.append(item)
            return
        there = np.array(end)[self.columns]
        plain = isinstance(item, canon.Rapid | canon.Feed)
        feed = item.feed_mm_s if isinstance(item, canon.Feed) else None
        if self.move(item.line, there, feed, plain):
            self.commands.append(item)

    def block(self, item: MoveBlock) -> None:
        """Rows between two index moves stay a block."""
        end = np.tile(self.position, (len(item), 1))
        for column, name in enumerate(item.axes):
            if name in self.axes:
                end[:, self.axes.index(name)] = item.end[:, column]
        mine = [self.axes.index(axis) for axis in self.alone]
        before = np.concatenate([self.position[None, mine], end[:-1, mine]])
        moved = np.flatnonzero((np.abs(end[:, mine] - before) > SAME).any(axis=1))
        first = 0
        for row in [*moved.tolist(), len(item)]:
            if row > first:
                self.commands.append(_rows(item, first, row))
                self.position = end[row - 1].copy()
            if row < len(item):
                kind = int(item.kind[row])
                feed = None if kind == KIND_RAPID else float(item.feed_mm_s[row])
                self.move(int(item.line[row]), end[row], feed, kind != canon.KIND_ARC)
            first = row + 1

    def move(self, line: int, there: F8, feed: float | None, plain: bool) -> bool:
        """Go to ``there``: True if no CY545 axis moves, so that the command stays. Raises PlanError."""
        moved = [axis for k, axis in enumerate(self.axes) if abs(there[k] - self.position[k]) > SAME]
        indexed = [axis for axis in moved if axis in self.alone]
        if not indexed:
            self.position = there.copy()
            return True
        axis = indexed[0]
        others = [other for other in moved if other != axis]
        if others or not plain:
            words = f"axis {axis} is on a CY545, which cannot be interpolated"
            error = PlanError(line, axis, words + (f" with {', '.join(others)}" if others else ""), WAYS_OUT)
            if self.refused is None:
                raise error
            self.refused.append(error)
        self.close()
        k = self.axes.index(axis)
        self.stages.append(Index(line, axis, float(self.position[k]), float(there[k]), feed))
        self.position = there.copy()
        self.begin = there.copy()
        return False

    def close(self) -> None:
        """What was read since the last index move is a stage; the path mode goes on into the next one."""
        if self.commands:
            self.stages.append(Together(self.commands, self.begin))
        self.commands = [] if self.mode is None else [self.mode]


def split(
    commands: Iterable[Command | MoveBlock], axes: tuple[str, ...], alone: Sequence[str], start: F8
) -> list[Stage]:
    """The stages of a program. axes: planned; alone: those on CY545s; start: f8[A]. Raises PlanError."""
    splitter = _Splitter(axes, tuple(alone), np.array(start, dtype=np.float64))
    _read(splitter, commands)
    return splitter.stages


def refusals(
    commands: Iterable[Command | MoveBlock], axes: tuple[str, ...], alone: Sequence[str], start: F8
) -> list[PlanError]:
    """Every move of a program that would interpolate a CY545 axis; arguments as of ``split``."""
    splitter = _Splitter(axes, tuple(alone), np.array(start, dtype=np.float64), refused=[])
    _read(splitter, commands)
    return splitter.refused or []


def _read(splitter: _Splitter, commands: Iterable[Command | MoveBlock]) -> None:
    for item in commands:
        if isinstance(item, MoveBlock):
            if len(item):
                splitter.block(item)
        else:
            splitter.command(item)
    splitter.close()


def _rows(block: MoveBlock, first: int, last: int) -> MoveBlock:
    s = slice(first, last)
    return MoveBlock(
        block.axes, block.kind[s], block.line[s], block.end[s], block.feed_mm_s[s], block.plane[s], block.center[s],
        block.turns[s],
    )  # fmt: skip
