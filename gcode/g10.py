"""G10: setting the tool table (L1, L10, L11) and the coordinate systems (L2, L20), with rotation R."""

from __future__ import annotations

from dataclasses import replace

from gcode.block import Block
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.modes import refuse_under_compensation
from gcode.offsets import emit_origin, emit_rotation
from gcode.setup import Tool
from gcode.state import AXIS_INDEX, position_of
from gcode.toolsteps import load_tool, write_tool_parameters

KINDS = {0, 1, 2, 10, 11, 20}
FIXTURE = 9
"""G10 L11 measures in G59.3."""


def set_data(machine: Machine, block: Block) -> None:
    """G10 L P. GC063 and GC064 for a wrong L or P."""
    if "l" not in block.words or block.words["l"] not in KINDS:
        raise GcodeError(
            "GC063", "G10 needs L0, L1, L2, L10, L11 or L20", "L2 and L20 set offsets, L1, L10, L11 tools", "g"
        )
    kind = int(block.words["l"])
    if kind == 0:
        machine.emit.text("RELOAD_TOOLDATA()")
        return
    if "p" not in block.words:
        raise GcodeError("GC064", f"G10 L{kind} without P", "P is the coordinate system (1 is G54) or the tool", "g")
    number = block.whole("p")
    if abs(number - block.words["p"]) > 1e-4:
        raise GcodeError("GC014", "P of G10 must be a whole number", "remove the decimals", "p")
    if kind in {2, 20}:
        _set_system(machine, block, kind, number)
    else:
        _set_tool(machine, block, kind, number)


def _set_system(machine: Machine, block: Block, kind: int, number: int) -> None:
    if not 0 <= number <= 9:
        raise GcodeError(
            "GC064", f"there is no coordinate system {number}", "P is 1 to 9 (G54 to G59.3), or 0 (active)", "p"
        )
    for letter in "ij":
        if letter in block.words:
            raise GcodeError("GC020", f"{letter.upper()} word with G10 L{kind}", "remove it", letter)
    if kind == 20 and "r" in block.words:
        raise GcodeError("GC020", "R word with G10 L20", "rotation is set by G10 L2 R", "r")
    state, values = machine.state, machine.parameters.values
    system = number or state.system
    active = system == state.system
    if active:
        refuse_under_compensation(machine, "setting the active coordinate system")
    base = 5201 + 20 * system
    absolute = state.absolute()
    origin = [state.from_machine_units(values.get(base + axis, 0.0), axis) for axis in range(9)]
    rotation = block.words.get("r", values.get(base + 9, 0.0))
    named = {axis: block.words[letter] for letter, axis in AXIS_INDEX.items() if letter in block.words}
    if kind == 2:
        for axis, value in named.items():
            origin[axis] = value
    else:
        origin = _origin_for(machine, absolute, origin, rotation, named)
    for axis in range(9):
        values[base + axis] = state.to_machine_units(origin[axis], axis)
    values[base + 9] = rotation
    if not active:
        machine.emit.comment("interpreter: setting coordinate system origin")
        return
    state.origin, state.rotation_deg = origin, rotation
    state.position = state.relative(absolute)
    emit_origin(machine)
    emit_rotation(machine)


def _origin_for(
    machine: Machine, absolute: list[float], origin: list[float], rotation: float, named: dict[int, float]
) -> list[float]:
    """L20: the origin that gives the present position the named coordinates; the others keep theirs."""
    state = machine.state
    here = [value - origin[i] - state.tool_offset[i] for i, value in enumerate(absolute)]
    here[0], here[1] = state.rotated(here[0], here[1], -rotation)
    here = [value - state.shift[i] for i, value in enumerate(here)]
    wanted = [named.get(axis, here[axis]) + state.shift[axis] for axis in range(9)]
    wanted[0], wanted[1] = state.rotated(wanted[0], wanted[1], rotation)
    found = [absolute[i] - state.tool_offset[i] - value for i, value in enumerate(wanted)]
    keep_plane = 0 not in named and 1 not in named
    return [origin[i] if (i not in named and i > 1) or (keep_plane and i < 2) else found[i] for i in range(9)]


def _set_tool(machine: Machine, block: Block, kind: int, number: int) -> None:
    if number < 1:
        raise GcodeError("GC064", f"there is no tool {number}", "P is the number of a tool", "p")
    words = block.words
    if not any(letter in words for letter in (*AXIS_INDEX, "r", "q", "i", "j")):
        raise GcodeError("GC063", f"G10 L{kind} without values", "name offsets, R (radius), I J (angles) or Q", "g")
    tool = machine.tool(number, "p")
    state = machine.state
    offset = list(tool.offset)
    if kind == 1:
        for letter, axis in AXIS_INDEX.items():
            if letter in words:
                offset[axis] = state.to_machine_units(words[letter], axis)
    else:
        offset = _measured(machine, block, tool, FIXTURE if kind == 11 else state.system)
    orientation = tool.orientation
    if "q" in words:
        orientation = block.whole("q")
        if not 0 <= orientation <= 9 or orientation != words["q"]:
            raise GcodeError("GC064", "Q of G10 L1 must be 0 to 9", "it is the orientation of a lathe tool", "q")
    changed = replace(
        tool,
        offset=position_of(offset),
        diameter=2.0 * state.to_machine_units(words["r"], 0) if "r" in words else tool.diameter,
        front_angle=words.get("i", tool.front_angle),
        back_angle=words.get("j", tool.back_angle),
        orientation=orientation,
    )
    (machine.free_tools if machine.tools is None else machine.tools)[number] = changed
    _announce(machine, changed)
    if state.tool_in_spindle == number:
        load_tool(machine, changed)
    else:
        write_tool_parameters(machine, machine.tool(state.tool_in_spindle, "p") if state.tool_in_spindle else Tool(0))


def _measured(machine: Machine, block: Block, tool: Tool, system: int) -> list[float]:
    """L10 and L11: the offset that makes the present position of the tool's tip the named one."""
    state, values, words = machine.state, machine.parameters.values, block.words
    base = 5201 + 20 * system
    rotation = values.get(base + 9, 0.0)
    here = [value - state.tool_offset[i] for i, value in enumerate(state.absolute())]
    here = [value - state.from_machine_units(values.get(base + i, 0.0), i) for i, value in enumerate(here)]
    here[0], here[1] = state.rotated(here[0], here[1], -rotation)
    if system != FIXTURE:
        here = [value - state.shift[i] for i, value in enumerate(here)]
    offset = list(tool.offset)
    if "x" in words or "y" in words:
        x, y = (state.from_machine_units(tool.offset[i], i) for i in (0, 1))
        x, y = state.rotated(x, y, -rotation)
        x = here[0] - words["x"] if "x" in words else x
        y = here[1] - words["y"] if "y" in words else y
        x, y = state.rotated(x, y, rotation)
        offset[0], offset[1] = state.to_machine_units(x, 0), state.to_machine_units(y, 1)
    for letter, axis in AXIS_INDEX.items():
        if letter in words and axis > 1:
            offset[axis] = state.to_machine_units(here[axis] - words[letter], axis)
    return offset


def _announce(machine: Machine, tool: Tool) -> None:
    numbers = " ".join(f"{value:.4f}" for value in tool.offset)
    angles = f"{tool.front_angle:.4f}, {tool.back_angle:.4f}, {tool.orientation}"
    machine.emit.text(f"SET_TOOL_TABLE_ENTRY({tool.pocket}, {tool.number}, {numbers}, {angles})")
    if machine.state.tool_in_spindle == tool.number:
        machine.emit.text(f"SET_TOOL_TABLE_ENTRY(0, {tool.number}, {numbers}, {angles})")
