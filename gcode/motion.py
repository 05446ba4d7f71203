"""Where a line ends, and the straight moves G0 and G1."""

from __future__ import annotations

import math

from gcode.block import Block
from gcode.codes import MODAL_0, g_name
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.state import AXIS_INDEX, State

INVERSE_TIME, PER_MINUTE, PER_REVOLUTION = 930, 940, 950
LEAST_RATE = 0.1
"""Least feed of an inverse-time move (RS274/NGC leaves it open; LinuxCNC says 0.1)."""


def find_end(machine: Machine, block: Block) -> list[float]:
    """The programmed end of the line's move, in program coordinates: G53, G90, G91, polar words."""
    state = machine.state
    if block.g.get(MODAL_0) == 530:
        return _machine_end(machine, block)
    end = programmed_position(machine)
    words = block.words
    if machine.local is not None:
        placed: list[float] = machine.local.end(end, block, incremental=state.incremental)
        return placed
    for letter, axis in AXIS_INDEX.items():
        value = words.get(letter)
        if value is None:
            continue
        end[axis] = end[axis] + value if state.incremental else value
    if "@" in words or "^" in words:
        end[0], end[1] = _polar(state, words, end[0], end[1])
    return end


def programmed_position(machine: Machine) -> list[float]:
    """Where the programmed path is now: beside the tool under compensation, else where the tool is."""
    position = list(machine.state.position)
    compensation = machine.compensation
    if compensation is not None and not compensation.first and compensation.programmed is not None:
        for axis in compensation.queue.axes[:2]:
            position[axis] = compensation.programmed[axis]
    return position


def _machine_end(machine: Machine, block: Block) -> list[float]:
    """G53: the axis words are machine coordinates in program units; other axes stay."""
    if "@" in block.words or "^" in block.words:
        raise GcodeError("GC026", "polar words with G53", "G53 takes axis words", "@")
    state = machine.state
    absolute = state.absolute()
    for letter, axis in AXIS_INDEX.items():
        value = block.words.get(letter)
        if value is not None:
            absolute[axis] = value
    end = state.relative(absolute)
    for letter, axis in AXIS_INDEX.items():
        if letter not in block.words and axis > 1:
            end[axis] = state.position[axis]
    if "x" not in block.words and "y" not in block.words:
        end[0], end[1] = state.position[0], state.position[1]
    return end


def _polar(state: State, words: dict[str, float], x: float, y: float) -> tuple[float, float]:
    """``@`` radius and ``^`` angle about the origin of the work coordinates; in G91 they add to the present ones."""
    radius, theta = math.hypot(x, y), math.atan2(y, x)
    at_origin = x == 0.0 and y == 0.0
    if state.incremental:
        if at_origin:
            raise GcodeError(
                "GC026", "incremental polar words at the origin", "there is no angle to add to: use X and Y", "@"
            )
        radius += words.get("@", 0.0)
        theta += words.get("^", 0.0) * math.pi / 180.0
    else:
        if "^" in words:
            theta = words["^"] * math.pi / 180.0
        elif at_origin:
            raise GcodeError("GC026", "a polar radius without an angle at the origin", "add the angle: ^30", "@")
        radius = words.get("@", radius)
    return radius * math.cos(theta), radius * math.sin(theta)


def check_feed(machine: Machine, block: Block, what: str) -> None:
    """Refuses a cutting move without a feed (GC040, GC041)."""
    state = machine.state
    if state.feed_mode == INVERSE_TIME:
        if "f" not in block.words:
            raise GcodeError(
                "GC041", f"{what} without F in inverse time mode", "in G93 every cutting line needs its own F", "motion"
            )
        return
    if state.feed == 0.0:
        raise GcodeError("GC040", f"{what} with no feed rate", "give F on this line or before it", "motion")
    if state.feed_mode == PER_REVOLUTION and state.spindle_rpm == 0.0:
        raise GcodeError(
            "GC071", f"{what} in feed per revolution with the spindle at 0 rpm", "give S and M3 first", "motion"
        )


def straight(machine: Machine, block: Block, motion: int) -> None:
    """G0 and G1."""
    state, emit = machine.state, machine.emit
    if motion == 10:
        check_feed(machine, block, "G1")
    state.motion = motion
    end = find_end(machine, block)
    if motion == 10 and state.feed_mode == INVERSE_TIME:
        set_inverse_time(machine, block, straight_length(programmed_position(machine), end))
    machine.arc_forbidden = False
    compensation = machine.active_compensation()
    if compensation is not None:
        from gcode.compensation import straight_move

        straight_move(machine, block, compensation, motion, end)
        return
    if motion == 0:
        if end[2] < 0.0 and end[2] < state.position[2] and block.g.get(MODAL_0) != 530:
            machine.warn("GC216", f"a rapid move down to Z{end[2]:g}", "check that nothing is in the way", "z")
        emit.rapid(end)
    else:
        emit.feed(end)
    state.position = end


def set_inverse_time(machine: Machine, block: Block, length: float) -> None:
    """G93: the feed that makes the move of ``length`` take 1/F minutes."""
    machine.state.feed = max(length * block.words["f"], LEAST_RATE)
    machine.emit.text(f"SET_FEED_RATE({machine.state.feed:.4f})")


def straight_length(start: list[float], end: list[float]) -> float:
    """Length of a straight move: of XYZ, else of UVW, else of ABC."""
    for axes in ((0, 1, 2), (6, 7, 8), (3, 4, 5)):
        if any(abs(start[axis] - end[axis]) > 1e-7 for axis in axes):
            return math.sqrt(sum((start[axis] - end[axis]) ** 2 for axis in axes))
    return 0.0


def check_g53(machine: Machine, block: Block) -> None:
    """G53 needs G0 or G1 and absolute distances (GC050, GC051)."""
    if block.motion not in {0, 10}:
        found = "no motion code is active" if block.motion in {None, 800} else f"found {g_name(block.motion or 0)}"
        raise GcodeError("GC051", f"G53 needs G0 or G1: {found}", "write G53 G0 ...", "G53")
    mode = block.g.get("distance mode")
    if mode == 910 or (mode is None and machine.state.incremental):
        raise GcodeError("GC050", "G53 in incremental mode", "machine coordinates are absolute: add G90", "G53")
