"""Splines in the XY plane: G5 (cubic), G5.1 (quadratic), G5.2 and G5.3 (NURBS by control points)."""

from __future__ import annotations

from gcode.block import Block
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.modes import refuse_under_compensation
from gcode.motion import check_feed, find_end

CUBIC, QUADRATIC, OPEN_NURBS = 50, 51, 52


def spline(machine: Machine, block: Block, motion: int) -> None:
    """G5 I J P Q X Y and G5.1 I J X Y. A G5 without I and J goes on smoothly from the one before."""
    name = "G5" if motion == CUBIC else "G5.1"
    _check(machine, block, name)
    state, words = machine.state, block.words
    end = find_end(machine, block)
    x, y = state.position[0], state.position[1]
    if motion == QUADRATIC:
        if "i" not in words or "j" not in words:
            raise GcodeError("GC057", "G5.1 needs both I and J", "they place the control point", "motion")
        points = [(x, y, 1.0), (x + words["i"], y + words["j"], 1.0), (end[0], end[1], 1.0)]
    else:
        i, j = _first_control(machine, block)
        if "p" not in words or "q" not in words:
            raise GcodeError(
                "GC057", "G5 needs both P and Q", "they place the second control point from the end", "motion"
            )
        second = (end[0] + words["p"], end[1] + words["q"], 1.0)
        points = [(x, y, 1.0), (x + i, y + j, 1.0), second, (end[0], end[1], 1.0)]
        machine.cycle.words["i"], machine.cycle.words["j"] = -words["p"], -words["q"]
    machine.emit.nurbs(points, len(points))
    state.position[0], state.position[1] = end[0], end[1]
    state.motion = motion


def _first_control(machine: Machine, block: Block) -> tuple[float, float]:
    words = block.words
    if ("i" in words) != ("j" in words):
        raise GcodeError("GC057", "G5 needs both I and J, or neither", "they place the first control point", "motion")
    if "i" in words:
        return words["i"], words["j"]
    if machine.state.motion != CUBIC:
        raise GcodeError("GC057", "the first G5 needs I and J", "later ones may leave them out", "motion")
    return machine.cycle.words.get("i", 0.0), machine.cycle.words.get("j", 0.0)


def _check(machine: Machine, block: Block, name: str) -> None:
    refuse_under_compensation(machine, name, "motion")
    if machine.state.plane != 170:
        raise GcodeError("GC057", f"{name} outside the XY plane", "select G17 first", "motion")
    check_feed(machine, block, name)
    for letter in "zabcuvw":
        if letter in block.words:
            raise GcodeError("GC057", f"{letter.upper()} in a spline", "a spline moves X and Y only", letter)


def nurbs_point(machine: Machine, block: Block) -> None:
    """G5.2 P L, then control points X Y P (weight)."""
    state, words, points = machine.state, block.words, machine.nurbs_points
    _check(machine, block, "G5.2")
    weight = words.get("p", 0.0)
    has_point = "x" in words
    if has_point != ("y" in words):
        raise GcodeError("GC057", "a control point needs both X and Y", "add the other one", "motion")
    if state.motion != OPEN_NURBS:
        points.clear()
    if points and not has_point:
        raise GcodeError("GC057", "only the first control point may stand without X and Y", "add X and Y", "motion")
    if weight <= 0.0 and (points or has_point):
        raise GcodeError("GC057", "a control point without a positive weight", "add P1", "p")
    if not points:
        first = weight if not has_point and weight > 0.0 else 1.0
        points.append((state.position[0], state.position[1], first))
        machine.nurbs_order = 3
    if words.get("l", 0.0) > 3.0:
        machine.nurbs_order = block.whole("l")
    if has_point:
        end = find_end(machine, block)
        points.append((end[0], end[1], weight))
    state.motion = OPEN_NURBS


def nurbs_end(machine: Machine, _block: Block) -> None:
    """G5.3: runs the NURBS collected since G5.2."""
    state, points = machine.state, machine.nurbs_points
    if state.motion != OPEN_NURBS or not points:
        raise GcodeError("GC057", "G5.3 without G5.2", "G5.2 opens the list of control points", "G5.3")
    if len(points) < machine.nurbs_order:
        raise GcodeError(
            "GC057", f"{len(points)} control points are too few for order {machine.nurbs_order}", "add points", "G5.3"
        )
    machine.emit.nurbs(list(points), machine.nurbs_order)
    state.position[0], state.position[1] = points[-1][0], points[-1][1]
    points.clear()
    state.motion = 800
