"""Measure a trajectory against the programmed path and against its limits, by sampling.

The programmed path is a fine polyline of the moves, which the samples follow in order, so a path that crosses itself
is not taken for another part of itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from planner import arcs as arc
from planner.moves import MODE_CONTINUOUS, Moves
from planner.types import F8, Index, Trajectory

CHUNK = 200_000
REACH_MM = 0.05
"""how far ahead of its last segment a sample is looked for, at least; also twice what it can travel in a step."""
NEAR, NEAR_MM = 1.05, 5e-4
"""a vertex counts as passed within this much more than its tolerance; a trajectory that misses more misses all that
follow."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """deviation_mm: largest distance of a sample to the programmed path. miss_mm: largest distance of a programmed
    vertex to the trajectory. velocity, acceleration: f8[A], largest share of the limit. jerk: f8[A], mm/s3, by
    differences.
    """

    deviation_mm: float
    miss_mm: float
    velocity: F8
    acceleration: F8
    jerk: F8


def programmed(moves: Moves, axes: tuple[str, ...], chord_mm: float = 1e-5) -> tuple[F8, Index]:
    """Polyline f8[P, A] of the program, arcs by chords, and the index i8[moves + 1] of each programmed vertex in it."""
    arcs = arc.arcs_of(moves, axes, moves.begin())
    count = np.ones(len(moves), dtype=np.intp)
    step = np.sqrt(8 * chord_mm / np.maximum(arcs.r0, arcs.r1))
    count[arcs.index] = np.maximum(np.ceil(np.abs(arcs.sweep) / step), 2)
    last = np.cumsum(count)
    out = np.empty((int(last[-1]) + 1, len(axes)))
    out[0], out[last] = moves.start, moves.end
    for k, move in enumerate(arcs.index):
        n = int(count[move])
        share = np.arange(1, n) / n
        r = arcs.r0[k] + (arcs.r1[k] - arcs.r0[k]) * share
        angle = arcs.angle0[k] + arcs.sweep[k] * share
        points = arcs.start[k] + arcs.other[k] * share[:, None]
        points[:, arcs.columns[k, 0]] = arcs.center[k, 0] + r * np.cos(angle)
        points[:, arcs.columns[k, 1]] = arcs.center[k, 1] + r * np.sin(angle)
        out[last[move] - n + 1 : last[move]] = points
    keep = np.concatenate([[True], np.linalg.norm(np.diff(out, axis=0), axis=1) > 1e-9])
    place = np.cumsum(keep) - 1
    return out[keep], place[np.concatenate([[0], last])]


def grid(duration_s: float, step_s: float) -> Iterator[F8]:
    """Sample times 0, step, ... up to the end in chunks that overlap by one."""
    n = max(int(np.ceil(duration_s / step_s)), 1)
    for at in range(0, n, CHUNK):
        yield np.minimum(np.arange(at, min(at + CHUNK, n) + 1) * step_s, duration_s)


def measure(trajectory: Trajectory, moves: Moves, velocity: F8, acceleration: F8, step_s: float = 1e-4) -> Measured:
    """Deviation, vertex miss and limits of a trajectory at ``step_s`` and at all junctions."""
    from planner.follow import Follower, passes

    polyline, vertex = programmed(moves, trajectory.axes)
    target = polyline[vertex]
    miss = np.full(len(target), np.inf)
    if len(polyline) < 2:
        polyline = np.concatenate([polyline, polyline + 1e-12])
    near = np.concatenate([[0.0], np.where(moves.mode < MODE_CONTINUOUS, 0.0, moves.tolerance_mm)]) * NEAR + NEAR_MM
    near[[0, -1]] = NEAR_MM
    worst, at = 0.0, 0
    reach = max(REACH_MM, 2 * float(np.linalg.norm(velocity)) * step_s)
    follower = Follower(polyline, reach, float(moves.tolerance_mm.max()) * NEAR + NEAR_MM)
    v_most, a_most, j_most = np.zeros(len(velocity)), np.zeros(len(velocity)), np.zeros(len(velocity))
    for t in grid(trajectory.duration_s, step_s):
        q = trajectory.q(t)
        worst = float(follower.take(q)[0][-1])
        at = passes(q, target, at, near, bool(t[-1] >= trajectory.duration_s), miss)
        v_most = np.maximum(v_most, np.abs(trajectory.v(t)).max(axis=0))
        a = trajectory.a(t)
        a_most = np.maximum(a_most, np.abs(a).max(axis=0))
        j_most = np.maximum(j_most, np.abs(np.diff(a, axis=0)).max(axis=0, initial=0.0) / step_s)
    junctions = trajectory.junctions_s()
    for k in range(0, len(junctions), CHUNK):
        j = junctions[k : k + CHUNK]
        for t in (j, np.nextafter(j, 0.0)):
            v_most = np.maximum(v_most, np.abs(trajectory.v(t)).max(axis=0))
            a_most = np.maximum(a_most, np.abs(trajectory.a(t)).max(axis=0))
    return Measured(worst, float(miss.max()), v_most / velocity, a_most / acceleration, j_most)
