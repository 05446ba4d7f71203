"""G28 and G30: to a stored point by way of the programmed one; G28.1 and G30.1 store where the machine stands."""

from __future__ import annotations

from gcode.block import Block
from gcode.codes import MODAL_0, g_name
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.modes import refuse_under_compensation
from gcode.motion import find_end
from gcode.state import AXIS_INDEX

FIRST_PARAMETER = {280: 5161, 300: 5181, 281: 5161, 301: 5181}


def go_to_reference(machine: Machine, block: Block) -> None:
    """G28 and G30: rapid to the programmed point, then the named axes (all, if none is named) to the stored one."""
    code = block.g[MODAL_0]
    if machine.state.compensation != 400:
        raise GcodeError("GC090", f"{g_name(code)} under cutter compensation", "end it with G40 and a move first", "g")
    state, emit = machine.state, machine.emit
    end = find_end(machine, block)
    emit.rapid(end)
    state.position = end
    first = FIRST_PARAMETER[code]
    stored = [state.from_machine_units(machine.parameters.values.get(first + axis, 0.0), axis) for axis in range(9)]
    home = state.relative(stored)
    named = [axis for letter, axis in AXIS_INDEX.items() if letter in block.words]
    final = list(end)
    for axis in named or range(9):
        final[axis] = home[axis]
    emit.rapid(final)
    state.position = final


def store_reference(machine: Machine, block: Block) -> None:
    """G28.1 and G30.1."""
    refuse_under_compensation(machine, "storing a reference point")
    state = machine.state
    first = FIRST_PARAMETER[block.g[MODAL_0]]
    for axis, value in enumerate(state.absolute()):
        machine.parameters.values[first + axis] = state.to_machine_units(value, axis)
