"""Arcs under cutter compensation: entry by an arc, arc after line, arc after arc."""

from __future__ import annotations

import math

from gcode.arcgeometry import Point, distance, swept, tool_inside
from gcode.compensation import CORNER, Compensation
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.pending import Pending


def arc_move(
    machine: Machine, compensation: Compensation, end: list[float], center: Point, turns: int, programmed: Point
) -> None:
    """G2 or G3 under compensation; ``programmed`` is where the programmed arc begins."""
    if compensation.first:
        _entry(machine, compensation, end, center, turns)
    elif compensation.contour is not None:
        feed = machine.emit.path_feed_mm_s()
        compensation.contour.arc(programmed, list(end), center, turns, feed)
        machine.state.position = compensation.contour.beside(end)
    else:
        _next(machine, compensation, end, center, turns, programmed)
    compensation.programmed = list(end)


def _hold(
    machine: Machine, compensation: Compensation, end: list[float], center: Point, turns: int, sweep: float
) -> None:
    feed = machine.emit.path_feed_mm_s()
    compensation.queue.hold(Pending("arc", machine.emit.line, list(end), feed, center=center, turns=turns, sweep=sweep))


def _too_small(machine: Machine, radius: float, tool: float) -> GcodeError:
    return GcodeError(
        "GC092",
        f"the arc of line {machine.emit.line} (r = {radius:.4g}) is not larger than the tool in it (r = {tool:.4g})",
        "use a smaller tool (D)",
        "motion",
    )


def _entry(machine: Machine, compensation: Compensation, end: list[float], center: Point, turns: int) -> None:
    """The entry arc is replaced by one through the present point that ends beside the programmed end, square to it."""
    queue, tool = compensation.queue, compensation.radius
    first, second, _ = queue.axes
    state = machine.state
    here: Point = (state.position[first], state.position[second])
    goal: Point = (end[first], end[second])
    if distance(goal, here) <= tool:
        raise GcodeError(
            "GC091",
            f"the entry arc of cutter compensation is not longer than the tool radius ({tool:g})",
            "start further away, or use a smaller tool (D)",
            "motion",
        )
    inside = tool_inside(compensation.side, turns)
    if inside and distance(center, here) <= tool:
        raise _too_small(machine, distance(center, here), tool)
    gamma = math.atan2(center[1] - goal[1], center[0] - goal[0])
    if not inside:
        gamma += math.pi
    beside: Point = (goal[0] + tool * math.cos(gamma), goal[1] + tool * math.sin(gamma))
    base = math.atan2(center[1] - beside[1], center[0] - beside[0])
    half = distance(here, beside) / 2.0
    angle = math.atan2(here[1] - beside[1], here[0] - beside[0]) - base
    if abs(math.cos(angle)) < 1e-6:
        raise _too_small(machine, distance(center, here), tool)
    length = half / math.cos(angle)
    new_center: Point = (beside[0] + length * math.cos(base), beside[1] + length * math.sin(base))
    if compensation.orientation not in {0, 9}:
        queue.hold(Pending("feed", machine.emit.line, list(state.position), machine.emit.path_feed_mm_s()))
        queue.start = here
    final = list(end)
    final[first], final[second] = beside
    compensation.first = False
    _hold(machine, compensation, final, new_center, turns, swept(here, beside, new_center, turns))
    state.position = final


def _next(
    machine: Machine, compensation: Compensation, end: list[float], center: Point, turns: int, corner: Point
) -> None:
    """An arc after another move."""
    queue, tool, side = compensation.queue, compensation.radius, compensation.side
    first, second, third = queue.axes
    state = machine.state
    here: Point = (state.position[first], state.position[second])
    goal: Point = (end[first], end[second])
    radius = distance(center, goal)
    inside = tool_inside(side, turns)
    theta = math.atan2(here[1] - corner[1], here[0] - corner[0]) - side * math.pi / 2.0
    delta = math.atan2(center[1] - corner[1], center[0] - corner[0])
    alpha = delta + (-math.pi / 2.0 if turns > 0 else math.pi / 2.0)
    beta = side * (theta - alpha)
    if beta > 1.5 * math.pi:
        beta -= 2.0 * math.pi
    elif beta < -math.pi / 2.0:
        beta += 2.0 * math.pi
    if inside:
        gamma = math.atan2(center[1] - goal[1], center[0] - goal[0])
        if radius <= tool:
            raise _too_small(machine, radius, tool)
    else:
        gamma = math.atan2(goal[1] - center[1], goal[0] - center[0])
        delta += math.pi
    final = list(end)
    final[first] += tool * math.cos(gamma)
    final[second] += tool * math.sin(gamma)
    if beta < -CORNER or beta > math.pi + CORNER or (abs(beta - math.pi) < CORNER and not inside):
        queue.end_at(_meeting(machine, compensation, center, radius, turns, theta, beta), machine.emit.line)
    elif beta > CORNER:
        middle: Point = (corner[0] + tool * math.cos(delta), corner[1] + tool * math.sin(delta))
        queue.release()
        place = list(end)
        place[first], place[second], place[third] = middle[0], middle[1], state.position[third]
        _hold(machine, compensation, place, corner, -side, 0.0)
        queue.release()
        queue.start = middle
    else:
        queue.release()
        queue.start = here
    _hold(machine, compensation, final, center, turns, swept(corner, goal, center, turns))
    state.position = final


def _meeting(
    machine: Machine, compensation: Compensation, center: Point, radius: float, turns: int, theta: float, beta: float
) -> Point:
    """Where the offset of the move before meets the offset of this arc."""
    front = compensation.queue.front()
    inside = tool_inside(compensation.side, turns)
    tool = compensation.radius
    offset = radius - tool if inside else radius + tool
    before = front.line if front is not None else machine.emit.line
    if front is not None and front.kind == "arc":
        return _arc_to_arc(machine, compensation, front, center, offset, turns)
    height = radius * math.sin(beta - math.pi / 2.0) + (tool if inside else -tool)
    ratio = height / offset if offset else math.inf
    if abs(ratio) > 1.0:
        raise _unreachable(before, machine.emit.line)
    turn = 1.0 if turns > 0 else -1.0
    angle = theta + turn * math.asin(ratio) if inside else theta + math.pi - turn * math.asin(ratio)
    return center[0] + offset * math.cos(angle), center[1] + offset * math.sin(angle)


def _arc_to_arc(
    machine: Machine, compensation: Compensation, front: Pending, center: Point, offset: float, turns: int
) -> Point:
    """Where the offsets of two arcs meet."""
    first, second, _ = compensation.queue.axes
    old = distance(front.center, (front.end[first], front.end[second]))
    apart = distance(front.center, center)
    if old == 0.0 or apart == 0.0:
        raise _unreachable(front.line, machine.emit.line)
    ratio = (old * old + apart * apart - offset * offset) / (2.0 * old * apart)
    if abs(ratio) > 1.0:
        raise _unreachable(front.line, machine.emit.line)
    base = math.atan2(center[1] - front.center[1], center[0] - front.center[0])
    sign = 1.0 if tool_inside(compensation.side, front.turns) == (turns > 0) else -1.0
    angle = base + sign * math.acos(ratio)
    return front.center[0] + old * math.cos(angle), front.center[1] + old * math.sin(angle)


def _unreachable(before: int, line: int) -> GcodeError:
    return GcodeError(
        "GC092",
        f"the tool does not fit into the inside corner between line {before} and line {line}",
        "use a smaller tool (D), or a wider corner",
        "motion",
    )
