"""G70 (finish), G71 and G72 (rough along Z or X): the profile stands in a subprogram that Q names."""

from __future__ import annotations

from gcode.arcs import arc
from gcode.block import Block
from gcode.codes import g_name
from gcode.compensation import flush
from gcode.errors import GcodeError
from gcode.lathepath import Path
from gcode.latheprofile import Segment, profile_error
from gcode.machine import Machine
from gcode.motion import straight


class _MachineTool:
    """Moves the machine in X and Z, absolute, with absolute centres."""

    def __init__(self, machine: Machine, line: int) -> None:
        self.machine = machine
        self.line_number = line

    def _block(self, end: complex, **words: float) -> Block:
        return Block(self.line_number, words={"x": end.imag, "z": end.real, **words})

    def line(self, end: complex) -> None:
        """G1."""
        straight(self.machine, self._block(end), 10)

    def rapid(self, end: complex) -> None:
        """G0."""
        straight(self.machine, self._block(end), 0)

    def arc(self, ccw: bool, center: complex, end: complex) -> None:
        """G2 or G3, unless it has no length."""
        position = self.machine.state.position
        if abs(position[2] - end.real) >= 1e-6 or abs(position[0] - end.imag) >= 1e-6:
            arc(self.machine, self._block(end, i=center.imag, k=center.real), 30 if ccw else 20)


def lathe_cycle(machine: Machine, block: Block, motion: int) -> None:
    """Reads the profile of subprogram Q and cuts it."""
    words, state = dict(block.words), machine.state
    cycle, kind = divmod(motion, 10)
    name = g_name(motion)
    if "q" not in words:
        raise GcodeError("GC053", f"{name} without Q", "Q is the number of the subprogram with the profile", "motion")
    if machine.compensation is not None and cycle != 70:
        raise GcodeError("GC090", f"{name} under cutter compensation", "only G70 follows a compensated path", "motion")
    if state.plane != 180:
        raise GcodeError("GC093", f"{name} outside the ZX plane", "select G18 first", "motion")
    if words.get("i", 1.0) <= 0.0:
        raise GcodeError("GC056", "a depth of cut of zero or less", "I must be above zero", "i")
    incremental, ijk_absolute = state.incremental, state.ijk_absolute
    compensation = machine.compensation
    state.incremental, state.ijk_absolute = False, True
    try:
        start_x, start_z = state.position[0], state.position[2]
        x = words.get("x", 0.0) + start_x if incremental else words.get("x", start_x)
        z = words.get("z", 0.0) + start_z if incremental else words.get("z", start_z)
        tool = _MachineTool(machine, block.line)
        machine.compensation = None
        tool.rapid(complex(words.get("z", start_z), words.get("x", start_x)))
        machine.compensation = compensation
        segments, last = _profile(machine, int(words["q"]), complex(z, x), incremental, ijk_absolute)
        state.position[0], state.position[2] = start_x, start_z
        if len(segments) > 1:
            _cut(machine, tool, cycle, kind, segments, complex(z, x), last, words)
    finally:
        state.incremental, state.ijk_absolute = incremental, ijk_absolute
        machine.compensation = compensation


def _cut(
    machine: Machine,
    tool: _MachineTool,
    cycle: int,
    kind: int,
    segments: list[Segment],
    start: complex,
    last: complex,
    words: dict[str, float],
) -> None:
    first = segments[0].end - segments[0].start
    back = segments[-1].end - segments[-1].start
    path = Path(segments)
    if cycle == 70:
        compensation = machine.compensation

        def switch(on: bool) -> None:
            """Between passes compensation is off; each pass enters it anew."""
            if not on:
                flush(machine)
                if compensation is not None:
                    compensation.first = True
            machine.compensation = compensation if on else None

        allowance = (words.get("d", 0.0), words.get("e", 0.0))
        path.finish(tool, start, allowance, int(words.get("p", 1.0)), switch)
        return
    if cycle == 71 and abs(back.real) > 0.0 and first.imag * (start.imag - last.imag) < 0.0:
        segments.append(Segment(last, complex(last.real, start.imag)))
    if cycle == 72 and abs(back.imag) > 0.0 and first.real * (start.real - last.real) < 0.0:
        segments.append(Segment(last, complex(start.real, last.imag)))
    path.step = max(words.get("i", 1.0), 2e-6)
    path.escape = words.get("r", 0.5) * (1.0 + 1.0j)
    path.segments[0].start = start
    if cycle == 72:
        path.turn()
        start = path.segments[0].start
    path.rough(tool, kind, start, complex(words.get("w", 0.0), words.get("u", 0.0)), words.get("d", 0.0))


def _profile(
    machine: Machine, number: int, start: complex, incremental: bool, ijk_absolute: bool
) -> tuple[list[Segment], complex]:
    """The segments between the cycle's start and the end of the subprogram, and that end."""
    segments: list[Segment] = []
    state = machine.state
    for line in machine.profile(str(number)):
        words = line.words
        if state.lathe_diameter:
            for letter in "xu":
                if letter in words:
                    words[letter] /= 2.0
        code = line.g.get("motion")
        if code is not None:
            state.motion = code
        end = _end(words, start, incremental)
        if end == start:
            continue
        if state.motion in {0, 10}:
            segments.append(Segment(start, end))
        elif state.motion in {20, 30}:
            segments.append(_arc(words, start, end, ccw=state.motion == 30, absolute=ijk_absolute))
        if state.motion in {0, 10, 20, 30}:
            segments.extend(_corner(words, end))
        state.position[0], state.position[2] = end.imag, end.real
        start = end
    return segments, start


def _end(words: dict[str, float], start: complex, incremental: bool) -> complex:
    if incremental and ("u" in words or "w" in words):
        raise profile_error("U and W cannot be used in G91")
    if ("u" in words and "x" in words) or ("w" in words and "z" in words):
        raise profile_error("U with X, or W with Z, on one line")
    base = 0.0 + 0.0j if incremental else start
    z, x = words.get("z", base.real), words.get("x", base.imag)
    z, x = z + words.get("w", 0.0), x + words.get("u", 0.0)
    return complex(z, x) + (start if incremental else 0.0)


def _arc(words: dict[str, float], start: complex, end: complex, *, ccw: bool, absolute: bool) -> Segment:
    if "r" in words:
        if "i" in words or "k" in words:
            raise profile_error("an arc with both R and a centre")
        chord = end - start
        size = abs(chord) ** 2
        square = words["r"] ** 2 - size / 4.0
        if square < 0.0:
            raise profile_error(f"R{words['r']:g} is too small for its arc")
        across = 1j * (square / size) ** 0.5 * chord
        return Segment(start, end, (start + end) / 2.0 + (across if ccw else -across), ccw)
    if "i" not in words and "k" not in words:
        raise profile_error("an arc without centre or radius")
    center = complex(words.get("k", 0.0), words.get("i", 0.0)) + (0.0 if absolute else start)
    r1, r2 = abs(start - center), abs(end - center)
    if abs(r1 - r2) > 0.03 and abs(r1 - r2) > 1e-3 * max(r1, r2):
        raise profile_error(f"arc radii differ: start r = {r1:.4f}, end r = {r2:.4f}")
    return Segment(start, end, center, ccw)


def _corner(words: dict[str, float], end: complex) -> list[Segment]:
    """A rounds and C breaks the corner at the end of the line."""
    if "a" in words and "c" in words:
        raise profile_error("both A and C at one corner")
    if "a" in words:
        return [Segment(end, end, end, finish=words["a"])]
    if "c" in words:
        return [Segment(end, end, finish=words["c"])]
    return []
