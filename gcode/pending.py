"""The look-ahead of cutter compensation: moves whose end the next move still decides.

A compensated move is held back until the next one is known, because an inside corner shortens both. Commands that are
given meanwhile wait behind it, so that the order of things is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from gcode.arcgeometry import Point, swept
from gcode.emit import Emitter
from gcode.errors import GcodeError

ARC_RADII_TOLERANCE = 0.01


@dataclass(slots=True)
class Pending:
    """One held move in program coordinates. ``direction``: of its programmed path, in the plane.

    ``center``, ``turns`` and ``sweep`` (rad, of the uncompensated arc; 0: unknown) belong to arcs.
    """

    kind: str
    line: int
    end: list[float]
    feed_mm_s: float
    direction: Point = (0.0, 0.0)
    center: Point = (0.0, 0.0)
    turns: int = 0
    sweep: float = 0.0


@dataclass(slots=True)
class Queue:
    """Held moves (``Pending``) and, behind each, the commands that wait for it.

    ``start``: where the first held move begins.
    """

    emit: Emitter
    axes: tuple[int, int, int] = (0, 1, 2)
    lathe_shift: tuple[float, float] = (0.0, 0.0)
    moves: list[Any] = field(default_factory=list)
    start: Point | None = None

    def hold(self, move: Pending) -> None:
        """Holds a move back; from now on commands wait too."""
        self.moves.append(move)
        self.emit.held = self.moves

    def front(self) -> Pending | None:
        """The first held move."""
        return next((move for move in self.moves if isinstance(move, Pending)), None)

    def release(self) -> None:
        """Emits everything that is held, as it stands."""
        self.start = None
        self.emit.held = None
        moves, self.moves = self.moves, []
        for move in moves:
            if isinstance(move, Pending):
                self._emit(move)
            else:
                self.emit.command(move)

    def end_at(self, point: Point, line: int) -> None:
        """Moves the end of the held moves to ``point`` and emits them. GC092 if that would reverse one of them."""
        for move in self.moves:
            if isinstance(move, Pending):
                self._trim(move, point, line)
        if self.moves:
            self.release()
            self.start = point

    def _trim(self, move: Pending, point: Point, line: int) -> None:
        first, second, _ = self.axes
        if move.kind == "arc":
            before = math.hypot(move.end[first] - move.center[0], move.end[second] - move.center[1])
            after = math.hypot(point[0] - move.center[0], point[1] - move.center[1])
            if abs(before - after) > ARC_RADII_TOLERANCE:
                raise _gouge(move, line)
            if move.sweep != 0.0 and self.start is not None:
                tolerance = 0.0254 / self.emit.state.unit_mm
                if abs(swept(self.start, point, move.center, move.turns)) > abs(move.sweep) + tolerance:
                    raise _gouge(move, line)
        elif self.start is not None:
            along = move.direction[0] * (point[0] - self.start[0]) + move.direction[1] * (point[1] - self.start[1])
            if along < 0.0:
                raise _gouge(move, line)
        move.end[first], move.end[second] = point

    def _emit(self, move: Pending) -> None:
        first, second, _ = self.axes
        end = list(move.end)
        end[first] += self.lathe_shift[0]
        end[second] += self.lathe_shift[1]
        now, self.emit.line = self.emit.line, move.line
        if move.kind == "rapid":
            self.emit.rapid(end)
        elif move.kind == "feed":
            self.emit.feed(end, move.feed_mm_s)
        else:
            center = (move.center[0] + self.lathe_shift[0], move.center[1] + self.lathe_shift[1])
            self.emit.arc(end, center, move.turns, move.feed_mm_s)
        self.emit.line = now


def _gouge(move: Pending, line: int) -> GcodeError:
    return GcodeError(
        "GC092",
        f"the tool does not fit into the inside corner between line {move.line} and line {line}",
        "use a smaller tool (D), or a wider corner; the moves are shorter than the tool radius demands",
        "motion",
    )
