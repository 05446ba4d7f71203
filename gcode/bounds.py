"""What the interpreter tells the machine before the first line of a program and behind its last one."""

from __future__ import annotations

from gcode.canon import End
from gcode.machine import Machine
from gcode.offsets import emit_origin, emit_rotation, emit_shift


def begin(machine: Machine) -> None:
    """Units, offsets, rotation and feed reference, as they stand."""
    emit = machine.emit
    emit.frame_change("USE_LENGTH_UNITS(CANON_UNITS_MM)")
    emit_origin(machine)
    emit_shift(machine)
    emit_rotation(machine)
    emit.text("SET_FEED_REFERENCE(CANON_XYZ)")
    emit.text("ON_RESET()")


def over(machine: Machine) -> None:
    """Two resets, as of LinuxCNC's stand-alone interpreter: when it closes the program, and when it leaves."""
    machine.emit.line = 0
    machine.emit.text("ON_RESET()")
    machine.emit.text("ON_RESET()")


def end_by_percent(machine: Machine, number: int) -> None:
    """The closing percent sign in line ``number`` ends the program; the text shows it without a line."""
    emit = machine.emit
    emit.line = 0
    emit.text("FINISH()")
    emit.line = number
    emit.command(End(number, ""))


def missing_percent(machine: Machine, last: int) -> None:
    """A program that began with % and ended by M2 should have a % behind it. ``last``: its last line."""
    machine.emit.line = last
    machine.emit.comment("interpreter: percent sign missing from end of file")
