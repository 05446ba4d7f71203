"""The timeline of a live trajectory: pieces settled so far, cut off and continued as the rate changes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.timing import Pieces
from planner.types import F8, Event


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """Pieces from ``origin_s`` on, over the intervals of one path, with the events among them."""

    origin_s: float
    pieces: Pieces
    events: tuple[Event, ...] = ()

    @property
    def end_s(self) -> float:
        """Time of the end of the last piece."""
        return self.origin_s + float(self.pieces.duration_s.sum())

    def ends(self) -> F8:
        """End of each piece, f8[M]."""
        return np.asarray(self.origin_s + np.cumsum(self.pieces.duration_s))

    def extended(self, pieces: Pieces, events: list[Event], first_interval: int) -> Timeline:
        """With ``pieces`` put behind; their intervals count from ``first_interval``, event times from the end."""
        end = self.end_s
        shifted = replace(pieces, interval=pieces.interval + np.int32(first_interval))
        later = tuple(replace(e, time_s=e.time_s + end) for e in events)
        return Timeline(self.origin_s, joined(self.pieces, shifted), self.events + later)

    def upto(self, count: int, last_duration_s: float | None = None) -> Timeline:
        """The first ``count`` pieces, the last of them shortened; events stay."""
        pieces = part(self.pieces, 0, count)
        if last_duration_s is not None:
            duration = pieces.duration_s.copy()
            duration[-1] = last_duration_s
            pieces = replace(pieces, duration_s=duration)
        return replace(self, pieces=pieces)

    def without(self, count: int, intervals: int) -> Timeline:
        """Without the first ``count`` pieces and with interval numbers lowered by ``intervals``; events stay."""
        origin = self.origin_s + float(self.pieces.duration_s[:count].sum())
        rest = part(self.pieces, count, len(self.pieces))
        return Timeline(origin, replace(rest, interval=rest.interval - np.int32(intervals)), self.events)


def no_pieces() -> Pieces:
    """Pieces of no time."""
    none = np.zeros(0)
    return Pieces(none, np.zeros(0, np.int32), none, none, none)


def rest_piece(seconds: float, interval: int, offset_mm: float) -> Pieces:
    """One rest."""
    zero = np.zeros(1)
    return Pieces(np.array([seconds]), np.array([interval], dtype=np.int32), np.array([offset_mm]), zero, zero)


def part(p: Pieces, first: int, last: int) -> Pieces:
    """Pieces first .. last - 1, as views."""
    s = slice(first, last)
    return Pieces(p.duration_s[s], p.interval[s], p.offset_mm[s], p.speed_mm_s[s], p.accel_mm_s2[s])


def joined(a: Pieces, b: Pieces) -> Pieces:
    """``a`` followed by ``b``."""
    return Pieces(
        np.concatenate([a.duration_s, b.duration_s]),
        np.concatenate([a.interval, b.interval]),
        np.concatenate([a.offset_mm, b.offset_mm]),
        np.concatenate([a.speed_mm_s, b.speed_mm_s]),
        np.concatenate([a.accel_mm_s2, b.accel_mm_s2]),
    )
