"""The order of execution of one line, as a table.

RS274/NGC fixes the order in which the parts of a line act, whatever the order in which they are written: comment, feed
mode, feed, speed, tool, M codes by group, G codes by group, motion, stop. Source: NIST RS274/NGC version 3, table 8,
with LinuxCNC's additions in the places where it puts them.
"""

from __future__ import annotations

from collections.abc import Callable

from gcode import auxiliary, comments, modes, offsets, ondemand, stops, toolsteps
from gcode.arcs import arc
from gcode.block import Block
from gcode.canon import Dwell
from gcode.checks import NO_MOTION, check_words, choose_motion
from gcode.codes import (
    COMPENSATION,
    CONTROL,
    COOLANT,
    COORDINATES,
    CYCLES,
    DISTANCE,
    FEED_MODE,
    G92_APPLIED,
    IJK_DISTANCE,
    IO,
    LATHE_DIAMETER,
    LATHE_PROFILES,
    MODAL_0,
    MOTION,
    OVERRIDE,
    PLANE,
    RETRACT,
    SPINDLE,
    SPINDLE_MODE,
    STOPPING,
    TOOL_CHANGE,
    TOOL_LENGTH,
    UNITS,
    USER,
)
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.motion import check_g53, straight
from gcode.records import dataclass

Step = Callable[[Machine, Block], None]


@dataclass(frozen=True, slots=True)
class Stage:
    """One place in the order: what triggers it (a word letter, a G group or an M group) and what it does."""

    kind: str
    key: str
    step: Step


def dwell(machine: Machine, block: Block) -> None:
    """G4 P, seconds. Other non-modal codes have their own stage."""
    if block.g[MODAL_0] != 40:
        return
    seconds = block.words["p"]
    if seconds < 0.0:
        raise GcodeError("GC015", "a negative dwell", "P is a time in seconds", "p")
    machine.emit.command(Dwell(machine.emit.line, seconds))


def modal_0(machine: Machine, block: Block) -> None:
    """The non-modal codes that act after the modes."""
    MODAL_0_STEPS[block.g[MODAL_0]](machine, block)


def no_step(_machine: Machine, _block: Block) -> None:
    """G4 and G53 act elsewhere."""


MODAL_0_STEPS: dict[int, Step] = {
    40: no_step,
    530: no_step,
    280: ondemand.go_to_reference,
    300: ondemand.go_to_reference,
    281: ondemand.store_reference,
    301: ondemand.store_reference,
    920: offsets.set_axis_offset,
    520: offsets.set_axis_offset,
    100: ondemand.set_data,
    53: ondemand.nurbs_end,
}


def motion_off(machine: Machine, _block: Block, _motion: int) -> None:
    """G80."""
    machine.state.motion = NO_MOTION
    machine.emit.comment("interpreter: motion mode set to none")


MOTIONS: dict[int, Callable[[Machine, Block, int], None]] = {
    0: straight,
    10: straight,
    20: arc,
    30: arc,
    50: ondemand.spline,
    51: ondemand.spline,
    52: ondemand.nurbs_point,
    330: ondemand.synchronised,
    331: ondemand.synchronised,
    382: ondemand.probe,
    383: ondemand.probe,
    384: ondemand.probe,
    385: ondemand.probe,
    760: ondemand.threading_cycle,
    NO_MOTION: motion_off,
    **dict.fromkeys(CYCLES, ondemand.canned_cycle),
    **dict.fromkeys(LATHE_PROFILES, ondemand.lathe_cycle),
}


def motion(machine: Machine, block: Block) -> None:
    """The motion code of the line, explicit or modal."""
    code = block.motion
    assert code is not None
    if code not in CYCLES:
        machine.cycle.initial = None
    MOTIONS[code](machine, block, code)


def spindle(machine: Machine, block: Block) -> None:
    """M3, M4, M5 and M19; M70 to M73 share their group."""
    if block.m[SPINDLE] >= 70:
        ondemand.saved_state(machine, block)
    else:
        auxiliary.turn_spindle(machine, block)


ORDER: tuple[Stage, ...] = (
    Stage("comment", "", comments.comment),
    Stage("g", SPINDLE_MODE, auxiliary.set_spindle_mode),
    Stage("g", FEED_MODE, modes.set_feed_mode),
    Stage("word", "f", modes.set_feed),
    Stage("word", "s", auxiliary.set_speed),
    Stage("word", "t", toolsteps.select_tool),
    Stage("m", IO, auxiliary.set_output),
    Stage("m", TOOL_CHANGE, toolsteps.change_tool),
    Stage("m", SPINDLE, spindle),
    Stage("m", COOLANT, auxiliary.set_coolant),
    Stage("m", OVERRIDE, auxiliary.set_override),
    Stage("m", USER, ondemand.user_command),
    Stage("g", MODAL_0, dwell),
    Stage("g", PLANE, modes.set_plane),
    Stage("g", UNITS, modes.set_units),
    Stage("g", LATHE_DIAMETER, modes.set_lathe_diameter),
    Stage("g", COMPENSATION, modes.set_compensation),
    Stage("g", TOOL_LENGTH, toolsteps.set_tool_length),
    Stage("g", COORDINATES, offsets.set_coordinate_system),
    Stage("g", CONTROL, modes.set_control),
    Stage("g", DISTANCE, modes.set_distance),
    Stage("g", IJK_DISTANCE, modes.set_ijk_distance),
    Stage("g", RETRACT, modes.set_retract),
    Stage("g", MODAL_0, modal_0),
    Stage("g", G92_APPLIED, offsets.apply_axis_offset),
    Stage("motion", MOTION, motion),
    Stage("m", STOPPING, stops.stop),
)


def execute(machine: Machine, block: Block) -> None:
    """Checks a block and runs its stages in order. Raises ``GcodeError``; commands go to ``machine.emit``."""
    state = machine.state
    machine.emit.line = block.line
    if state.lathe_diameter and "x" in block.words:
        block.words["x"] *= 0.5
    lenient = machine.dialect.lenient
    if lenient:
        from gcode.foreign import act, adapt

        adapt(machine, block)
        act(machine, block)
    choose_motion(block, state.motion, state.plane)
    if block.g.get(MODAL_0) == 530:
        check_g53(machine, block)
    check_words(block, machine.warnings if lenient else None)
    words, g, m = block.words, block.g, block.m
    for stage in ORDER:
        kind = stage.kind
        if kind == "g":
            if stage.key in g:
                stage.step(machine, block)
        elif kind == "word":
            if stage.key in words:
                stage.step(machine, block)
        elif kind == "m":
            if stage.key in m:
                stage.step(machine, block)
        elif kind == "motion":
            if block.motion is not None:
                stage.step(machine, block)
        elif block.comment is not None:
            stage.step(machine, block)
