"""Offsets: coordinate systems G54 to G59.3, G92 and G52, and what G28.1 and G30.1 store.

Changing an offset never moves the machine: the position in work coordinates is recomputed for the same point.
"""

from __future__ import annotations

from gcode.block import Block
from gcode.codes import COORDINATES, G92_APPLIED, MODAL_0, g_name
from gcode.machine import Machine
from gcode.modes import refuse_under_compensation
from gcode.state import AXIS_INDEX, nine

SYSTEMS = (540, 550, 560, 570, 580, 590, 591, 592, 593)


def set_coordinate_system(machine: Machine, block: Block) -> None:
    """G54 to G59.3."""
    set_system(machine, SYSTEMS.index(block.g[COORDINATES]) + 1)


def set_system(machine: Machine, system: int) -> None:
    """Makes coordinate system ``system`` (1 is G54) the active one."""
    refuse_under_compensation(machine, "a change of coordinate system")
    state, emit = machine.state, machine.emit
    if system == state.system:
        emit.comment("interpreter: continuing to use same coordinate system")
        return
    absolute = state.absolute()
    state.system = system
    machine.parameters.values[5220] = float(system)
    machine.load_system(system)
    state.position = state.relative(absolute)
    emit_origin(machine)
    emit_shift(machine)
    emit_rotation(machine)


def emit_origin(machine: Machine) -> None:
    """SET_G5X_OFFSET of the state."""
    state = machine.state
    numbers = ", ".join(f"{value:.4f}" for value in state.origin[:6])
    machine.emit.frame_change(f"SET_G5X_OFFSET({state.system}, {numbers})")


def emit_shift(machine: Machine) -> None:
    """SET_G92_OFFSET of the state."""
    numbers = ", ".join(f"{value:.4f}" for value in machine.state.shift[:6])
    machine.emit.frame_change(f"SET_G92_OFFSET({numbers})")


def emit_rotation(machine: Machine) -> None:
    """SET_XY_ROTATION of the state."""
    machine.emit.frame_change(f"SET_XY_ROTATION({machine.state.rotation_deg:.4f})")


def set_axis_offset(machine: Machine, block: Block) -> None:
    """G92 (the present position gets these coordinates) and G52 (the offset itself); both live in 5211 to 5219."""
    refuse_under_compensation(machine, f"{g_name(block.g[MODAL_0])}")
    state = machine.state
    local = block.g[MODAL_0] == 520
    for letter, axis in AXIS_INDEX.items():
        value = block.words.get(letter)
        if value is None:
            continue
        total = state.position[axis] + state.shift[axis]
        state.shift[axis] = value if local else total - value
        state.position[axis] = total - value if local else value
    _store_shift(machine)
    machine.parameters.values[5210] = 1.0
    emit_shift(machine)


def _store_shift(machine: Machine) -> None:
    for axis, value in enumerate(machine.state.shift):
        machine.parameters.values[5211 + axis] = machine.state.to_machine_units(value, axis)


def apply_axis_offset(machine: Machine, block: Block) -> None:
    """G92.1 (off, forgotten), G92.2 (off, kept in 5211 to 5219) and G92.3 (on again from there)."""
    code = block.g[G92_APPLIED]
    state, values = machine.state, machine.parameters.values
    if code == 923:
        shift = [state.from_machine_units(values.get(5211 + axis, 0.0), axis) for axis in range(9)]
    else:
        shift = nine()
    if shift != state.shift:
        refuse_under_compensation(machine, g_name(code))
    for axis in range(9):
        state.position[axis] += state.shift[axis] - shift[axis]
    state.shift = shift
    values[5210] = float(code == 923)
    if code == 921:
        for axis in range(9):
            values[5211 + axis] = 0.0
    emit_shift(machine)
