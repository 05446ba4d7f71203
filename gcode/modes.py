"""Steps that set a mode: plane, units, distance, feed mode and feed, retract, path control, lathe diameter."""

from __future__ import annotations

from gcode.block import Block
from gcode.canon import PathControl
from gcode.codes import (
    COMPENSATION,
    CONTROL,
    DISTANCE,
    FEED_MODE,
    IJK_DISTANCE,
    LATHE_DIAMETER,
    PLANE,
    RETRACT,
    UNITS,
)
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.ondemand import flush, switch_on_compensation

PLANE_TEXT = {170: "XY", 180: "XZ", 190: "YZ", 171: "UNKNOWN", 181: "UNKNOWN", 191: "UNKNOWN"}
FEED_MODE_TEXT = {930: "inverse time", 940: "units per minute", 950: "units per revolution"}


def refuse_under_compensation(machine: Machine, what: str, at: str = "g") -> None:
    """GC090 if cutter compensation is on."""
    if machine.state.compensation != 400:
        raise GcodeError("GC090", f"{what} under cutter compensation", "end it with G40 and a move first", at)


def set_plane(machine: Machine, block: Block) -> None:
    """G17 to G19.1."""
    code = block.g[PLANE]
    state = machine.state
    if code != state.plane:
        refuse_under_compensation(machine, "a change of plane")
    state.plane = code
    machine.emit.text(f"SELECT_PLANE(CANON_PLANE_{PLANE_TEXT[code]})")


def set_units(machine: Machine, block: Block) -> None:
    """G20 and G21."""
    inch = block.g[UNITS] == 200
    if inch != (machine.state.unit_mm != 1.0):
        refuse_under_compensation(machine, "a change of units")
    machine.state.convert_units(25.4 if inch else 1.0)
    machine.emit.frame_change(f"USE_LENGTH_UNITS(CANON_UNITS_{'INCHES' if inch else 'MM'})")


def set_distance(machine: Machine, block: Block) -> None:
    """G90 and G91."""
    incremental = block.g[DISTANCE] == 910
    if incremental != machine.state.incremental:
        machine.state.incremental = incremental
        kind = "incremental" if incremental else "absolute"
        machine.emit.comment(f"interpreter: distance mode changed to {kind}")


def set_ijk_distance(machine: Machine, block: Block) -> None:
    """G90.1 and G91.1."""
    absolute = block.g[IJK_DISTANCE] == 901
    if absolute != machine.state.ijk_absolute:
        machine.state.ijk_absolute = absolute
        kind = "absolute" if absolute else "incremental"
        machine.emit.comment(f"interpreter: IJK distance mode changed to {kind}")


def set_feed_mode(machine: Machine, block: Block) -> None:
    """G93, G94 and G95. G94 and G95 forget the feed: the old number meant something else."""
    code = block.g[FEED_MODE]
    state, emit = machine.state, machine.emit
    state.feed_mode = code
    emit.comment(f"interpreter: feed mode set to {FEED_MODE_TEXT[code]}")
    emit.text(f"SET_FEED_MODE(0, {int(code == 950)})")
    if code != 930:
        state.feed = 0.0
        emit.text("SET_FEED_RATE(0.0000)")


def set_feed(machine: Machine, block: Block) -> None:
    """F in G94 and G95; in G93 it belongs to the move."""
    if machine.state.feed_mode == 930:
        return
    machine.state.feed = block.words["f"]
    machine.emit.text(f"SET_FEED_RATE({block.words['f']:.4f})")


def set_retract(machine: Machine, block: Block) -> None:
    """G98 and G99."""
    refuse_under_compensation(machine, "a change of the retract mode")
    code = block.g[RETRACT]
    machine.state.retract = code
    machine.emit.comment(f"interpreter: retract mode set to {'old_z' if code == 980 else 'r_plane'}")


def set_compensation(machine: Machine, block: Block) -> None:
    """G40 to G42.1."""
    if block.g[COMPENSATION] == 400:
        switch_off_compensation(machine)
    else:
        switch_on_compensation(machine, block)


def switch_off_compensation(machine: Machine) -> None:
    """G40: the last held move ends where it was meant to; the next move leads away from the part."""
    state = machine.state
    compensation = machine.compensation
    if compensation is not None:
        flush(machine)
        if compensation.radius > 0.0 and not compensation.first and compensation.programmed is not None:
            state.position = compensation.programmed
            machine.arc_forbidden = True
    machine.compensation = None
    state.compensation = 400
    machine.emit.comment("interpreter: cutter radius compensation off")


def set_control(machine: Machine, block: Block) -> None:
    """G61, G61.1, G64 P Q."""
    refuse_under_compensation(machine, "a change of path control")
    code = block.g[CONTROL]
    state, emit = machine.state, machine.emit
    state.control = code
    if code != 640:
        emit.command(PathControl(emit.line, "exact_path" if code == 610 else "exact_stop"))
        return
    if "r" in block.words:
        _set_planner(machine, block.words["r"])
    tolerance, merge = block.words.get("p", -1.0), block.words.get("q", -1.0)
    state.tolerance = tolerance if tolerance >= 0.0 else None
    state.merge = merge if merge >= 0.0 else None
    unit = state.unit_mm
    emit.command(
        PathControl(
            emit.line,
            "continuous",
            None if state.tolerance is None else state.tolerance * unit,
            None if state.merge is None else state.merge * unit,
        )
    )


def _set_planner(machine: Machine, scale: float) -> None:
    """G64 R of LinuxCNC's present source: which planner it takes, and its share of the peak. Told, but not followed."""
    kind, share = (1, min(max(scale, 0.1), 1.0)) if scale > 0.0 else (0, -1.0)
    machine.emit.text(f"SET_PLANNER_MODE(type={kind}, peak_scale={share:.6f})")


def set_lathe_diameter(machine: Machine, block: Block) -> None:
    """G7 and G8. The X word of this very line is already meant in the new mode."""
    diameter = block.g[LATHE_DIAMETER] == 70
    if diameter == machine.state.lathe_diameter:
        return
    machine.state.lathe_diameter = diameter
    factor = 0.5 if diameter else 2.0
    letters = ("x", "i", "j", "k") if block.motion == 760 else ("x",)
    for letter in letters:
        if letter in block.words:
            block.words[letter] *= factor
    machine.emit.comment(f"interpreter: Lathe diameter mode changed to {'diameter' if diameter else 'radius'}")
