"""Offset curves cut where they come too near to the contour, and the stretches of them that follow one another."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gcode.arcgeometry import Point
from gcode.contour import Contour, Curve, crossings


@dataclass(frozen=True, slots=True)
class Piece:
    """An offset curve, or an arc about a corner.

    ``before``, ``after``: the program coordinates of all axes at its ends.
    ``move``: which curve of the contour it is the offset of, from 1; 0 for an arc about a corner and for the entry.
    """

    kind: str
    line: int
    curve: Curve
    before: tuple[float, ...]
    after: tuple[float, ...]
    feed_mm_s: float
    move: int

    def others(self, part: float) -> list[float]:
        """All axes at ``part`` of it; those of the plane are meaningless."""
        return [a + (b - a) * part for a, b in zip(self.before, self.after, strict=True)]


@dataclass(frozen=True, slots=True)
class Stretch:
    """The stretch of piece ``piece`` (an index) between two cuts."""

    piece: int
    begin: float
    end: float
    first: Point
    last: Point


def whole(index: int, piece: Piece) -> Stretch:
    """All of a piece."""
    return Stretch(index, 0.0, 1.0, piece.curve.start, piece.curve.end)


def free_stretches(pieces: list[Piece], contour: Contour, tool: float, slack: float) -> Iterator[Stretch]:
    """The stretches between cuts whose middle is no nearer to the contour than the tool's radius."""
    for index, piece in enumerate(pieces):
        curve = piece.curve
        if curve.is_arc:
            (x, y), r = curve.center, curve.radius
            low, high = (x - r, y - r), (x + r, y + r)
        else:
            low = (min(curve.start[0], curve.end[0]), min(curve.start[1], curve.end[1]))
            high = (max(curve.start[0], curve.end[0]), max(curve.start[1], curve.end[1]))
        among = contour.near(low, high, tool * (1.0 + 1e-9))
        cuts = np.sort(np.concatenate(([0.0, 1.0], crossings(curve, contour, among, tool, pieces[0].curve))))
        cuts = np.append(cuts[:-1][np.diff(cuts) * curve.length > slack], 1.0)
        cuts = np.concatenate(([0.0], cuts[1:])) if len(cuts) > 1 else np.array([0.0, 1.0])
        middles = np.array([curve.at((a + b) / 2.0) for a, b in pairwise(cuts)])
        points = [curve.at(float(cut)) for cut in cuts]
        for at in np.flatnonzero(contour.distances(middles, among) >= tool - slack):
            yield Stretch(index, float(cuts[at]), float(cuts[at + 1]), points[at], points[at + 1])


def successors(free: list[Stretch], tolerance: float) -> list[int]:
    """For each stretch the one that follows it, -1 for none.

    Of those that begin where it ends and come later, the one from which most of the program can be reached; of equals
    the next.
    """
    cell = 4.0 * tolerance
    begins: dict[tuple[int, int], list[int]] = defaultdict(list)
    after, reach = [-1] * len(free), list(range(len(free)))
    for at in range(len(free) - 1, -1, -1):
        x, y = free[at].last
        column, row = round(x / cell), round(y / cell)
        best = -1
        for key in ((column + i, row + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
            for other in begins.get(key, ()):
                near = math.dist(free[other].first, (x, y)) <= tolerance
                if near and (best < 0 or (reach[other], -other) > (reach[best], -best)):
                    best = other
        if best >= 0:
            after[at], reach[at] = best, reach[best]
        begin = free[at].first
        begins[round(begin[0] / cell), round(begin[1] / cell)].append(at)
    return after


def joined(kept: list[Stretch]) -> Iterator[Stretch]:
    """Stretches that continue one another on the same piece are one."""
    open_: Stretch | None = None
    for stretch in kept:
        if open_ is not None and open_.piece == stretch.piece and open_.end == stretch.begin:
            open_ = Stretch(open_.piece, open_.begin, stretch.end, open_.first, stretch.last)
            continue
        if open_ is not None:
            yield open_
        open_ = stretch
    if open_ is not None:
        yield open_
