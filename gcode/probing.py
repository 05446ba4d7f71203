"""G38.2 to G38.5: straight probes. The machine says where the probe tripped; parameters 5061 to 5070 take it."""

from __future__ import annotations

from gcode.block import Block
from gcode.codes import g_name
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.modes import refuse_under_compensation
from gcode.motion import find_end


def probe(machine: Machine, block: Block, motion: int) -> None:
    """Towards the part (.2, .3) or away from it (.4, .5); .2 and .4 are faults if nothing trips."""
    state = machine.state
    name = g_name(motion)
    refuse_under_compensation(machine, name, "motion")
    if state.feed == 0.0 or state.feed_mode == 930:
        raise GcodeError("GC040", f"{name} with no feed rate", "give F in G94 before it", "motion")
    if state.feed_mode == 950:
        raise GcodeError("GC055", f"{name} in feed per revolution", "switch to G94 before it", "motion")
    end = find_end(machine, block)
    if end == state.position and motion in {382, 384}:
        raise GcodeError("GC058", f"{name} to where the machine already stands", "give a point further on", "motion")
    machine.emit.probe(end, away=motion in {384, 385}, required=motion in {382, 384})
    state.position = end
    state.motion = motion
    machine.wait("probe")
