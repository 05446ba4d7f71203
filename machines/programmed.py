"""The programmed path as a polyline: what the program asks for, before any blending, for the verdict to measure from.

Arcs are cut so finely that their chords stay within ``CHORD_MM`` of them, far below a motor step.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

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
    TiltedArc,
)

CHORD_MM = 2e-4
_PLANE_AXES: dict[Plane, tuple[int, int]] = {"XY": (0, 1), "ZX": (2, 0), "YZ": (1, 2)}


def programmed_path(
    commands: Iterable[Command | MoveBlock], axes: tuple[str, ...], start: Position = ORIGIN
) -> npt.NDArray[np.float64]:
    """Vertices f8[M, A] of a program in mm or degrees over ``axes``, the start included."""
    columns = [AXES.index(axis) for axis in axes]
    parts = [np.array([start])]
    for part in _parts(commands, start):
        parts.append(part)
    path: npt.NDArray[np.float64] = np.concatenate(parts)[:, columns]
    return path


def _parts(commands: Iterable[Command | MoveBlock], start: Position) -> Iterator[npt.NDArray[np.float64]]:
    here = start
    for command in commands:
        if isinstance(command, MoveBlock):
            if len(command):
                part = _block(command, here)
                here = _position(part[-1])
                yield part
        elif isinstance(command, Arc):
            yield arc_points(here, command)
            here = command.end
        elif isinstance(command, TiltedArc):
            yield tilted_points(here, command)
            here = command.end
        elif isinstance(command, Nurbs):
            yield spline_points(here, command)
            here = command.end
        elif isinstance(command, Rapid | Feed | Probe):
            yield np.array([command.end])
            here = command.end


def arc_points(start: Position, arc: Arc) -> npt.NDArray[np.float64]:
    """Points f8[N, 9] of an arc or helix after its start, the end exact; all other axes in proportion to the angle."""
    first, second = _PLANE_AXES[arc.plane]
    x, y = start[first] - arc.center[0], start[second] - arc.center[1]
    end_x, end_y = arc.end[first] - arc.center[0], arc.end[second] - arc.center[1]
    begin, end = math.atan2(y, x), math.atan2(end_y, end_x)
    sign = 1 if arc.turns > 0 else -1
    sweep = (sign * (end - begin)) % math.tau
    if sweep < 1e-9:
        sweep = math.tau
    sweep += (abs(arc.turns) - 1) * math.tau
    radius_0, radius_1 = math.hypot(x, y), math.hypot(end_x, end_y)
    radius = max(radius_0, radius_1, CHORD_MM)
    count = max(2, math.ceil(sweep / (2 * math.acos(1 - min(CHORD_MM / radius, 1.0)))))
    share = np.linspace(0, 1, count + 1)[1:]
    here, there = np.array(start), np.array(arc.end)
    points: npt.NDArray[np.float64] = here + share[:, None] * (there - here)
    angle, r = begin + sign * sweep * share, radius_0 + share * (radius_1 - radius_0)
    points[:, first] = arc.center[0] + r * np.cos(angle)
    points[:, second] = arc.center[1] + r * np.sin(angle)
    points[-1] = there
    return points


def tilted_points(start: Position, arc: TiltedArc) -> npt.NDArray[np.float64]:
    """Points f8[N, 9] of an arc of a turned plane: those of the plane itself, turned about Z."""
    turn = math.radians(arc.rotation_deg)
    back = np.eye(len(AXES))
    back[:2, :2] = [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
    first, second = _PLANE_AXES[arc.plane]
    begin, end, center = (back @ np.array(place) for place in (start, arc.end, arc.center))
    plain = Arc(arc.line, _position(end), (center[first], center[second]), arc.plane, arc.turns, arc.feed_mm_s)
    points: npt.NDArray[np.float64] = arc_points(_position(begin), plain) @ back
    points[-1] = arc.end
    return points


def spline_points(start: Position, spline: Nurbs) -> npt.NDArray[np.float64]:
    """Points f8[N, 9] of a spline, so many that their chords stay as near as those of an arc of its length."""
    from planner.nurbs import evaluate

    control = np.array(spline.points)
    length = float(np.hypot(*np.diff(control[:, :2], axis=0).T).sum())
    count = max(100, math.ceil(40 * length), 40 * len(control))
    end = float(len(control) - spline.order + 1)
    points = np.tile(np.array(start), (count, 1))
    points[:, :2] = evaluate(control, spline.order, np.linspace(0.0, end, count + 1)[1:])
    points[-1] = spline.end
    return points


def _block(block: MoveBlock, here: Position) -> npt.NDArray[np.float64]:
    full = np.tile(np.array(here), (len(block), 1))
    full[:, [AXES.index(axis) for axis in block.axes]] = block.end
    arcs = np.flatnonzero(block.kind == KIND_ARC)
    if not len(arcs):
        return full
    parts: list[npt.NDArray[np.float64]] = []
    done = 0
    for row in arcs.tolist():
        parts.append(full[done:row])
        start = here if row == 0 else _position(full[row - 1])
        center = (float(block.center[row, 0]), float(block.center[row, 1]))
        plane = PLANES[int(block.plane[row])]
        arc = Arc(int(block.line[row]), _position(full[row]), center, plane, int(block.turns[row]), 0.0)
        parts.append(arc_points(start, arc))
        done = row + 1
    parts.append(full[done:])
    return np.concatenate(parts)


def _position(row: npt.NDArray[np.float64]) -> Position:
    x, y, z, a, b, c, u, v, w = (float(value) for value in row)
    return x, y, z, a, b, c, u, v, w
