"""The motion of a plan as a table of text: one row each time the program comes to a line, so that a change shows its
line and leaves the rows of all other lines as they are.

A row has the line, how long the program is in it, and where it ends; curved stretches have three more places on the
way, in rows that begin with ``~``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from planner.jerk import FilteredTrajectory
from planner.trajectory import PathTrajectory
from planner.types import F8

CURVED_MM = 0.02
MOST_ROWS = 4000
ON_THE_WAY = (0.25, 0.5, 0.75)


@dataclass(frozen=True, slots=True, eq=False)
class Row:
    """The program in ``line`` for ``time_s``, ending at ``end``; ``via``: places at a quarter, half, three quarters."""

    line: int
    time_s: float
    end: tuple[float, ...]
    via: tuple[tuple[float, ...], ...] = ()


def motion_rows(trajectory: PathTrajectory | FilteredTrajectory) -> Iterator[str]:
    """The rows of a trajectory as text; of very long programs several lines share a row."""
    base = trajectory.base if isinstance(trajectory, FilteredTrajectory) else trajectory
    line = base.intervals.line[base.pieces.interval]
    new = np.flatnonzero(np.concatenate([[True], np.diff(line) != 0]))
    new = new[:: max(1, -(-len(new) // MOST_ROWS))]
    begin = base.begin_s[new]
    end = np.append(begin[1:], trajectory.duration_s)
    places = trajectory.q(end)
    first = trajectory.q(begin)
    via = np.stack([trajectory.q(begin + share * (end - begin)) for share in ON_THE_WAY])
    yield "line        time_s " + " ".join(f"{axis:>11}" for axis in trajectory.axes)
    for k in range(len(new)):
        yield f"N{line[new[k]]:<7d} {end[k] - begin[k]:9.6f} {_place(places[k])}"
        if _curved(first[k], places[k], via[:, k]):
            for row in via[:, k]:
                yield f"~{'':17} {_place(row)}"


def _place(values: F8) -> str:
    return " ".join(f"{value + 0.0:11.4f}" for value in np.round(values, 4) + 0.0)


def _curved(first: F8, last: F8, via: F8) -> bool:
    chord = last - first
    length2 = float(chord @ chord)
    off = via - first
    share = np.clip(off @ chord / length2, 0, 1) if length2 > 0 else np.zeros(len(via))
    return bool(np.linalg.norm(off - share[:, None] * chord, axis=1).max() > CURVED_MM)


def read_rows(texts: Sequence[str]) -> list[Row]:
    """The rows of a table of text. Raises ValueError where it is not one."""
    found: list[Row] = []
    for text in texts[1:]:
        words = text[1:].split()
        if text.startswith("~"):
            last = found[-1]
            found[-1] = Row(last.line, last.time_s, last.end, (*last.via, tuple(float(w) for w in words)))
        else:
            found.append(Row(int(words[0]), float(words[1]), tuple(float(w) for w in words[2:])))
    return found


def polyline(rows: Sequence[Row], start: Sequence[float]) -> tuple[F8, F8]:
    """Times f8[K] and places f8[K, A] through which the motion of a table goes, its start first."""
    t, places, now = [0.0], [tuple(start)], 0.0
    for row in rows:
        for share, place in zip(ON_THE_WAY, row.via, strict=False):
            t.append(now + share * row.time_s)
            places.append(place)
        now += row.time_s
        t.append(now)
        places.append(row.end)
    return np.array(t), np.array(places)
