"""The whole profile of a lathe cycle: orientation, offset, and the passes that clear (G71, G72) or follow it (G70)."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field

from gcode.latheprofile import COARSE, NEAR, Segment, Tool, join, make_corner, profile_error

_MAPS: tuple[Callable[[complex], complex], ...] = (
    lambda p: p,
    lambda p: -p.conjugate(),
    lambda p: p.conjugate(),
    lambda p: -p,
    lambda p: 1j * p,
    lambda p: (1j * p).conjugate(),
    lambda p: -(1j * p).conjugate(),
    lambda p: -1j * p,
)
"""Back from the prepared orientation to the machine's, by the bits 1 (Z mirrored), 2 (X mirrored), 4 (turned)."""


@dataclass(frozen=True, slots=True)
class Oriented:
    """A tool that receives the moves of a prepared profile in the machine's orientation."""

    tool: Tool
    state: int

    def line(self, end: complex) -> None:
        """Feed."""
        self.tool.line(_MAPS[self.state](end))

    def rapid(self, end: complex) -> None:
        """Rapid."""
        self.tool.rapid(_MAPS[self.state](end))

    def arc(self, ccw: bool, center: complex, end: complex) -> None:
        """Arc; one mirror changes its sense."""
        back = _MAPS[self.state]
        self.tool.arc(ccw != (self.state in {1, 2, 5, 6}), back(center), back(end))


@dataclass(slots=True)
class Path:
    """A profile. ``step``: depth of a pass. ``escape``: how far the tool leaves the wall between passes."""

    segments: list[Segment]
    step: float = 0.5
    escape: complex = 0.3 + 0.3j
    state: int = 0
    starts: list[complex] = field(default_factory=list)

    def duplicate(self) -> Path:
        """A copy with its own segments."""
        return Path([copy(segment) for segment in self.segments], self.step, self.escape, self.state)

    def turn(self) -> None:
        """Exchanges the roles of X and Z."""
        for segment in self.segments:
            segment.turned()
        self.state ^= 4

    def orient(self) -> None:
        """Mirrors the profile so that it runs towards -Z and ends high."""
        span = self.segments[0].end - self.segments[-1].end
        if span.imag > 0.0:
            for segment in self.segments:
                segment.mirrored(x=True)
            self.state ^= 2
        if span.real < 0.0:
            for segment in self.segments:
                segment.mirrored(x=False)
            self.state ^= 1

    def prepare(self) -> None:
        """Makes the corners and checks that the profile never turns back."""
        for index in range(1, len(self.segments) - 1):
            if self.segments[index].finish != 0.0:
                make_corner(self.segments[index], self.segments[index - 1], self.segments[index + 1])
        self.segments = [segment for segment in self.segments if segment.size() >= COARSE]
        if not self.segments:
            raise profile_error("the profile has no length")
        first = self.segments[0]
        if (first.end - first.start).real > 0.0:
            first.start = complex(first.end.real, first.start.imag)
        if not all(segment.is_monotonic() for segment in self.segments):
            raise profile_error("the profile turns back in Z")

    def should_turn(self) -> bool:
        """Whether the profile only runs one way when X and Z are exchanged."""
        trial = self.duplicate()
        trial.segments.pop(0)
        trial.orient()
        return not all(segment.is_monotonic() for segment in trial.segments)

    def finish(
        self, tool: Tool, start: complex, allowance: tuple[float, float], passes: int, comp: Callable[[bool], None]
    ) -> None:
        """G70: ``passes`` cuts along the profile, first to last allowance. ``comp`` switches compensation."""
        self.segments[0].start = start
        if self.should_turn():
            self.turn()
        self.orient()
        self.prepare()
        out = Oriented(tool, self.state)
        first, last = allowance
        for number in range(passes, 0, -1):
            path = self.duplicate()
            path.offset((number - 1) * (first - last) / passes + last)
            comp(False)
            out.rapid(path.segments[0].start)
            comp(True)
            out.rapid(path.segments[0].end)
            for segment in path.segments[1:]:
                segment.draw(out)

    def rough(self, tool: Tool, kind: int, start: complex, shift: complex, leave: float) -> None:
        """G71 (G72 after ``turn``): clears the material in passes and leaves ``leave``; kinds 0 to 2 treat pockets."""
        self.segments[0].start = start
        self.orient()
        self.prepare()
        self.offset(leave)
        for segment in self.segments:
            segment.moved(shift)
        out = Oriented(tool, self.state)
        first, last = self.segments[0], self.segments[-1]
        out.rapid(first.start)
        if last.end.imag < first.start.imag:
            self.segments.append(Segment(last.end, complex(last.end.real, first.start.imag)))
        self.starts = [first.start]
        self._pockets(kind, first.start, out)

    def _pockets(self, kind: int, at: complex, out: Tool) -> None:
        """Passes from top to bottom; a climb that ends in a new fall begins the next pocket."""
        index = 0
        while True:
            going = self._pocket(kind, at, index, out)
            if going is None:
                return
            kind, at, index = going

    def _pocket(self, kind: int, at: complex, index: int, out: Tool) -> tuple[int, complex, int] | None:
        """One pocket. None: all is cut; else where the next one begins."""
        segments = self.segments
        x = self.starts[-1].imag
        if kind == 2:
            while index < len(segments):
                at, stays = segments[index].dive(at, -1e9, out, fast=index == 0)
                if stays:
                    break
                index += 1
            kind = 3
        while index < len(segments):
            while x - NEAR > at.imag:
                x -= self.step
            at, stays = segments[index].dive(at, x, out, fast=index == 0)
            if stays:
                return self._climb(kind, at, index, out)
            if index == len(segments) - 1:
                return None
            if abs(at.imag - x) > NEAR or segments[index].end == at:
                index += 1
                continue
            index, x = self._pass(at, index, x, out)
        return None

    def _climb(self, kind: int, at: complex, index: int, out: Tool) -> tuple[int, complex, int] | None:
        """Out of the pocket along the profile."""
        segments = self.segments
        if kind == 1:
            for segment in segments[index:]:
                at = segment.climb_over(at, out)
            return None
        for position in range(index, len(segments)):
            at, ends = segments[position].climb(at, out)
            if ends:
                if kind == 3:
                    if at.imag > self.starts[-1].imag and len(self.starts) > 1:
                        self.starts.pop()
                    if len(self.starts) == 1:
                        self.starts.append(at)
                return kind, at, position
        return None

    def _pass(self, at: complex, index: int, x: float, out: Tool) -> tuple[int, float]:
        """One straight cut at the present height to the next wall and back. Gives the segment and the next height."""
        for position in range(index, len(self.segments)):
            segment = self.segments[position]
            meets = segment.at_height(at.imag)
            if not meets:
                continue
            goal = meets[0] if position != index else meets[-1]
            distance = abs(goal - at.real)
            if goal - NEAR > at.real:
                continue
            if distance < NEAR:
                if position == index:
                    continue
                if abs(at - segment.start) < NEAR:
                    return position, x
                return index, x - self.step
            out.line(complex(goal, at.imag))
            scale = min(1.0, distance / 2.0 / self.escape.real) if self.escape.real else 1.0
            out.rapid(complex(goal, at.imag) + scale * self.escape)
            out.rapid(at - (scale * self.escape).conjugate())
            (out.rapid if index == 0 else out.line)(at)
            return index, x - self.step
        raise profile_error("a pass does not meet the profile")

    def offset(self, distance: float) -> None:
        """Moves all but the approach sideways by ``distance``, in steps small enough for its smallest arc."""
        approach = self.segments.pop(0)
        if not self.segments:
            self.segments.insert(0, approach)
            return
        first = approach.end - approach.start
        whole = self.segments[-1].start - approach.start
        if whole and (first / whole).imag < 0.0:
            distance = -distance
        done = 0.0
        while done != distance and self.segments:
            step = min([1e9, *(segment.size() / 2.0 for segment in self.segments), abs(distance - done)])
            if step < 1e-12:
                break
            step = -step if distance < 0.0 else step
            self._offset_once(step, distance)
            done += step
        for a, b in zip(self.segments, self.segments[1:], strict=False):
            a.end = b.start = (a.end + b.start) / 2.0
        if self.segments:
            approach.end = self.segments[0].start
        self.segments.insert(0, approach)

    def _offset_once(self, step: float, distance: float) -> None:
        for segment in self.segments:
            segment.offset(step)
        self.segments = [segment for segment in self.segments if segment.size() >= COARSE]
        joined = self.segments[:1]
        for segment in self.segments[1:]:
            before = joined[-1]
            if (before.end - segment.start).real > 1e-2:
                a, b = copy(before), copy(segment)
                a.offset(-step)
                b.offset(-step)
                joined.append(Segment(before.end, segment.start, (a.end + b.start) / 2.0, distance > 0.0))
            joined.append(segment)
        self.segments = joined
        self._trim()

    def _trim(self) -> None:
        """Joins neighbours; pieces that vanished or turned back are left out."""
        segments = self.segments
        index = 0
        while index < len(segments) - 1:
            if not segments[index].is_monotonic() and index > 0:
                smaller = index if segments[index].size() < segments[index - 1].size() else index - 1
                del segments[smaller]
                index = 0
                if len(segments) < 2:
                    return
            if segments[index].size() < COARSE:
                del segments[index]
                index = 0
            else:
                join(segments[index], segments[index + 1])
            index += 1
