"""What other dialects add to RS274/NGC: units G70/G71, dwells in ms, G12/G13, G15/G16, G50/G51, G54.1, G68/G69.

``adapt`` rewrites a block of another dialect into one that the order of execution understands, and ``act`` executes
the codes that it has no place for.
"""

from __future__ import annotations

from gcode.arcs import arc
from gcode.block import Block
from gcode.codes import COORDINATES, CYCLES, MODAL_0, MOTION, UNITS, g_name
from gcode.dialects import Dialect
from gcode.errors import GcodeError
from gcode.foreigngroups import POCKET, POLAR, SCALING, TURN
from gcode.local import Local, plane_axes
from gcode.machine import Machine
from gcode.motion import check_feed, straight
from gcode.offsets import set_system


def adapt(machine: Machine, block: Block) -> None:
    """Rewrites what other dialects write differently."""
    dialect, g, words = machine.dialect, block.g, block.words
    if dialect.units_g70_g71 and g.get(MOTION) in {700, 710} and "q" not in words:
        g[UNITS] = 200 if g.pop(MOTION) == 700 else 210
    if dialect.reference_with_motion and g.get(MODAL_0) in {280, 300} and g.get(MOTION) in {0, 10}:
        machine.state.motion = g.pop(MOTION)
    if dialect.lenient and g.get(MODAL_0) == 530 and not block.has_axes():
        machine.warn("GC214", "G53 without an axis word does nothing", "remove it", "G53")
        del g[MODAL_0]
    if g.get(MODAL_0) == 40:
        _adapt_dwell(dialect, words)
    elif dialect.dwell_ms and (block.motion in CYCLES or g.get(MOTION) in CYCLES) and "p" in words:
        words["p"] /= 1000.0


def _adapt_dwell(dialect: Dialect, words: dict[str, float]) -> None:
    if dialect.dwell_ms and "p" in words:
        words["p"] /= 1000.0
    for letter in "xu":
        if dialect.dwell_ms and letter in words and "p" not in words:
            words["p"] = words.pop(letter)


def act(machine: Machine, block: Block) -> None:
    """Executes the codes of other dialects on a line; they take the line's words with them."""
    g, words = block.g, block.words
    if POLAR in g:
        local(machine).polar = g.pop(POLAR) == 160
    if SCALING in g:
        _scale(machine, block, g.pop(SCALING))
    if TURN in g:
        _turn(machine, block, g.pop(TURN))
    if g.get(COORDINATES) == 541:
        number = block.whole("p") if "p" in words else 0
        if not 1 <= number <= 9:
            raise GcodeError("GC064", "G54.1 needs P1 to P9", "there are nine coordinate systems here", "g")
        del g[COORDINATES], words["p"]
        set_system(machine, number)
    if POCKET in g:
        _pocket(machine, block, g.pop(POCKET))
    if machine.local is not None and machine.local.is_identity():
        machine.local = None


def local(machine: Machine) -> Local:
    """The local transformation, begun if there was none."""
    if machine.local is None:
        machine.local = Local(plane_axes(machine.state.plane))
    found: Local = machine.local
    return found


def _scale(machine: Machine, block: Block, code: int) -> None:
    if code == 500:
        if machine.local is not None:
            machine.local.factors = [1.0, 1.0, 1.0]
        return
    words, here = block.words, machine.state.position
    transform = local(machine)
    if machine.dialect.name == "mach":
        transform.factors = [words.pop(letter, 1.0) for letter in "xyz"]
        transform.scale_center = [0.0, 0.0, 0.0]
    else:
        transform.scale_center = [words.pop(letter, here[axis]) for axis, letter in enumerate("xyz")]
        all_axes = _factor(words.pop("p", 1.0))
        transform.factors = [_factor(words.pop(letter, all_axes)) for letter in "ijk"]
    if 0.0 in transform.factors:
        raise GcodeError("GC098", "scaling by zero", "a factor of 1 leaves the size", "g")


def _factor(value: float) -> float:
    """Scale factors without a decimal point count thousandths on Fanuc: 2000 is 2."""
    return value / 1000.0 if abs(value) >= 100.0 else value


def _turn(machine: Machine, block: Block, code: int) -> None:
    if code == 690:
        if machine.local is not None:
            machine.local.turn_deg = 0.0
        return
    words = block.words
    if "r" not in words:
        raise GcodeError("GC025", "G68 without R", "R is the angle in degrees", "g")
    transform = local(machine)
    transform.axes = plane_axes(machine.state.plane)
    first, second, _ = transform.axes
    here = machine.state.position
    names = "xyz"
    center = (words.pop(names[first], here[first]), words.pop(names[second], here[second]))
    transform.turn_center = center
    transform.turn_deg = words.pop("r")


def _pocket(machine: Machine, block: Block, code: int) -> None:
    """G12 (clockwise) and G13: from the centre out by I, one full circle, and back."""
    words, state = block.words, machine.state
    if words.get("i", 0.0) <= 0.0:
        raise GcodeError("GC025", f"{g_name(code)} without I", "I is the radius of the circle", "g")
    check_feed(machine, block, g_name(code))
    first, second, _ = plane_axes(state.plane)
    radius, names = words.pop("i"), "xyz"
    center = list(state.position)
    modal, absolute = state.motion, state.ijk_absolute
    incremental, state.incremental, state.ijk_absolute = state.incremental, False, False
    letters = (names[first], names[second])
    straight(machine, Block(block.line, words={letters[0]: center[first] + radius}), 10)
    centers = {170: "i", 180: "k", 190: "j"}
    arc(machine, Block(block.line, words={centers[state.plane]: -radius}), 20 if code == 120 else 30)
    straight(machine, Block(block.line, words={letters[0]: center[first]}), 10)
    state.motion, state.ijk_absolute, state.incremental = modal, absolute, incremental
