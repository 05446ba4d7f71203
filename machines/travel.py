"""Soft limits: every move of a program against the machine's travel, before anything moves.

The check is on the programmed path: end points, and of arcs the extreme points of their sweep. Blending stays inside
the corners it rounds, so a path that passes here passes as planned.

A file that runs out of travel does so on many lines. What is reported is one finding for each axis and side: the first
line, how many moves, and the farthest.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from gcode.canon import (
    AXES,
    KIND_ARC,
    ORIGIN,
    PLANES,
    Arc,
    Command,
    Feed,
    MoveBlock,
    Nurbs,
    Plane,
    Position,
    Probe,
    Rapid,
    RigidTap,
    TiltedArc,
)
from machines.programmed import tilted_points

Travel = Mapping[str, tuple[float, float]]
SLACK = 1e-6
"""mm or degrees by which rounding may pass a limit."""

_PLANE_AXES: dict[Plane, tuple[int, int]] = {"XY": (0, 1), "ZX": (2, 0), "YZ": (1, 2)}


@dataclass(slots=True)
class Excess:
    """One axis beyond one side of its travel. ``axis`` missing on the machine: ``limit`` is None."""

    axis: str
    limit: float | None
    line: int
    moves: int
    farthest: float
    farthest_line: int


@dataclass(frozen=True, slots=True)
class Bounds:
    """Least and greatest coordinate of each axis over the moves of a program; the start counts only if it is passed."""

    least: Position
    greatest: Position


Reach = tuple[int, int, float, float, bool]
"""Source line, axis index, least and greatest coordinate, and whether the move is straight."""


def reach(commands: Iterable[Command | MoveBlock], start: Position = ORIGIN) -> Iterator[Reach]:
    """How far each move takes each axis that it moves, in program order."""
    here = start
    for command in commands:
        if isinstance(command, MoveBlock):
            yield from _block_reach(command, here)
            here = _block_end(command, here)
        elif isinstance(command, TiltedArc):
            points = np.vstack((here, tilted_points(here, command)))
            for axis, (least, greatest) in enumerate(zip(points.min(axis=0), points.max(axis=0), strict=True)):
                if least != greatest:
                    yield command.line, axis, float(least), float(greatest), False
            here = command.end
        elif isinstance(command, Rapid | Feed | Arc | Probe | RigidTap | Nurbs):
            low, high = list(map(min, here, command.end)), list(map(max, here, command.end))
            if isinstance(command, Arc):
                first, second = _PLANE_AXES[command.plane]
                for axis, extreme in _arc_extremes(command, here[first], here[second]):
                    low[axis], high[axis] = min(low[axis], extreme), max(high[axis], extreme)
            elif isinstance(command, Nurbs):
                for axis in (0, 1):  # the curve lies inside the hull of its control points
                    places = [point[axis] for point in command.points]
                    low[axis], high[axis] = min([low[axis], *places]), max([high[axis], *places])
            for axis in range(len(AXES)):
                if low[axis] != high[axis]:
                    yield command.line, axis, low[axis], high[axis], not isinstance(command, Arc | Nurbs)
            here = command.end


def bounds(commands: Iterable[Command | MoveBlock], start: Position = ORIGIN) -> Bounds:
    """Extent of a program's moves; axes that never move stay at the start."""
    low, high = list(start), list(start)
    moved: set[int] = set()
    for _, axis, least, greatest, straight in reach(commands, start):
        if axis not in moved and straight:
            moved.add(axis)
            low[axis] = least if least != start[axis] else greatest
            high[axis] = greatest if greatest != start[axis] else least
            continue
        moved.add(axis)
        low[axis], high[axis] = min(low[axis], least), max(high[axis], greatest)
    return Bounds(_position(low), _position(high))


def check_travel(commands: Iterable[Command | MoveBlock], travel: Travel, start: Position = ORIGIN) -> list[Excess]:
    """Every axis and side that a program takes beyond ``travel``, in the order in which they happen."""
    found: dict[tuple[int, int], Excess] = {}
    commands = tuple(commands)
    if _surely_inside(commands, travel, start):
        return []
    for line, axis, least, greatest, _ in reach(commands, start):
        limits = travel.get(AXES[axis])
        if limits is None:
            _note(found, (axis, 0), None, line, greatest)
            continue
        if least < limits[0] - SLACK:
            _note(found, (axis, -1), limits[0], line, least)
        if greatest > limits[1] + SLACK:
            _note(found, (axis, 1), limits[1], line, greatest)
    return list(found.values())


def _surely_inside(commands: tuple[Command | MoveBlock, ...], travel: Travel, start: Position) -> bool:
    """Of a program of straight moves its ends say whether it stays inside; False if a closer look is needed."""
    ends = [start]
    for command in commands:
        if isinstance(command, Rapid | Feed):
            ends.append(command.end)
        elif isinstance(command, MoveBlock | Arc | TiltedArc | Probe | RigidTap | Nurbs):
            return False
    places = np.array(ends)
    for axis, least, greatest in zip(AXES, places.min(axis=0).tolist(), places.max(axis=0).tolist(), strict=True):
        limits = travel.get(axis)
        inside = least == greatest if limits is None else limits[0] <= least and greatest <= limits[1]
        if not inside:
            return False
    return True


def offset_that_fits(extent: Bounds, travel: Travel) -> dict[str, float] | None:
    """Shift of each axis that brings ``extent`` inside ``travel``, in whole mm where that fits; None: it is larger."""
    shift: dict[str, float] = {}
    for axis, (least, greatest) in travel.items():
        low, high = extent.least[AXES.index(axis)], extent.greatest[AXES.index(axis)]
        if high - low > greatest - least + SLACK:
            return None
        up, down = max(least - low, 0.0), min(greatest - high, 0.0)
        exact, whole = up or down, float(math.ceil(up) or math.floor(down))
        shift[axis] = whole if least <= low + whole and high + whole <= greatest else exact
    return shift


def _note(
    found: dict[tuple[int, int], Excess], key: tuple[int, int], limit: float | None, line: int, place: float
) -> None:
    excess = found.get(key)
    if excess is None:
        found[key] = Excess(AXES[key[0]], limit, line, 1, place, line)
        return
    excess.moves += 1
    if limit is not None and abs(place - limit) > abs(excess.farthest - limit):
        excess.farthest, excess.farthest_line = place, line


def _arc_extremes(arc: Arc, first: float, second: float) -> Iterator[tuple[int, float]]:
    """Where an arc crosses the axes through its centre: (axis index, coordinate)."""
    axis_1, axis_2 = _PLANE_AXES[arc.plane]
    x, y = first - arc.center[0], second - arc.center[1]
    radius = math.hypot(x, y)
    begin = math.atan2(y, x)
    end = math.atan2(arc.end[axis_2] - arc.center[1], arc.end[axis_1] - arc.center[0])
    sweep = (end - begin) % math.tau if arc.turns > 0 else (begin - end) % math.tau
    if sweep < 1e-9 or abs(arc.turns) > 1:
        sweep = math.tau
    for quarter in range(4):
        angle = quarter * math.pi / 2
        ahead = (angle - begin) % math.tau if arc.turns > 0 else (begin - angle) % math.tau
        if ahead <= sweep:
            axis, center = (axis_1, arc.center[0]) if quarter % 2 == 0 else (axis_2, arc.center[1])
            yield axis, center + (radius if quarter < 2 else -radius)


def _block_reach(block: MoveBlock, here: Position) -> Iterator[Reach]:
    columns = [AXES.index(axis) for axis in block.axes]
    start = np.vstack(([here[column] for column in columns], block.end[:-1]))
    low, high = np.minimum(start, block.end), np.maximum(start, block.end)
    for row in np.flatnonzero(block.kind == KIND_ARC):
        plane = PLANES[int(block.plane[row])]
        at = _full(here, columns, start[row])
        center = (float(block.center[row, 0]), float(block.center[row, 1]))
        end = _full(here, columns, block.end[row])
        arc = Arc(int(block.line[row]), end, center, plane, int(block.turns[row]), 0.0)
        first, second = _PLANE_AXES[plane]
        for axis, extreme in _arc_extremes(arc, at[first], at[second]):
            if axis in columns:
                column = columns.index(axis)
                low[row, column] = min(low[row, column], extreme)
                high[row, column] = max(high[row, column], extreme)
    for row, column in np.argwhere(low != high):
        straight = bool(block.kind[row] != KIND_ARC)
        yield int(block.line[row]), columns[column], float(low[row, column]), float(high[row, column]), straight


def _block_end(block: MoveBlock, here: Position) -> Position:
    if not len(block):
        return here
    return _full(here, [AXES.index(axis) for axis in block.axes], block.end[-1])


def _full(here: Position, columns: list[int], values: Iterable[float]) -> Position:
    place = list(here)
    for column, value in zip(columns, values, strict=True):
        place[column] = float(value)
    return _position(place)


def _position(values: list[float]) -> Position:
    x, y, z, a, b, c, u, v, w = values
    return x, y, z, a, b, c, u, v, w
