"""Plane geometry of arcs, in any unit."""

from __future__ import annotations

import math

Point = tuple[float, float]


def distance(a: Point, b: Point) -> float:
    """Between two points."""
    return math.hypot(a[0] - b[0], a[1] - b[1])


def swept(start: Point, stop: Point, center: Point, turns: int) -> float:
    """The angle of an arc, rad: positive counter-clockwise; a full turn more for each turn beyond the first."""
    alpha = math.atan2(start[1] - center[1], start[0] - center[0])
    beta = math.atan2(stop[1] - center[1], stop[0] - center[0])
    if turns > 0:
        if beta <= alpha:
            beta += 2.0 * math.pi
        return beta - alpha + (turns - 1) * 2.0 * math.pi
    if alpha <= beta:
        alpha += 2.0 * math.pi
    return beta - alpha + (turns + 1) * 2.0 * math.pi


def tool_inside(side: int, turns: int) -> bool:
    """Whether a tool on ``side`` (+1 left, -1 right) of an arc runs on its inner side."""
    return side * turns > 0
