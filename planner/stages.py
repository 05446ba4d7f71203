"""The stages of planning a stream: moves -> path chunks -> timed windows, each with bounded memory.

Path: a corner needs both its moves, and an arc the corners at both its ends. So the last two moves of what has come
are held back, with two more as context; everything before them is final and does not depend on how the stream was
cut.

Timing: the backward pass is run twice over what is held, once with a stop at the horizon and once with the highest
speed there. The one-step operator is monotone, so the truth lies between; at the last node where both agree the
future cannot matter. Everything before it is committed, and the result is that of one global solve.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from gcode.canon import Command, MoveBlock
from planner import kernel
from planner.constraints import Constraints
from planner.deviation import Deviation, deviation_of
from planner.fold import Folder
from planner.intervals import intervals_of
from planner.moves import Mark, Moves, join, no_moves
from planner.paths import cut, join_intervals, resting
from planner.polygon import PathRules, polygon_of
from planner.reader import MoveReader
from planner.rotary_table import to_joints
from planner.timing import NodeMark, Timed, corner_caps, speed_cap
from planner.types import F8, Intervals

HELD, CONTEXT = 4, 2


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """A stretch of the path. marks: node 0..N of the chunk. deviation: what was used of the tolerance."""

    intervals: Intervals
    marks: list[NodeMark]
    deviation: Deviation


class PathStage:
    """Batches of moves in, chunks of intervals out."""

    def __init__(self, start: F8, rules: PathRules) -> None:
        self._rules = rules
        self._held = no_moves(np.asarray(start, dtype=np.float64))
        self._done = 0
        self._marks: list[Mark] = []

    def push(self, moves: Moves, marks: list[Mark], last: bool) -> Chunk | None:
        """What is final of the path, or None if nothing yet; ``last``: the path ends here."""
        offset = len(self._held)
        every = join([self._held, moves])
        marks = [*self._marks, *(replace(m, moves=m.moves + offset) for m in marks)]
        upto = len(every) if last else len(every) - 2
        if upto <= self._done and not (last and marks):
            self._held, self._marks = every, marks
            return None
        chunk = self._chunk(every, [m for m in marks if m.moves <= upto], upto)
        context = min(CONTEXT, upto)
        self._held = every.part(upto - context, len(every))
        self._marks = [replace(m, moves=m.moves - (upto - context)) for m in marks if m.moves > upto]
        self._done = context
        return chunk

    def _chunk(self, every: Moves, marks: list[Mark], upto: int) -> Chunk:
        if not len(every):
            return Chunk(resting(every.start), [NodeMark(0, m.command) for m in marks], Deviation())
        polygon = polygon_of(every, self._rules)
        intervals, node = intervals_of(polygon, self._rules)
        of_move = node[polygon.vertex_of]
        first, end = int(of_move[self._done]), int(of_move[upto])
        vertices = slice(int(polygon.vertex_of[self._done]), int(polygon.vertex_of[upto]) + 1)
        placed = [NodeMark(int(of_move[m.moves]) - first, m.command) for m in marks]
        return Chunk(cut(intervals, first, end), placed, deviation_of(polygon, vertices))


class TimingStage:
    """Chunks of intervals in, committed windows out; ``x`` carries over from window to window."""

    def __init__(self, constraints: Constraints, drain_s: float = 0.0) -> None:
        self._constraints = constraints
        self._drain_s = drain_s
        self._parts: list[Intervals] = []
        self._marks: list[NodeMark] = []
        self._count = 0
        self._retained = 0
        self._x = 0.0
        self.solved = 0
        self.most_held = 0

    def push(self, chunk: Chunk, last: bool) -> Timed | None:
        """The window that the future cannot change, or None if more has to be read first."""
        self._marks += [replace(m, node=m.node + self._count) for m in chunk.marks]
        self._parts.append(chunk.intervals)
        self._count += len(chunk.intervals)
        self.most_held = max(self.most_held, self._count)
        if not last and self._count < 2 * self._retained:
            return None
        p = join_intervals(self._parts)
        x, cap, commit = self._solve(p, last)
        if commit == 0 and not last:
            self._parts, self._retained = [p], len(p)
            return None
        marks = [m for m in self._marks if m.node <= commit]
        self._marks = [replace(m, node=m.node - commit) for m in self._marks if m.node > commit]
        self._parts, self._count, self._retained = [cut(p, commit, len(p))], len(p) - commit, len(p) - commit
        self._x = float(x[commit])
        return Timed(cut(p, 0, commit), x[: commit + 1], cap[:commit], marks, self._drain_s)

    def _solve(self, p: Intervals, last: bool) -> tuple[F8, F8, int]:
        n = len(p)
        self.solved += n
        cap, node_cap = np.empty(n), np.zeros(n + 1)
        safe, hopeful, x = np.empty(n + 1), np.empty(n + 1), np.zeros(n + 1)
        if n == 0:
            return x, cap, 0
        c = self._constraints
        tangents = c.tangents(p)
        speed = speed_cap(p, tangents, c.velocity)
        limits = c.velocity, c.acceleration, corner_caps(p)
        kernel.node_caps(p.length, *tangents, speed, p.stop, *limits, cap, node_cap)
        kernel.backward(p.length, *tangents, c.acceleration, node_cap, 0.0, safe)
        commit = n
        if not last and node_cap[n] > 0:
            kernel.backward(p.length, *tangents, c.acceleration, node_cap, node_cap[n], hopeful)
            commit = int(kernel.commit_point(safe, hopeful))
        kernel.forward(p.length, *tangents, c.acceleration, safe, self._x, x)
        return x, cap, commit


def chunks(
    commands: Iterable[Command | MoveBlock], start: F8, rules: PathRules, moves: int
) -> Iterator[tuple[Chunk, bool]]:
    """The path in chunks of about ``moves`` moves, the last one marked. Raises PlanError."""
    table = rules.table
    program_start = table.axes_of(start[None, :], rules.axes)[0] if table is not None else start
    reader = MoveReader(rules.axes, program_start, rules.tolerance_mm)
    folder, path = Folder(start, rules.merge_share), PathStage(start, rules)
    ready: Chunk | None = None
    batches = reader.batches(commands, moves)
    if table is not None:
        batches = (to_joints(table, *b, rules.axes) for b in batches)
    batch = next(batches)
    while True:
        following = next(batches, None)
        last = following is None
        chunk = path.push(*folder.push(*batch, last), last)
        if chunk is not None:
            chunk = replace(chunk, deviation=replace(chunk.deviation, merge_mm=folder.merged_mm))
            if ready is not None:
                yield ready, False
            ready = chunk
        if following is None:
            break
        batch = following
    yield (ready or Chunk(resting(start), [], Deviation())), True
