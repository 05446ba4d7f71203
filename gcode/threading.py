"""Motion tied to the spindle: G33 (synchronised feed), G33.1 (rigid tap) and G76 (threading cycle)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gcode.block import Block
from gcode.codes import g_name
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.modes import refuse_under_compensation
from gcode.motion import find_end


def _needs_spindle(machine: Machine, name: str) -> None:
    if machine.state.spindle_direction == 0:
        raise GcodeError("GC071", f"{name} with the spindle at rest", "start it with M3 or M4", "motion")


def synchronised(machine: Machine, block: Block, motion: int) -> None:
    """G33 and G33.1: K is the pitch."""
    _needs_spindle(machine, g_name(motion))
    refuse_under_compensation(machine, g_name(motion), "motion")
    state, emit = machine.state, machine.emit
    state.motion = motion
    end = find_end(machine, block)
    pitch = block.words["k"]
    emit.synchronise(pitch)
    if motion == 330:
        emit.feed(end)
        state.position = end
    else:
        emit.rigid_tap(end, pitch)
    emit.synchronise(None)


MOST_PASSES = 10_000
"""Passes of one thread at most."""


@dataclass(frozen=True, slots=True)
class Thread:
    """A G76 thread: the drive line's X, heights from it, and the shape of entry and exit."""

    sign: float
    safe_x: float
    start: list[float]
    end_depth: float
    target_z: float
    pitch: float
    taper_pitch: float
    taper: float
    entry: bool
    exit: bool
    height: float


def threading_cycle(machine: Machine, block: Block) -> None:
    """G76: P pitch, Z end, I peak, J first and K full depth, R degression, Q angle, H springs, E taper, L ends."""
    words, state = block.words, machine.state
    _needs_spindle(machine, "G76")
    refuse_under_compensation(machine, "G76", "motion")
    for letter in "pijk":
        if letter not in words:
            raise GcodeError("GC053", f"G76 without {letter.upper()}", "it needs P, I, J and K", "motion")
    end = find_end(machine, block)
    if any(end[axis] != state.position[axis] for axis in (3, 4, 5, 6, 7, 8)):
        raise GcodeError("GC027", "G76 moves X and Z only", "move the other axes on a line before", "motion")
    factor = 0.5 if state.lathe_diameter else 1.0
    peak, first, full = words["i"], words["j"], words["k"]
    if peak == 0.0 or first <= 0.0 or full <= first:
        raise GcodeError(
            "GC059", "G76 needs I not 0, J above 0 and K above J", "see the depths of the thread", "motion"
        )
    peak, first, full = peak * factor, first * factor, full * factor
    state.motion = 760
    angle = max(words.get("q", 0.0), 0.0) * math.pi / 180.0
    angle = -angle if end[2] > state.position[2] else angle
    thread = _thread(machine, block, end, peak, full, angle)
    degression = max(words.get("r", 1.0), 1.0)
    springs = block.whole("h") if "h" in words else 0
    if degression * math.log(full / first) > math.log(MOST_PASSES) or springs > MOST_PASSES:
        raise GcodeError("GC059", f"a thread of more than {MOST_PASSES} passes", "check J, K, R and H", "motion")
    depth, number = abs(peak) + first, 1
    while depth < thread.end_depth:
        _pass(machine, thread, depth, (depth - abs(peak)) * math.tan(angle))
        number += 1
        depth = abs(peak) + first * number ** (1.0 / degression)
    for _ in range(springs + 1):
        _pass(machine, thread, thread.end_depth, full * math.tan(angle))
    machine.emit.rapid(end)
    state.position = end


def _thread(machine: Machine, block: Block, end: list[float], peak: float, full: float, angle: float) -> Thread:
    words, state = block.words, machine.state
    taper = max(words.get("e", 0.0), 0.0)
    pitch = words["p"]
    ends = int(words.get("l", 0.0))
    return Thread(
        sign=1.0 if peak > 0.0 else -1.0,
        safe_x=state.position[0],
        start=list(state.position),
        end_depth=abs(full) + abs(peak),
        target_z=end[2] + full * math.tan(angle),
        pitch=pitch,
        taper_pitch=pitch * math.hypot(taper, full) / taper if taper else pitch,
        taper=-taper if end[2] > state.position[2] else taper,
        entry=bool(taper) and bool(ends & 1),
        exit=bool(taper) and bool(ends & 2),
        height=full,
    )


def _pass(machine: Machine, thread: Thread, depth: float, z_shift: float) -> None:
    """One pass at ``depth`` from the drive line: in, along the thread with the spindle, out; tapers at its ends."""
    emit = machine.emit

    def point(x: float, z: float) -> list[float]:
        place = list(thread.start)
        place[0], place[2] = thread.safe_x + thread.sign * x, z
        return place

    start_z, end_z = thread.start[2] - z_shift, thread.target_z - z_shift
    emit.rapid(point(depth - thread.end_depth, start_z))
    if thread.entry:
        emit.text("DISABLE_FEED_OVERRIDE()")
        emit.synchronise(thread.taper_pitch)
        emit.feed(point(depth - thread.height, start_z))
        emit.feed(point(depth, start_z - thread.taper))
        emit.synchronise(thread.pitch)
    else:
        emit.rapid(point(depth, start_z))
        emit.text("DISABLE_FEED_OVERRIDE()")
        emit.synchronise(thread.pitch)
    if thread.exit:
        emit.feed(point(depth, end_z + thread.taper))
        emit.synchronise(thread.taper_pitch)
        emit.feed(point(depth - thread.height, end_z))
    else:
        emit.feed(point(depth, end_z))
    emit.synchronise(None)
    emit.rapid(point(depth - thread.end_depth, end_z))
    emit.text("ENABLE_FEED_OVERRIDE()")
