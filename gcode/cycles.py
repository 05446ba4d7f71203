"""Canned cycles G73, G74, G81 to G89 in all planes: drilling, boring and tapping made of plain moves.

One hole is: over the hole, down to the R plane, the cycle's own moves, up to the clear plane. Words are sticky: a line
that only names a new position repeats the cycle with the old depth, R, P, Q and offsets. The clear plane is R (G99) or
the height at which the first cycle of the series began (G98).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gcode.block import Block
from gcode.canon import Dwell, PathControl, Stop
from gcode.codes import g_name
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.memory import CycleMemory
from gcode.motion import find_end
from gcode.state import State

CYCLE_AXES = {170: (0, 1, 2), 180: (2, 0, 1), 190: (1, 2, 0), 171: (6, 7, 8), 181: (8, 6, 7), 191: (7, 8, 6)}
LETTERS = "xyzabcuvw"
PECK_CLEARANCE_MM = 0.254
"""How far above the last depth a peck ends its rapid (0.010 inch)."""
OFFSET_LETTERS = {170: "ijk", 180: "kij", 190: "jki", 171: "ijk", 181: "kij", 191: "jki"}


@dataclass(frozen=True, slots=True)
class Hole:
    """One hole: position in the plane, heights along the third axis, and the sticky words."""

    a: float
    b: float
    r: float
    clear: float
    bottom: float
    words: dict[str, float]


class Cycle:
    """The moves of one cycle line: knows the plane and moves in its three axes."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.state: State = machine.state
        self.axes = CYCLE_AXES[self.state.plane]

    def _end(self, a: float, b: float, c: float) -> list[float]:
        end = list(self.state.position)
        first, second, third = self.axes
        end[first], end[second], end[third] = a, b, c
        return end

    def traverse(self, a: float, b: float, c: float) -> None:
        """Rapid to (a, b) in the plane and c along its third axis."""
        self.machine.emit.rapid(self._end(a, b, c))

    def feed(self, a: float, b: float, c: float) -> None:
        """Feed to (a, b, c)."""
        self.machine.emit.feed(self._end(a, b, c))

    def tap_feed(self, a: float, b: float, c: float) -> None:
        """Feed of G74 and G84. LinuxCNC exchanges the axes once too often here outside G17; its dialect does so too."""
        plane = self.state.plane
        if plane == 170 or not self.machine.dialect.tap_axes_as_linuxcnc:
            self.feed(a, b, c)
            return
        self.machine.warn(
            "GC208",
            "LinuxCNC taps along another axis here: G74 and G84 are only right in G17",
            "select G17, or another dialect",
            "motion",
        )
        first, second, third = (b, c, a) if plane == 180 else (c, a, b)
        self.feed(first, second, third)

    def dwell(self, seconds: float) -> None:
        """Rest."""
        self.machine.emit.command(Dwell(self.machine.emit.line, seconds))

    def spindle(self, direction: int) -> None:
        """Turns the spindle: 1, -1 or 0."""
        self.state.spindle_direction = direction
        names = {1: "START_SPINDLE_CLOCKWISE(0)", -1: "START_SPINDLE_COUNTERCLOCKWISE(0)", 0: "STOP_SPINDLE_TURNING(0)"}
        self.machine.emit.spindle(names[direction])


def canned_cycle(machine: Machine, block: Block, motion: int) -> None:
    """Executes a cycle line. GC053 to GC056 for what is missing or impossible."""
    state = machine.state
    memory = machine.cycle
    _check(machine, block, motion)
    sticky = state.motion == motion
    first, second, third = CYCLE_AXES[state.plane]
    if not sticky:
        keep = memory.words.get("p") if motion in {740, 840} else None
        memory.words = {} if keep is None else {"p": keep}
    words = _words(block, memory, motion, sticky)
    depth_letter = LETTERS[third]
    if depth_letter in block.words:
        memory.depth = block.words[depth_letter]
    elif not sticky:
        raise GcodeError(
            "GC053", f"{g_name(motion)} without {depth_letter.upper()}", "give the depth of the hole", "motion"
        )
    present = state.position[third]
    if memory.initial is None:
        memory.initial = present
    old = memory.initial
    r = words["r"] + old if state.incremental else words["r"]
    bottom = r + memory.depth if state.incremental else memory.depth
    if r < bottom:
        raise GcodeError(
            "GC054", f"the R plane ({r:g}) is below the bottom ({bottom:g})", "R must be above the depth", "r"
        )
    cycle = Cycle(machine)
    a, b = state.position[first], state.position[second]
    if old < r:
        cycle.traverse(a, b, r)
        old = present = r
    clear = r if state.retract == 990 else old
    _with_exact_path(machine, lambda: _holes(cycle, block, motion, Hole(a, b, r, clear, bottom, words), present))
    state.motion = motion


def _check(machine: Machine, block: Block, motion: int) -> None:
    state = machine.state
    name = g_name(motion)
    if state.feed == 0.0:
        raise GcodeError("GC040", f"{name} with no feed rate", "give F on this line or before it", "motion")
    if state.feed_mode == 930:
        raise GcodeError("GC055", f"{name} in inverse time mode", "switch to G94 before the cycle", "motion")
    if state.compensation != 400:
        raise GcodeError("GC090", f"{name} under cutter compensation", "end it with G40 and a move first", "motion")
    wrong = "uvw" if state.plane in {170, 180, 190} else "xyz"
    for letter in wrong:
        if letter in block.words:
            raise GcodeError(
                "GC027", f"{letter.upper()} in a canned cycle of this plane", "move that axis on a line before", letter
            )
    if block.words.get("l") == 0.0:
        raise GcodeError("GC056", "a cycle repeated zero times", "L must be 1 or more", "l")


MOST_STROKES = 100_000
"""Strokes of one line at most: a slip in L or Q may not fill the memory."""
REQUIRED = {820: "p", 860: "p", 880: "p", 890: "p", 730: "q", 830: "q", 870: "ijk"}
MEANING = {"p": "P is the dwell in seconds", "q": "Q is the depth of a peck", "r": "R is the height of the clear plane"}


def _words(block: Block, memory: CycleMemory, motion: int, sticky: bool) -> dict[str, float]:
    """The words of the cycle, sticky ones included. GC053 if one is missing."""
    for letter in "rpqijk":
        if letter in block.words:
            memory.words[letter] = block.words[letter]
    words = dict(memory.words)
    for letter in "r" + REQUIRED.get(motion, ""):
        if letter not in words:
            hint = MEANING.get(letter, "I, J and K place the boring bar")
            raise GcodeError("GC053", f"{g_name(motion)} without {letter.upper()}", hint, "motion")
    if motion in {730, 830} and words["q"] <= 0.0:
        raise GcodeError("GC056", "a peck depth of zero or less", "Q must be above zero", "q")
    if "d" in block.words:
        words["d"] = block.words["d"]
    words.setdefault("p", 0.0)
    return words


def _with_exact_path(machine: Machine, run: Callable[[], None]) -> None:
    """Runs the cycle in exact path mode and restores the mode after it."""
    state, emit = machine.state, machine.emit
    if state.control == 610:
        run()
        return
    emit.command(PathControl(emit.line, "exact_path"))
    run()
    if state.control == 611:
        emit.command(PathControl(emit.line, "exact_stop"))
        emit.text("SET_NAIVECAM_TOLERANCE(0.0000)")
        return
    unit = state.unit_mm
    tolerance = None if state.tolerance is None else state.tolerance * unit
    merge = None if state.merge is None else state.merge * unit
    emit.command(PathControl(emit.line, "continuous", tolerance, merge))


def _holes(cycle: Cycle, block: Block, motion: int, hole: Hole, present: float) -> None:
    """All repeats of one line; incremental ones step on."""
    state = cycle.state
    first, second, third = cycle.axes
    a, b = hole.a, hole.b
    repeats = block.whole("l") if "l" in block.words else 1
    pecks = (hole.r - hole.bottom) / hole.words["q"] if motion in {730, 830} else 1.0
    if repeats * max(pecks, 1.0) > MOST_STROKES:
        at = "l" if repeats > MOST_STROKES else "motion"
        raise GcodeError("GC056", f"a cycle of more than {MOST_STROKES} strokes on one line", "check L and Q", at)
    for repeat in range(repeats):
        if repeat == 0 or state.incremental:
            a, b = _next_position(cycle.machine, block, cycle.axes)
        one = Hole(a, b, hole.r, hole.clear, hole.bottom, hole.words)
        if repeat == 0 and present > hole.r:
            cycle.traverse(a, b, present)
            cycle.traverse(a, b, hole.r)
        else:
            cycle.traverse(a, b, hole.clear)
            if hole.clear > hole.r:
                cycle.traverse(a, b, hole.r)
        CYCLES[motion](cycle, one)
        state.position[first], state.position[second], state.position[third] = a, b, hole.clear


def _next_position(machine: Machine, block: Block, axes: tuple[int, int, int]) -> tuple[float, float]:
    """Where the next hole is: the words of the plane's two axes, or polar words in G17."""
    letters = {LETTERS[axes[0]], LETTERS[axes[1]], "@", "^"}
    words = {letter: value for letter, value in block.words.items() if letter in letters}
    end = find_end(machine, Block(block.line, words=words))
    return end[axes[0]], end[axes[1]]


def _g81(cycle: Cycle, hole: Hole) -> None:
    """Drill."""
    cycle.feed(hole.a, hole.b, hole.bottom)
    cycle.traverse(hole.a, hole.b, hole.clear)


def _g82(cycle: Cycle, hole: Hole) -> None:
    """Drill and rest."""
    cycle.feed(hole.a, hole.b, hole.bottom)
    cycle.dwell(hole.words["p"])
    cycle.traverse(hole.a, hole.b, hole.clear)


def _peck(cycle: Cycle, hole: Hole, *, full_retract: bool) -> None:
    delta = hole.words["q"]
    lift = hole.words.get("d", PECK_CLEARANCE_MM / cycle.state.unit_mm)
    depth = hole.r - delta
    while depth > hole.bottom:
        cycle.feed(hole.a, hole.b, depth)
        if full_retract:
            cycle.traverse(hole.a, hole.b, hole.r)
        cycle.traverse(hole.a, hole.b, depth + lift)
        depth -= delta
    cycle.feed(hole.a, hole.b, hole.bottom)
    cycle.traverse(hole.a, hole.b, hole.clear)


def _g73(cycle: Cycle, hole: Hole) -> None:
    """Chip breaking: pecks with a small lift."""
    _peck(cycle, hole, full_retract=False)


def _g83(cycle: Cycle, hole: Hole) -> None:
    """Deep drilling: pecks with full retract."""
    _peck(cycle, hole, full_retract=True)


def _tap(cycle: Cycle, hole: Hole, direction: int) -> None:
    """Down, turn back, up, turn forth; overrides are off meanwhile."""
    state, emit = cycle.state, cycle.machine.emit
    name = "G84" if direction > 0 else "G74"
    if state.spindle_direction != direction:
        raise GcodeError(
            "GC071",
            f"{name} needs the spindle turning {'clockwise' if direction > 0 else 'counter-clockwise'}",
            f"start it with {'M3' if direction > 0 else 'M4'}",
            "motion",
        )
    emit.text("DISABLE_FEED_OVERRIDE()")
    emit.text("DISABLE_SPEED_OVERRIDE(0)")
    cycle.tap_feed(hole.a, hole.b, hole.bottom)
    cycle.spindle(0)
    cycle.spindle(-direction)
    cycle.dwell(hole.words["p"])
    cycle.tap_feed(hole.a, hole.b, hole.clear)
    cycle.spindle(0)
    cycle.spindle(direction)
    if state.feed_override:
        emit.text("ENABLE_FEED_OVERRIDE()")
    if state.speed_override:
        emit.text("ENABLE_SPEED_OVERRIDE(0)")


def _g84(cycle: Cycle, hole: Hole) -> None:
    """Right-hand tap."""
    _tap(cycle, hole, 1)


def _g74(cycle: Cycle, hole: Hole) -> None:
    """Left-hand tap."""
    _tap(cycle, hole, -1)


def _g85(cycle: Cycle, hole: Hole) -> None:
    """Bore, feed out."""
    cycle.feed(hole.a, hole.b, hole.bottom)
    cycle.feed(hole.a, hole.b, hole.r)
    cycle.traverse(hole.a, hole.b, hole.clear)


def _turning(cycle: Cycle, name: str) -> int:
    direction = cycle.state.spindle_direction
    if direction == 0:
        raise GcodeError("GC071", f"{name} with the spindle at rest", "start it with M3 or M4", "motion")
    return direction


def _g86(cycle: Cycle, hole: Hole) -> None:
    """Bore, stop the spindle, rapid out."""
    direction = _turning(cycle, "G86")
    cycle.feed(hole.a, hole.b, hole.bottom)
    cycle.dwell(hole.words["p"])
    cycle.spindle(0)
    cycle.traverse(hole.a, hole.b, hole.clear)
    cycle.spindle(direction)


def _g87(cycle: Cycle, hole: Hole) -> None:
    """Back boring: in beside the hole with the spindle oriented, bore upwards, out the same way."""
    direction = _turning(cycle, "G87")
    one, two, three = tuple(OFFSET_LETTERS[cycle.state.plane])
    a, b = hole.a + hole.words[one], hole.b + hole.words[two]
    middle = hole.words[three] + (hole.bottom if cycle.state.incremental else 0.0)
    orient = f"ORIENT_SPINDLE(0, 0.0000, {2 if direction > 0 else 3})"
    cycle.traverse(a, b, hole.r)
    cycle.spindle(0)
    cycle.machine.emit.text(orient)
    cycle.traverse(a, b, hole.bottom)
    cycle.traverse(hole.a, hole.b, hole.bottom)
    cycle.spindle(direction)
    cycle.feed(hole.a, hole.b, middle)
    cycle.feed(hole.a, hole.b, hole.bottom)
    cycle.spindle(0)
    cycle.machine.emit.text(orient)
    cycle.traverse(a, b, hole.bottom)
    cycle.traverse(a, b, hole.clear)
    cycle.traverse(hole.a, hole.b, hole.clear)
    cycle.spindle(direction)


def _g88(cycle: Cycle, hole: Hole) -> None:
    """Bore, stop, and let the operator retract."""
    direction = _turning(cycle, "G88")
    cycle.feed(hole.a, hole.b, hole.bottom)
    cycle.dwell(hole.words["p"])
    cycle.spindle(0)
    cycle.machine.emit.command(Stop(cycle.machine.emit.line, False))
    cycle.spindle(direction)


def _g89(cycle: Cycle, hole: Hole) -> None:
    """Bore, rest, feed out."""
    cycle.feed(hole.a, hole.b, hole.bottom)
    cycle.dwell(hole.words["p"])
    cycle.feed(hole.a, hole.b, hole.clear)


CYCLES: dict[int, Callable[[Cycle, Hole], None]] = {
    730: _g73,
    740: _g74,
    810: _g81,
    820: _g82,
    830: _g83,
    840: _g84,
    850: _g85,
    860: _g86,
    870: _g87,
    880: _g88,
    890: _g89,
}
