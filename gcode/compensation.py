"""Cutter radius compensation G41, G42 and their .1 forms: the state of it, and straight moves.

The tool runs ``radius`` to the left or right of the programmed path. Outside corners get an arc about the corner,
inside corners are shortened to where the tool touches both paths; a corner into which the tool does not fit is
refused. Everything happens in the plane's two axes (XY or ZX); the third axis follows.

Source: the geometry of LinuxCNC's interpreter (one move of look-ahead), tried against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcode.arcgeometry import Point, tool_inside
from gcode.block import Block
from gcode.codes import COMPENSATION, MODAL_0, g_name
from gcode.emit import PLANE_AXES
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.pending import Pending, Queue
from gcode.setup import Tool

if TYPE_CHECKING:
    from gcode.trimming import TrimQueue

CORNER = 0.05
"""rad: corners flatter than this are no corners."""

SHIFT_FIRST = {2: -1, 7: -1, 3: -1, 1: 1, 5: 1, 4: 1}
SHIFT_SECOND = {2: -1, 6: -1, 1: -1, 3: 1, 8: 1, 4: 1}
"""Lathe tools: where the controlled point lies from the centre of the nose, in radii, by orientation (Z and X)."""


@dataclass(slots=True)
class Compensation:
    """Compensation while it is on. ``side``: +1 left, -1 right. ``programmed``: the end of the last programmed move.

    ``contour``: the queue once more, where it holds the whole contour to trim it.
    """

    side: int
    radius: float
    orientation: int
    queue: Queue
    contour: TrimQueue | None = None
    first: bool = True
    programmed: list[float] | None = None


def switch_on(machine: Machine, block: Block) -> None:
    """G41 to G42.1."""
    code = block.g[COMPENSATION]
    state = machine.state
    name = g_name(code)
    if state.plane not in {170, 180}:
        raise GcodeError("GC093", f"{name} outside the XY and ZX planes", "select G17 or G18 first", "g")
    if state.compensation != 400:
        raise GcodeError("GC090", f"{name} while compensation is on", "end it with G40 first", "g")
    radius, orientation = _radius(machine, block, code)
    side = 1 if code in {410, 411} else -1
    if radius < 0.0:
        radius, side = -radius, -side
    axes = PLANE_AXES[state.plane]
    shift = (0.0, 0.0)
    if state.plane == 180:
        shift = (radius * SHIFT_FIRST.get(orientation, 0), radius * SHIFT_SECOND.get(orientation, 0))
    machine.emit.comment(f"interpreter: cutter radius compensation on {'left' if side > 0 else 'right'}")
    if machine.setup.trim_concave and radius > 0.0:
        from gcode.trimming import TrimQueue

        contour = TrimQueue(machine.emit, axes, shift, tool=radius, side=side, warn=machine.warn)
        machine.compensation = Compensation(side, radius, orientation, contour, contour)
    else:
        machine.compensation = Compensation(side, radius, orientation, Queue(machine.emit, axes, shift))
    state.compensation = code


def _radius(machine: Machine, block: Block, code: int) -> tuple[float, int]:
    """Tool radius in program units and lathe orientation: from D, or of the tool in the spindle."""
    state, words = machine.state, block.words
    name = g_name(code)
    if code in {411, 421}:
        if "d" not in words:
            raise GcodeError("GC025", f"{name} without D", "D is the diameter of the tool", "g")
        if "l" in words and state.plane != 180:
            raise GcodeError("GC093", f"L word with {name} outside G18", "L is the orientation of a lathe tool", "l")
        return words["d"] / 2.0, int(words.get("l", 0.0))
    if "d" in words:
        number = block.whole("d")
        if abs(number - words["d"]) > 1e-4:
            raise GcodeError("GC014", f"D of {name} must be a whole number", f"{name}.1 D takes a diameter", "d")
        if number < 0:
            raise GcodeError("GC015", "a negative tool number", "D is the number of a tool", "d")
        tool = machine.tool(number, "d")
    else:
        tool = machine.tool(state.tool_in_spindle, "g") if state.tool_in_spindle else Tool(0)
    if state.plane != 180 and tool.orientation not in {0, 9}:
        raise GcodeError("GC093", f"{name} with a lathe tool outside G18", "select G18 first", "g")
    return state.from_machine_units(tool.diameter, 0) / 2.0, tool.orientation


def flush(machine: Machine) -> None:
    """Emits what is held, ending at the present compensated point."""
    compensation = machine.compensation
    if compensation is not None and compensation.queue.moves:
        first, second, _ = compensation.queue.axes
        here = (machine.state.position[first], machine.state.position[second])
        compensation.queue.end_at(here, machine.emit.line)


def straight_move(machine: Machine, block: Block, compensation: Compensation, motion: int, end: list[float]) -> None:
    """G0 or G1 under compensation."""
    if block.g.get(MODAL_0) == 530:
        raise GcodeError("GC090", "G53 under cutter compensation", "end it with G40 and a move first", "G53")
    if compensation.first:
        _entry(machine, compensation, motion, end)
    elif compensation.contour is not None:
        kind = "rapid" if motion == 0 else "feed"
        compensation.contour.straight(kind, programmed(compensation), list(end), machine.emit.path_feed_mm_s())
        machine.state.position = compensation.contour.beside(end)
    else:
        _next(machine, compensation, motion, end)
    compensation.programmed = list(end)


def _hold(machine: Machine, compensation: Compensation, motion: int, end: list[float], direction: Point) -> None:
    kind = "rapid" if motion == 0 else "feed"
    feed = machine.emit.path_feed_mm_s()
    compensation.queue.hold(Pending(kind, machine.emit.line, list(end), feed, direction))


def _entry(machine: Machine, compensation: Compensation, motion: int, end: list[float]) -> None:
    """The first move ends beside the programmed point, square to the path."""
    first, second, _ = compensation.queue.axes
    state = machine.state
    here: Point = (state.position[first], state.position[second])
    goal: Point = (end[first], end[second])
    radius = compensation.radius
    if math.hypot(goal[0] - here[0], goal[1] - here[1]) <= radius:
        raise GcodeError(
            "GC091",
            f"the entry move of cutter compensation is not longer than the tool radius ({radius:g})",
            "start further away, or use a smaller tool (D)",
            "motion",
        )
    alpha = math.atan2(goal[1] - here[1], goal[0] - here[0]) + compensation.side * math.pi / 2.0
    if compensation.contour is not None:  # square to the tool's own way, so that it does not pass the corner too near
        alpha += compensation.side * math.asin(radius / math.dist(goal, here))
    compensation.queue.start = here
    beside = list(end)
    beside[first] += radius * math.cos(alpha)
    beside[second] += radius * math.sin(alpha)
    _hold(machine, compensation, motion, beside, (math.cos(alpha), math.sin(alpha)))
    compensation.first = False
    state.position = beside


def _next(machine: Machine, compensation: Compensation, motion: int, end: list[float]) -> None:
    """A straight move after another: the corner between them decides where the held move ends."""
    queue, radius, side = compensation.queue, compensation.radius, compensation.side
    first, second, _ = queue.axes
    state = machine.state
    here: Point = (state.position[first], state.position[second])
    corner = programmed(compensation)
    goal: Point = (end[first], end[second])
    direction: Point = (goal[0] - corner[0], goal[1] - corner[1])
    beside = list(end)
    if direction == (0.0, 0.0):
        beside[first], beside[second] = here
        _hold(machine, compensation, motion, beside, direction)
        state.position = beside
        return
    theta = math.atan2(here[1] - corner[1], here[0] - corner[0])
    alpha = math.atan2(direction[1], direction[0])
    if side > 0 and theta < alpha:
        theta += 2.0 * math.pi
    elif side < 0 and alpha < theta:
        alpha += 2.0 * math.pi
    beta = side * (theta - alpha) - math.pi / 2.0
    across = alpha + side * math.pi / 2.0
    beside[first] += radius * math.cos(across)
    beside[second] += radius * math.sin(across)
    middle: Point = (corner[0] + radius * math.cos(across), corner[1] + radius * math.sin(across))
    front = queue.front()
    arc_before = front is not None and front.kind == "arc"
    inward_arc = front is not None and arc_before and not tool_inside(side, front.turns)
    if beta < -CORNER or beta > math.pi + CORNER or (beta > math.pi - CORNER and inward_arc):
        if front is not None and arc_before:
            point = _arc_to_line(compensation, front, corner, alpha, machine.emit.line)
        else:
            point = _line_to_line(compensation, here, theta, beta)
        queue.end_at(point, machine.emit.line)
    elif beta > CORNER:
        queue.end_at(here, machine.emit.line)
        _round_corner(machine, compensation, motion, end, middle, corner)
        queue.start = middle
    else:
        queue.release()
        queue.start = here
    _hold(machine, compensation, motion, beside, direction)
    state.position = beside


def programmed(compensation: Compensation) -> Point:
    """Where the programmed path is now, in the plane."""
    first, second, _ = compensation.queue.axes
    assert compensation.programmed is not None
    return compensation.programmed[first], compensation.programmed[second]


def _line_to_line(compensation: Compensation, here: Point, theta: float, beta: float) -> Point:
    """Where the two offset lines of an inside corner meet."""
    half = (beta + math.pi) / 2.0
    if half == 0.0:
        raise GcodeError("GC092", "an inside corner of zero degrees", "the path may not turn back on itself", "motion")
    retreat = compensation.radius / math.tan(half)
    along = theta + compensation.side * math.pi / 2.0
    return here[0] + retreat * math.cos(along), here[1] + retreat * math.sin(along)


def _arc_to_line(compensation: Compensation, arc: Pending, corner: Point, base: float, line: int) -> Point:
    """Where the offset of an arc meets the offset of the line after it."""
    first, second, _ = compensation.queue.axes
    radius, side = compensation.radius, compensation.side
    offset_radius = math.hypot(arc.center[0] - arc.end[first], arc.center[1] - arc.end[second])
    inside = tool_inside(side, arc.turns)
    theta = base + (math.pi / 2.0 if arc.turns > 0 else -math.pi / 2.0)
    phi = math.atan2(arc.center[1] - corner[1], arc.center[0] - corner[0])
    programmed_radius = offset_radius + radius if inside else offset_radius - radius
    height = programmed_radius * math.cos(theta - phi) + (-radius if inside else radius)
    ratio = height / offset_radius if offset_radius else math.inf
    if abs(ratio) > 1.0:
        raise GcodeError(
            "GC092",
            f"the tool does not fit into the corner between the arc of line {arc.line} and line {line}",
            "use a smaller tool (D)",
            "motion",
        )
    sign = -1.0 if (arc.turns > 0) == inside else 1.0
    angle = sign * math.acos(ratio) + theta + math.pi
    return arc.center[0] + offset_radius * math.cos(angle), arc.center[1] + offset_radius * math.sin(angle)


def _round_corner(
    machine: Machine, compensation: Compensation, motion: int, end: list[float], middle: Point, corner: Point
) -> None:
    """An outside corner: an arc about it (a straight rapid in G0). It is emitted at once."""
    queue = compensation.queue
    first, second, third = queue.axes
    place = list(end)
    place[first], place[second] = middle
    place[third] = machine.state.position[third]
    line, feed = machine.emit.line, machine.emit.path_feed_mm_s()
    if motion == 0:
        queue.hold(Pending("rapid", line, place, feed))
    else:
        queue.hold(Pending("arc", line, place, feed, center=corner, turns=-compensation.side))
    queue.release()
