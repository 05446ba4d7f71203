"""Cutter compensation with trimmed corners: where the tool does not fit, the path is cut short instead of refused.

All moves between G41 or G42 and G40 are held back. Their offsets are laid out one after another, outside corners as
arcs about the corner, and cut wherever the distance to any curve of the contour can pass the tool's radius. What lies
too near is dropped; what is left is strung together from the entry on, in the order of the program:

    offsets        1----->X----->          X: where the offsets of two lines meet
                          :2    :3
    kept           1----->X3----->         2 and the two ends beyond X lie nearer to the contour than the radius
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from gcode.arcgeometry import Point, swept
from gcode.canon import Command
from gcode.contour import Contour, Curve, arc, line, offset
from gcode.errors import GcodeError
from gcode.pending import Pending, Queue
from gcode.stretches import Piece, Stretch, free_stretches, joined, successors, whole

MOST_MOVES = 20_000
"""Moves that are held back at most: their number bounds memory and time."""
SAME_POINT_MM = 1e-6
TOO_NEAR_MM = 1e-7
CORNER_STEP = math.radians(5.0)
"""A rapid goes round an outside corner in straight moves of this angle."""


def _no_warning(*_words: str) -> None:
    """Nobody listens."""


@dataclass(slots=True)
class TrimQueue(Queue):
    """A queue that holds a whole contour. ``tool``: radius in program units, ``side``: +1 left, -1 right."""

    tool: float = 0.0
    side: int = 1
    warn: Callable[..., None] = _no_warning
    pieces: list[Piece] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    heading: Point | None = None
    rest: tuple[float, ...] = ()

    def hold(self, move: Pending) -> None:
        """The entry: a move that ends beside the contour, or one in place (of lathe tools)."""
        first, second, _ = self.axes
        stop: Point = (move.end[first], move.end[second])
        self.emit.held = self.moves
        self.rest = tuple(self.emit.state.position)
        if self.start is None or self.start == stop:
            self.moves.append(move)
            return
        if move.kind == "arc":
            sweep = swept(self.start, stop, move.center, move.turns)
            curve = arc(self.start, stop, move.center, sweep)
        else:
            curve = line(self.start, stop)
        self._add(move.kind, curve, move.end, move.feed_mm_s, 0)
        self.heading = curve.heading(1.0)

    def straight(self, kind: str, corner: Point, end: list[float], feed_mm_s: float) -> None:
        """A straight move of the contour from ``corner``; in place it is kept for its other axes."""
        first, second, _ = self.axes
        goal: Point = (end[first], end[second])
        if goal == corner:
            self.moves.append(Pending(kind, self.emit.line, list(end), feed_mm_s))
            self.rest = tuple(end)
            return
        self._follow(kind, line(corner, goal), end, feed_mm_s)

    def arc(self, corner: Point, end: list[float], center: Point, turns: int, feed_mm_s: float) -> None:
        """An arc of the contour from ``corner``."""
        first, second, _ = self.axes
        goal: Point = (end[first], end[second])
        curve = arc(corner, goal, center, swept(corner, goal, center, turns))
        self._follow("arc", curve, end, feed_mm_s)

    def beside(self, end: list[float]) -> list[float]:
        """Where the tool's centre is at the programmed ``end``, square to the path, before anything is trimmed."""
        first, second, _ = self.axes
        place = list(end)
        if self.heading is not None:
            place[first] -= self.side * self.tool * self.heading[1]
            place[second] += self.side * self.tool * self.heading[0]
        return place

    def end_at(self, point: Point, line: int) -> None:
        """The end of the contour: trims it and emits what is left. GC091, GC092 if there is no way for the tool."""
        self.release()
        self.start = None

    def release(self) -> None:
        """As ``end_at``."""
        moves, self.moves, self.emit.held = self.moves, [], None
        pieces, curves, numbers = self.pieces, self.curves, self.numbers
        self.pieces, self.curves, self.numbers, self.heading = [], [], [], None
        kept = self._strung(pieces, curves, numbers) if curves else [whole(i, piece) for i, piece in enumerate(pieces)]
        self._emit_all(moves, pieces, kept)

    def _add(self, kind: str, curve: Curve, end: list[float], feed_mm_s: float, move: int) -> None:
        piece = Piece(kind, self.emit.line, curve, self.rest, tuple(end), feed_mm_s, move)
        self.pieces.append(piece)
        self.moves.append(piece)
        self.rest = piece.after

    def _follow(self, kind: str, curve: Curve, end: list[float], feed_mm_s: float) -> None:
        """Adds a curve of the contour: its offset, and the arc about the corner before it if that is an outside one."""
        if len(self.curves) >= MOST_MOVES:
            raise GcodeError(
                "GC092", f"more than {MOST_MOVES} moves under compensation", "end it with G40 in between", "motion"
            )
        join = None if self.heading is None else self._corner(self.heading, curve)
        if join is not None:
            self._add(kind, join, list(self.rest), feed_mm_s, 0)
        self.curves.append(curve)
        self.numbers.append(self.emit.line)
        beside = offset(curve, self.tool, self.side)
        if beside is not None:
            self._add(kind, beside, end, feed_mm_s, len(self.curves))
        self.rest = tuple(end)
        self.heading = curve.heading(1.0)

    def _corner(self, before: Point, curve: Curve) -> Curve | None:
        """The arc about an outside corner."""
        after = curve.heading(0.0)
        turn = before[0] * after[1] - before[1] * after[0]
        straight = before[0] * after[0] + before[1] * after[1]
        angle = math.atan2(abs(turn), straight)
        if angle < 1e-9 or (self.side * turn > 0.0 and math.pi - angle > 1e-9):
            return None
        corner, reach = curve.start, self.side * self.tool
        start = (corner[0] - reach * before[1], corner[1] + reach * before[0])
        stop = (corner[0] - reach * after[1], corner[1] + reach * after[0])
        return arc(start, stop, corner, -self.side * angle)

    def _strung(self, pieces: list[Piece], curves: list[Curve], numbers: list[int]) -> list[Stretch]:
        """The stretches that the tool can follow, from the entry on."""
        unit = self.emit.state.unit_mm
        contour = Contour(curves)
        free = list(free_stretches(pieces, contour, self.tool, TOO_NEAR_MM / unit))
        if not free or free[0].piece != 0 or free[0].begin != 0.0:
            raise GcodeError(
                "GC091",
                f"the entry move of line {pieces[0].line} begins nearer to the contour than the tool radius",
                "start further away, or use a smaller tool (D)",
                "motion",
            )
        after = successors(free, SAME_POINT_MM / unit)
        at = 0
        way = [free[0]]
        while after[at] >= 0:
            at = after[at]
            way.append(free[at])
        lost = [s for s in free[at + 1 :] if pieces[s.piece].curve.length * (s.end - s.begin) > 1e-3 / unit]
        if lost:
            here = pieces[free[at].piece]
            there = numbers[contour.nearest(free[at].last, without=here.move - 1)]
            raise GcodeError(
                "GC092",
                f"the tool cannot go on: its way along line {here.line} cuts into the contour of line {there}",
                "use a smaller tool (D), another entry, or end compensation with G40 in between",
                "motion",
            )
        self._tell_trimmed([pieces[stretch.piece] for stretch in way], numbers)
        return way

    def _tell_trimmed(self, way: list[Piece], numbers: list[int]) -> None:
        """Warns of curves of the contour that the tool does not follow at all."""
        followed = [0, *sorted({piece.move for piece in way if piece.move}), len(numbers) + 1]
        lines = [way[0].line, *numbers, self.emit.line]
        for before, after in pairwise(followed):
            if after > before + 1:
                self.warn(
                    "GC219",
                    f"the tool does not fit between line {lines[before]} and line {lines[after]}: the path is trimmed",
                    "use a smaller tool (D) where the whole contour is wanted",
                    "g",
                )

    def _emit_all(self, moves: list[Any], pieces: list[Piece], kept: list[Stretch]) -> None:
        """Emits the stretches; what waits between the moves comes when its place is reached."""
        here: Point = self.start or (0.0, 0.0)
        waiting = iter(moves)
        for stretch in joined(kept):
            piece = pieces[stretch.piece]
            for other in waiting:
                if other is piece:
                    break
                self._emit_other(other, here)
            here = stretch.last
            self._emit_stretch(piece, stretch)
        for other in waiting:
            self._emit_other(other, here)

    def _emit_other(self, other: Pending | Command | Piece, here: Point) -> None:
        """A move in place at ``here``, or a command; a piece of which nothing is left gives nothing."""
        if isinstance(other, Pending):
            other.end[self.axes[0]], other.end[self.axes[1]] = here
            self._emit(other)
        elif isinstance(other, Command):
            self.emit.command(other)

    def _emit_stretch(self, piece: Piece, stretch: Stretch) -> None:
        first, second, _ = self.axes
        curve = piece.curve
        sweep = curve.sweep * (stretch.end - stretch.begin)
        end = piece.others(stretch.end)
        end[first], end[second] = stretch.last
        size = curve.length * (stretch.end - stretch.begin)
        if not curve.is_arc or size < 1e-4 / self.emit.state.unit_mm:
            self._emit(Pending("feed" if piece.kind == "arc" else piece.kind, piece.line, end, piece.feed_mm_s))
        elif piece.kind == "rapid":
            for corner in _around(curve, stretch.begin, sweep):
                on_the_way = list(end)
                on_the_way[first], on_the_way[second] = corner
                self._emit(Pending("rapid", piece.line, on_the_way, piece.feed_mm_s))
            self._emit(Pending("rapid", piece.line, end, piece.feed_mm_s))
        else:
            turns = int(math.copysign(max(1, math.ceil(abs(sweep) / (2.0 * math.pi) - 1e-9)), sweep))
            self._emit(Pending("arc", piece.line, end, piece.feed_mm_s, center=curve.center, turns=turns))


def _around(curve: Curve, begin: float, sweep: float) -> Iterator[Point]:
    """The corners of straight lines that touch the arc from outside."""
    count = math.ceil(abs(sweep) / CORNER_STEP)
    step = sweep / count
    radius = curve.radius / math.cos(step / 2.0)
    for index in range(count):
        angle = curve.begin + begin * curve.sweep + (index + 0.5) * step
        yield curve.center[0] + radius * math.cos(angle), curve.center[1] + radius * math.sin(angle)
