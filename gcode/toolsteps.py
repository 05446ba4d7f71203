"""Steps of tools: T, M6, M61, and the tool length offsets G43, G43.1, G43.2 and G49."""

from __future__ import annotations

from gcode.block import Block
from gcode.canon import ToolChange
from gcode.codes import TOOL_CHANGE, TOOL_LENGTH, g_name
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.modes import refuse_under_compensation
from gcode.setup import Tool
from gcode.state import AXIS_INDEX, NO_TOOL, nine

TOOL_PARAMETER = 5400
"""#5400 is the number of the tool in the spindle, then nine offsets, diameter, two angles and the orientation."""


def select_tool(machine: Machine, block: Block) -> None:
    """T: the changer prepares the tool."""
    number = int(block.words["t"])
    machine.tool(number, "t")
    machine.state.selected_tool = number
    machine.state.tool_was_selected = True
    machine.emit.text(f"SELECT_TOOL({number})")


def change_tool(machine: Machine, block: Block) -> None:
    """M6 (the selected tool) and M61 Q (only tell the number of the tool that is in)."""
    code = block.m[TOOL_CHANGE]
    state, emit = machine.state, machine.emit
    if code == 61:
        _tell_tool(machine, block)
        return
    if state.selected_tool is None:
        raise GcodeError("GC061", "M6 without a tool", "select one first: T1 M6", "M6")
    refuse_under_compensation(machine, "a tool change", "M6")
    if not state.tool_was_selected:
        machine.warn("GC217", f"M6 without T: tool {state.selected_tool} again", "write T beside M6", "M6")
    state.tool_was_selected = False
    emit.text("START_CHANGE()")
    state.spindle_direction = 0
    emit.spindle("STOP_SPINDLE_TURNING(0)")
    emit.command(ToolChange(emit.line, state.selected_tool))
    load_tool(machine, machine.tool(state.selected_tool, "M6"))
    machine.wait("tool", index=state.selected_tool)


def _tell_tool(machine: Machine, block: Block) -> None:
    if "q" not in block.words or block.whole("q") < 0:
        raise GcodeError("GC025", "M61 without a tool number", "Q is the number of the tool in the spindle", "M61")
    tool = machine.tool(block.whole("q"), "q")
    load_tool(machine, tool)
    machine.emit.text(f"CHANGE_TOOL_NUMBER({tool.number})")


def load_tool(machine: Machine, tool: Tool) -> None:
    """Puts ``tool`` into the spindle: state and parameters 5400 to 5413."""
    machine.state.tool_in_spindle = tool.number
    write_tool_parameters(machine, tool)


def write_tool_parameters(machine: Machine, tool: Tool) -> None:
    """Parameters 5400 to 5413 say what is in the spindle."""
    numbers = (tool.number, *tool.offset, tool.diameter, tool.front_angle, tool.back_angle, tool.orientation)
    for index, value in enumerate(numbers):
        machine.parameters.values[TOOL_PARAMETER + index] = float(value)


def set_tool_length(machine: Machine, block: Block) -> None:
    """G43 H (of a tool of the table), G43.1 (these numbers), G43.2 (added), G49 (none)."""
    refuse_under_compensation(machine, "a change of the tool offset")
    code = block.g[TOOL_LENGTH]
    state = machine.state
    words = block.words
    named = {axis: words[letter] for letter, axis in AXIS_INDEX.items() if letter in words}
    if code == 490:
        offset = nine()
    elif code == 430:
        offset = _offset_of(machine, block)
    elif code == 431:
        offset = [named.get(axis, value) for axis, value in enumerate(state.tool_offset)]
    else:
        offset = _added_offset(machine, block, named)
    absolute = state.absolute()
    state.tool_length = code
    state.tool_offset = offset
    state.position = state.relative(absolute)
    for axis, value in enumerate(offset):
        machine.parameters.values[5081 + axis] = state.to_machine_units(value, axis)
    groups = (offset[:3], offset[3:6], offset[6:])
    numbers = ", ".join(" ".join(f"{value:.4f}" for value in group) for group in groups)
    machine.emit.frame_change(f"USE_TOOL_LENGTH_OFFSET({numbers})")


def _offset_of(machine: Machine, block: Block) -> list[float]:
    state = machine.state
    if "h" in block.words:
        tool = machine.tool(int(block.words["h"]), "h")
    else:
        tool = machine.tool(state.tool_in_spindle, "G43") if state.tool_in_spindle else NO_TOOL
        if not state.tool_in_spindle:
            machine.warn(
                "GC202", "G43 without H and with no tool in the spindle", "write G43 H1, or T1 M6 before it", "G43"
            )
    return [state.from_machine_units(value, axis) for axis, value in enumerate(tool.offset)]


def _added_offset(machine: Machine, block: Block, named: dict[int, float]) -> list[float]:
    state = machine.state
    name = g_name(block.g[TOOL_LENGTH])
    if "h" in block.words and named:
        raise GcodeError("GC062", f"{name} with both H and axis words", "use one of them", "h")
    if "h" not in block.words and not named:
        raise GcodeError("GC062", f"{name} without H and without axis words", "name a tool with H, or axes", "g")
    added = list(state.tool_offset)
    if "h" in block.words:
        tool = machine.tool(int(block.words["h"]), "h")
        named = {axis: state.from_machine_units(value, axis) for axis, value in enumerate(tool.offset)}
    for axis, value in named.items():
        added[axis] += value
    return added
