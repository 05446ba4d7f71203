"""Fold moves too short to be edges, and merge near-collinear feed moves where G64 Q asks for it.

Both walk the program once from front to back and keep what they have not decided, so every split of the program into
batches gives the same moves. The merge is greedy: from an anchor it takes in move after move while all vertices
passed over stay within the tolerance of the chord and in order along it; their largest distance is the verified
deviation. Source: LinuxCNC's naive CAM detector (G64 Q) for what may be merged.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from planner.moves import COLUMNS, KIND_ARC, KIND_FEED, MODE_CONTINUOUS, Mark, Moves, join, no_moves
from planner.types import F8

SHORTEST_MM = 1e-6
"""moves shorter than this are folded into their neighbour."""
LONGEST_CHAIN = 64
"""moves one merged move may replace."""


class Folder:
    """Batches of moves in, batches of fewer moves out; ``merged_mm``: largest verified deviation of the merge so
    far."""

    def __init__(self, start: F8, merge_share: float) -> None:
        self.merged_mm = 0.0
        self.share = merge_share
        self._held = no_moves(np.asarray(start, dtype=np.float64))
        self._marks: list[Mark] = []

    def push(self, moves: Moves, marks: list[Mark], last: bool) -> tuple[Moves, list[Mark]]:
        """Decided moves with their marks; ``last``: nothing follows, decide all."""
        offset = len(self._held)
        every = join([self._held, moves])
        marks = [*self._marks, *(replace(m, moves=m.moves + offset) for m in marks)]
        keep = self._kept(every)
        kept = np.flatnonzero(keep)
        if last:
            decided = len(every)
        else:
            # a move that later ones could still be folded into stays behind with all after it
            decided = int(kept[-2]) + 1 if len(kept) > 1 else 0
        self._held = every.part(decided, len(every))
        count = np.concatenate([[0], np.cumsum(keep[:decided])])
        done = [replace(m, moves=int(count[m.moves])) for m in marks if m.moves <= decided]
        self._marks = [replace(m, moves=m.moves - decided) for m in marks if m.moves > decided]
        return _only(every.part(0, decided), keep[:decided], last), done

    def _kept(self, moves: Moves) -> npt.NDArray[np.bool_]:
        n = len(moves)
        keep = np.ones(n, dtype=np.bool_)
        if not n:
            return keep
        from planner.merge import drop_tiny, merge

        drop_tiny(moves.start, moves.end, moves.kind == KIND_ARC, SHORTEST_MM, keep)
        if self.share > 0 and (moves.merge_mm > 0).any():
            tolerance = np.minimum(moves.merge_mm, moves.tolerance_mm * self.share)
            free = (moves.kind == KIND_FEED) & (moves.mode == MODE_CONTINUOUS) & ~moves.stop & (tolerance > 0)
            joint = np.zeros(n, dtype=np.bool_)
            joint[:-1] = free[:-1] & (moves.kind[1:] == KIND_FEED) & (moves.feed_mm_s[1:] == moves.feed_mm_s[:-1])
            worst = merge(moves.start, moves.end, tolerance, joint, LONGEST_CHAIN, keep)
            self.merged_mm = max(self.merged_mm, worst)
        return keep


def _only(moves: Moves, keep: npt.NDArray[np.bool_], last: bool) -> Moves:
    """The moves to keep; the stop of a folded move goes to the one before it, the last end stays the program's."""
    if keep.all():
        return moves
    kept = np.flatnonzero(keep)
    if not len(kept):
        return no_moves(moves.start, moves.rest_first or bool(moves.stop.any()))
    columns = {name: getattr(moves, name)[kept] for name in COLUMNS}
    columns["stop"] = np.logical_or.reduceat(moves.stop, kept)
    rest_first = moves.rest_first or bool(moves.stop[: kept[0]].any())
    if last:
        columns["end"] = columns["end"].copy()
        columns["end"][-1] = moves.end[-1]
    return Moves(moves.start, rest_first, **columns)
