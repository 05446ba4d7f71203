"""M0, M1, M60 and the end of a program: M2, M30."""

from __future__ import annotations

from gcode.block import Block
from gcode.canon import End, Stop
from gcode.codes import STOPPING
from gcode.machine import Machine
from gcode.offsets import emit_origin, emit_rotation
from gcode.ondemand import flush


def stop(machine: Machine, block: Block) -> None:
    """M0, M1, M60, M2, M30, and M99 of a main program."""
    code = block.m[STOPPING]
    emit = machine.emit
    if code not in {0, 1, 60} or machine.compensation is None or machine.compensation.contour is None:
        flush(machine)  # a pause inside a contour that may be trimmed keeps its place between the moves
    if code == 60:
        emit.text("PALLET_SHUTTLE()")
    if code in {0, 1, 60}:
        emit.command(Stop(emit.line, code == 1))
        return
    end_program(machine, shuttle=code == 30)


def end_program(machine: Machine, *, shuttle: bool) -> None:
    """The end: back to G54, G17, G90, G94, G40 and G1 without feed, spindle and coolant off, overrides on."""
    state, emit = machine.state, machine.emit
    absolute = state.absolute()
    state.system = 1
    machine.parameters.values[5220] = 1.0
    machine.load_system(1)
    state.position = state.relative(absolute)
    emit_origin(machine)
    emit_rotation(machine)
    if state.plane != 170:
        state.plane = 170
        emit.text("SELECT_PLANE(CANON_PLANE_XY)")
    state.incremental = False
    state.feed_mode = 940
    emit.text("SET_FEED_MODE(0, 0)")
    state.feed = 0.0
    emit.text("SET_FEED_RATE(0.0000)")
    if not state.feed_override:
        state.feed_override = True
        emit.text("ENABLE_FEED_OVERRIDE()")
    state.compensation = 400
    machine.compensation = None
    state.spindle_direction = 0
    emit.spindle("STOP_SPINDLE_TURNING(0)")
    state.speed_override = True
    state.spindle_mode = 970
    emit.text("SET_SPINDLE_MODE(0 0.0000)")
    state.motion = 10
    _coolant_off(machine)
    if shuttle:
        emit.text("PALLET_SHUTTLE()")
    emit.command(End(emit.line))
    machine.finished = True


def _coolant_off(machine: Machine) -> None:
    state = machine.state
    if state.mist:
        state.mist = False
        machine.emit.coolant("MIST_OFF()")
    if state.flood:
        state.flood = False
        machine.emit.coolant("FLOOD_OFF()")
