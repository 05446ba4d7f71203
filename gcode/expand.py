"""Blocks of moves taken apart into commands, for those who want them one by one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from gcode.canon import AXES, KIND_FEED, KIND_RAPID, ORIGIN, PLANES, Arc, Command, Feed, MoveBlock, Position, Rapid


def expanded(stream: Iterable[Command | MoveBlock]) -> Iterator[Command]:
    """Every command of ``stream``, in order."""
    last: Position = ORIGIN
    for item in stream:
        if isinstance(item, MoveBlock):
            for command in block_commands(item, last):
                if isinstance(command, Rapid | Feed | Arc):
                    last = command.end
                yield command
            continue
        end = getattr(item, "end", None)
        if end is not None:
            last = end
        yield item


def block_commands(block: MoveBlock, before: Position) -> Iterator[Command]:
    """The commands of one block; axes that it does not name stand where ``before`` has them."""
    columns = [AXES.index(name) for name in block.axes]
    rows = zip(
        block.kind.tolist(),
        block.line.tolist(),
        block.end.tolist(),
        block.feed_mm_s.tolist(),
        block.plane.tolist(),
        block.center.tolist(),
        block.turns.tolist(),
        strict=True,
    )
    notes = list(block.notes)
    place = list(before)
    for number, (kind, line, end, feed, plane, center, turns) in enumerate(rows):
        while notes and notes[0][0] <= number:
            yield notes.pop(0)[1]
        for column, value in zip(columns, end, strict=True):
            place[column] = value
        x, y, z, a, b, c, u, v, w = place
        target = (x, y, z, a, b, c, u, v, w)
        if kind == KIND_RAPID:
            yield Rapid(line, target)
        elif kind == KIND_FEED:
            yield Feed(line, target, feed)
        else:
            yield Arc(line, target, (center[0], center[1]), PLANES[plane], turns, feed)
    for _, note in notes:
        yield note
