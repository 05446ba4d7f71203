"""The moves of a program as rows that can be compared: what moves, where to, how fast; whatever the text says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from gcode.canon import AXES, KIND_ARC, KIND_RAPID, Arc, Command, Dwell, Feed, MoveBlock, Nurbs, Probe, Rapid, TiltedArc

DIGITS = 6


@dataclass(frozen=True, slots=True)
class Move:
    """One move. end: over the planned axes, mm or degrees; shape: what an arc or spline has beside it."""

    line: int
    kind: str
    end: tuple[float, ...]
    feed_mm_s: float
    shape: tuple[float, ...] = ()

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for moves that are the same motion, wherever they are written."""
        return self.kind, self.end, self.feed_mm_s, self.shape

    def words(self, axes: Sequence[str], before: Move | None) -> str:
        """The move as a person would say it: only the axes that go somewhere else than ``before``."""
        ends = [
            f"{axis}{value:g}" for k, (axis, value) in enumerate(zip(axes, self.end, strict=True))
            if before is None or before.end[k] != value
        ]  # fmt: skip
        feed = f" at {self.feed_mm_s:g} mm/s" if self.feed_mm_s else ""
        return f"{self.kind} {' '.join(ends) or 'in place'}{feed}"


def moves_of_program(commands: Iterable[Command | MoveBlock], axes: Sequence[str]) -> list[Move]:
    """Every move and dwell, in order."""
    return list(_moves(commands, axes))


def _moves(commands: Iterable[Command | MoveBlock], axes: Sequence[str]) -> Iterator[Move]:
    columns = [AXES.index(axis) for axis in axes]
    here = [0.0] * len(AXES)
    for command in commands:
        if isinstance(command, MoveBlock):
            where = [AXES.index(axis) for axis in command.axes]
            for row in range(len(command)):
                for column, value in zip(where, command.end[row].tolist(), strict=True):
                    here[column] = value
                shape: tuple[float, ...] = ()
                kind = "rapid" if command.kind[row] == KIND_RAPID else "feed"
                if command.kind[row] == KIND_ARC:
                    kind = "arc"
                    shape = _rounded([*command.center[row].tolist(), float(command.turns[row]), command.plane[row]])
                feed = 0.0 if kind == "rapid" else round(float(command.feed_mm_s[row]), DIGITS)
                yield Move(int(command.line[row]), kind, _rounded(here[c] for c in columns), feed, shape)
        elif isinstance(command, Dwell):
            yield Move(command.line, "dwell", _rounded(here[c] for c in columns), 0.0, (command.seconds,))
        elif isinstance(command, Rapid | Feed | Arc | TiltedArc | Nurbs | Probe):
            here = list(command.end)
            yield _of_command(command, _rounded(here[c] for c in columns))


def _of_command(command: Rapid | Feed | Arc | TiltedArc | Nurbs | Probe, end: tuple[float, ...]) -> Move:
    if isinstance(command, Rapid):
        return Move(command.line, "rapid", end, 0.0)
    feed = round(command.feed_mm_s, DIGITS)
    if isinstance(command, Arc):
        plane = float(("XY", "ZX", "YZ").index(command.plane))
        return Move(command.line, "arc", end, feed, _rounded([*command.center, float(command.turns), plane]))
    if isinstance(command, TiltedArc):
        plane = float(("XY", "ZX", "YZ").index(command.plane))
        shape = (*command.center[:3], command.rotation_deg, float(command.turns), plane)
        return Move(command.line, "arc", end, feed, _rounded(shape))
    if isinstance(command, Nurbs):
        return Move(command.line, "spline", end, feed, _rounded(x for point in command.points for x in point))
    return Move(command.line, "probe" if isinstance(command, Probe) else "feed", end, feed)


def _rounded(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(round(float(value), DIGITS) + 0.0 for value in values)
