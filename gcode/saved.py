"""M70 to M73: saving and restoring the modes.

They are restored as a programmer would: by executing lines with the codes that differ. So every restored mode is
announced to the machine like any other change.
"""

from __future__ import annotations

from dataclasses import dataclass

from gcode.block import Block
from gcode.codes import SPINDLE, g_name
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.offsets import SYSTEMS


@dataclass(frozen=True, slots=True)
class SavedModes:
    """The modes at one moment: G codes in tenths, M codes, and the numbers that belong to them."""

    g: tuple[int, ...]
    m: tuple[int, ...]
    feed: float
    spindle_rpm: float
    tolerance: float | None
    merge: float | None
    unit: int


def save_modes(machine: Machine) -> SavedModes:
    """The modes of now."""
    state = machine.state
    spindle = {0: 5, 1: 3, -1: 4}[state.spindle_direction]
    g = (
        state.plane,
        910 if state.incremental else 900,
        state.feed_mode,
        SYSTEMS[state.system - 1],
        state.retract,
        state.control,
        state.spindle_mode,
        901 if state.ijk_absolute else 911,
        70 if state.lathe_diameter else 80,
    )
    m = (spindle, 7 if state.mist else -1, 8 if state.flood else -1, 48 if state.feed_override else 49)
    unit = 200 if state.unit_mm != 1.0 else 210
    return SavedModes(g, m, state.feed, state.spindle_rpm, state.tolerance, state.merge, unit)


def restore_modes(machine: Machine, saved: SavedModes) -> None:
    """Executes what brings the modes back to ``saved``."""
    now = save_modes(machine)
    if now.unit != saved.unit:
        machine.run_text(g_name(saved.unit))
    now = save_modes(machine)
    words = []
    if saved.feed != now.feed:
        words.append(f"F{saved.feed:.1f}")
    if saved.spindle_rpm != now.spindle_rpm:
        words.append(f"S{saved.spindle_rpm:.0f}")
    words += [
        g_name(want) for have, want in zip(now.g, saved.g, strict=True) if want != have and want not in {640, 960}
    ]
    path = (saved.g[5], saved.tolerance, saved.merge)
    if saved.g[5] == 640 and path != (now.g[5], now.tolerance, now.merge):
        words.append("G64")
        if saved.tolerance is not None:
            words.append(f"P{saved.tolerance:f}")
            if saved.merge is not None:
                words.append(f"Q{saved.merge:f}")
    if words:
        machine.run_text(" ".join(words))
    if now.m[1:3] != saved.m[1:3] and -1 in saved.m[1:3]:
        machine.run_text("M9")
    for have, want in zip(now.m, saved.m, strict=True):
        if want not in {have, -1} or (want in {7, 8} and -1 in saved.m[1:3]):
            machine.run_text(f"M{want}")


def saved_state(machine: Machine, block: Block) -> None:
    """M70 (save), M71 (forget), M72 (restore), M73 (save, and restore on return)."""
    code = block.m[SPINDLE]
    context = machine.contexts[-1]
    if code in {70, 73}:
        context.modes = save_modes(machine)
        context.restore = code == 73 and len(machine.contexts) > 1
        if code == 73 and len(machine.contexts) == 1:
            machine.warn("GC207", "M73 in the main program: there is no return to restore at", "use M70 and M72", "M73")
    elif code == 71:
        context.modes = None
    else:
        if not isinstance(context.modes, SavedModes):
            raise GcodeError("GC088", "M72 without a saved state", "save it with M70 first", "M72")
        restore_modes(machine, context.modes)
