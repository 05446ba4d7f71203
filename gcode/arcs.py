"""G2 and G3: centre or radius, all planes, helices, full circles and further turns.

Errors of arcs say what the two radii are and what would make the arc good, because decimals lost by a CAM and
absolute centres taken for relative ones are the commonest faults of real programs.
"""

from __future__ import annotations

import math

from gcode.arcgeometry import Point, distance, swept
from gcode.block import Block
from gcode.emit import PLANE_AXES
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.motion import INVERSE_TIME, check_feed, find_end, programmed_position, set_inverse_time

CENTER_LETTERS = {170: ("i", "j", "k"), 180: ("k", "i", "j"), 190: ("j", "k", "i")}
"""Centre words of the first and second axis of a plane, and the one that has no business there."""

RADIUS_TOLERANCE_MM = 0.00005 * 25.4
SPIRAL_RELATIVE = 0.001
SPIRAL_MM = 2 * 0.01 * math.sqrt(2.0)
SPIRAL_INCH = 2 * 0.001 * math.sqrt(2.0)
"""A start and an end radius may differ by this much (rounded coordinates), and by 0.1 % of the radius."""


def arc(machine: Machine, block: Block, motion: int) -> None:
    """G2 (clockwise) and G3, seen from the positive end of the plane's third axis."""
    state = machine.state
    name = "G2" if motion == 20 else "G3"
    if state.plane not in PLANE_AXES:
        raise GcodeError("GC048", f"{name} in plane G17.1, G18.1 or G19.1", "arcs need G17, G18 or G19", "motion")
    if machine.arc_forbidden:
        raise GcodeError(
            "GC095",
            f"{name} as the first move after G40",
            "the move that leaves compensation must be straight",
            "motion",
        )
    has_center = _check_words(machine, block, name)
    check_feed(machine, block, name)
    end = find_end(machine, block)
    state.motion = motion
    if machine.local is not None:
        from gcode.local import localize_arc

        letters = CENTER_LETTERS[state.plane][:2]
        block, motion = localize_arc(machine.local, block, motion, letters, absolute=state.ijk_absolute)
    first, second, third = PLANE_AXES[state.plane]
    compensation = machine.active_compensation()
    here = programmed_position(machine)
    start: Point = (here[first], here[second])
    stop: Point = (end[first], end[second])
    turns = block.whole("p") if "p" in block.words else 1
    center = (
        center_of_ijk(machine, block, start, stop)
        if has_center
        else center_ofdistance(machine, block, start, stop, motion)
    )
    turns = -turns if motion == 20 else turns
    if state.feed_mode == INVERSE_TIME:
        rise = end[third] - here[third]
        set_inverse_time(machine, block, math.hypot(distance(center, start) * swept(start, stop, center, turns), rise))
    if compensation is not None:
        if state.plane == 190:
            raise GcodeError("GC093", f"{name} in the YZ plane under compensation", "use G17 or G18", "motion")
        from gcode.compensatedarcs import arc_move

        arc_move(machine, compensation, end, center, turns, start)
        return
    machine.emit.arc(end, center, turns)
    state.position = end


def _check_words(machine: Machine, block: Block, name: str) -> bool:
    """Whether the arc has centre words; GC042, GC043, GC047, GC049 for a wrong set of words."""
    words, plane = block.words, machine.state.plane
    centers = [letter for letter in "ijk" if letter in words]
    if not centers and "r" not in words:
        raise GcodeError(
            "GC042", f"{name} without centre or radius", "give I J K (the centre) or R (the radius)", "motion"
        )
    if centers and "r" in words:
        raise GcodeError("GC043", f"{name} with both a centre and R", "keep one of them", "r")
    first, second, _ = PLANE_AXES[plane]
    one, two, wrong = CENTER_LETTERS[plane]
    if not centers:
        axes = ("xyz"[first], "xyz"[second])
        polar = plane == 170 and ("@" in words or "^" in words)
        if not polar and axes[0] not in words and axes[1] not in words:
            raise GcodeError(
                "GC042",
                f"{name} R without an end point in its plane",
                f"give {axes[0].upper()} or {axes[1].upper()}; a full circle needs a centre",
                "motion",
            )
        return False
    if wrong in words and (words[wrong] != 0.0 or len(centers) == 1):
        raise GcodeError(
            "GC047",
            f"{wrong.upper()} has no meaning for an arc in this plane",
            f"{name} takes {one.upper()} and {two.upper()} here; or choose another plane with G17, G18 or G19",
            wrong,
        )
    if wrong in words:
        machine.warn("GC205", f"{wrong.upper()}0 is ignored in this plane", "remove it", wrong)
    if machine.state.ijk_absolute:
        for letter in (one, two):
            if letter not in words:
                raise GcodeError(
                    "GC049", f"absolute arc centre without {letter.upper()}", "G90.1 needs both centre words", "motion"
                )
    return True


def center_of_ijk(machine: Machine, block: Block, start: Point, stop: Point) -> Point:
    """The centre from I J K; GC044 if start and end do not lie on one circle about it, GC048 for radius zero."""
    state, words = machine.state, block.words
    one, two, _ = CENTER_LETTERS[state.plane]
    i, j = words.get(one, 0.0), words.get(two, 0.0)
    center = (i, j) if state.ijk_absolute else (start[0] + i, start[1] + j)
    r1, r2 = distance(center, start), distance(center, stop)
    tolerance = RADIUS_TOLERANCE_MM / state.unit_mm
    if r1 < tolerance or r2 < tolerance:
        raise GcodeError(
            "GC048",
            f"an arc of radius zero (start radius {r1:.4g}, end radius {r2:.4g})",
            "check the centre words",
            one,
        )
    error = abs(r1 - r2)
    allowed = SPIRAL_MM if state.unit_mm == 1.0 else SPIRAL_INCH
    if error > 100.0 * allowed or (error > SPIRAL_RELATIVE * max(r1, r2) and error > allowed):
        raise _radii_differ(machine, (i, j), start, stop, (r1, r2))
    if error > 0.25 * allowed:
        machine.warn(
            "GC206",
            f"the radii at start and end differ by {error:.4g}",
            "more decimals in the program make it exact",
            "motion",
        )
    return center


def _radii_differ(machine: Machine, ij: Point, start: Point, stop: Point, radii: tuple[float, float]) -> GcodeError:
    """GC044 with the cure that fits: the other centre mode, a wrong sign, or lost decimals."""
    r1, r2 = radii
    state = machine.state
    unit = "mm" if state.unit_mm == 1.0 else "inch"
    one, two, _ = CENTER_LETTERS[state.plane]
    hint = "use R, or give the centre with more decimals"

    def fits(center: Point) -> bool:
        a, b = distance(center, start), distance(center, stop)
        return a > 0.0 and abs(a - b) <= max(1e-3 * a, 0.03 / state.unit_mm)

    other = (start[0] + ij[0], start[1] + ij[1]) if state.ijk_absolute else ij
    if fits(other):
        wanted = "G91.1 (relative centres)" if state.ijk_absolute else "G90.1 (absolute centres)"
        hint = f"the centre fits as the other kind: did you mean {wanted}?"
    elif not state.ijk_absolute:
        for i, j, which in ((-ij[0], ij[1], one), (ij[0], -ij[1], two), (-ij[0], -ij[1], f"{one} and {two}")):
            if fits((start[0] + i, start[1] + j)):
                hint = f"it fits with the sign of {which.upper()} changed"
                break
        else:
            if abs(r1 - r2) < 0.02 * max(r1, r2):
                hint = "decimals were probably lost: post with more digits, or use R"
            else:
                hint = "did you mean G90.1 (absolute centre) or R, or were decimals lost?"
    return GcodeError(
        "GC044",
        f"arc radii differ by {abs(r1 - r2):.4g} {unit}: start r = {r1:.4f}, end r = {r2:.4f}",
        hint,
        "arc centre",
    )


def center_ofdistance(machine: Machine, block: Block, start: Point, stop: Point, motion: int) -> Point:
    """The centre from R (negative: the arc of more than a half circle). GC045, GC046."""
    radius = block.words["r"]
    if start == stop:
        raise GcodeError(
            "GC046", "an arc with R that ends where it starts", "a full circle needs its centre: use I and J", "r"
        )
    half = math.hypot(stop[0] - start[0], stop[1] - start[1]) / 2.0
    tolerance = RADIUS_TOLERANCE_MM / machine.state.unit_mm
    size = abs(radius)
    if half - size > tolerance:
        raise GcodeError(
            "GC045",
            f"R{radius:g} is too small: the end is {2 * half:.4f} away",
            f"R must be at least {half:.4f}; check the end point",
            "r",
        )
    if size == 0.0:
        raise GcodeError("GC048", "an arc of radius zero", "check R", "r")
    if half / size > 1.0 - 1e-12:
        half = size
    theta = math.atan2(stop[1] - start[1], stop[0] - start[0])
    clockwise = motion == 20
    theta += math.pi / 2.0 if clockwise == (radius < 0.0) else -math.pi / 2.0
    offset = size * math.cos(math.asin(half / size))
    middle = ((start[0] + stop[0]) / 2.0, (start[1] + stop[1]) / 2.0)
    return middle[0] + offset * math.cos(theta), middle[1] + offset * math.sin(theta)
