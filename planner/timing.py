"""Timing: interval arrays and constraints to x = s'^2 at the nodes, and from there to pieces of constant s''.

Two solvers share the arrays: toppra (the reference) and the compiled kernel of the same reachability pass. A straight
line is one interval to both; afterwards it is replaced analytically by accelerate, cruise, decelerate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from gcode.canon import Command, Dwell
from planner.constraints import Constraints
from planner.types import F8, I4, Event, Intervals

Solver = Literal["auto", "toppra", "kernel"]
TOPPRA_INTERVALS = 3000
"""``auto``: programs up to this many intervals go to the reference solver, longer ones to the kernel."""


@dataclass(frozen=True, slots=True, eq=False)
class Pieces:
    """M pieces of constant s'', ascending in time.

    duration_s: f8[M], > 0. interval: i4[M]. offset_mm: f8[M], distance from the interval's start. speed_mm_s: f8[M],
    s' at the piece's start. accel_mm_s2: f8[M], s''.
    """

    duration_s: F8
    interval: I4
    offset_mm: F8
    speed_mm_s: F8
    accel_mm_s2: F8

    def __len__(self) -> int:
        return len(self.duration_s)


@dataclass(frozen=True, slots=True)
class NodeMark:
    """``command`` happens when the path reaches ``node``."""

    node: int
    command: Command


@dataclass(frozen=True, slots=True, eq=False)
class Timed:
    """A timed path: what a trajectory is made of, and what rate control times again.

    intervals: N. x: f8[N + 1], s'^2 at the nodes. cap: f8[N], largest x that feed and velocities allow. marks:
    ascending in node, 0..N. drain_s: rest at every stop but the first node (the jerk filter runs empty there). ease:
    f8[N], share of the accelerations that was used (``planner.easing``), None: all.
    """

    intervals: Intervals
    x: F8
    cap: F8
    marks: Sequence[NodeMark] = ()
    drain_s: float = 0.0
    ease: F8 | None = None


def solve(p: Intervals, constraints: Constraints, solver: Solver = "auto") -> tuple[F8, F8, str]:
    """Minimum-time x f8[N + 1], caps f8[N] and the solver's name; at rest at every stop. Raises PlanError."""
    from planner import kernel

    chosen = solver
    tangents = constraints.tangents(p)
    if solver == "auto":
        chosen = "toppra" if len(p) <= TOPPRA_INTERVALS and _has_toppra() else "kernel"
    v, a = constraints.velocity, constraints.acceleration
    speed = speed_cap(p, tangents, v)
    if chosen == "kernel":
        x, cap = kernel.solve(p.length, *tangents, speed, p.stop, v, a, corner_caps(p))
        return x, cap, "kernel"
    from planner import reference

    cap, node_cap = np.empty(len(p)), np.empty(len(p) + 1)
    kernel.node_caps(p.length, *tangents, speed, p.stop, v, a, corner_caps(p), cap, node_cap)
    return reference.solve(p, tangents, a, node_cap), cap, "toppra"


@dataclass(frozen=True, slots=True)
class Rate:
    """Overrides: feed 0..2 of programmed feeds, rapid 0..1 of rapids; 1 is the program.

    bus: 0..1 of all speeds, and its square of all accelerations, what the bus can carry; where the program forbids
    overrides (M49) this one holds alone.
    """

    feed: float = 1.0
    rapid: float = 1.0
    bus: float = 1.0


def speed_cap(
    p: Intervals,
    tangents: tuple[F8, F8],
    velocity: F8,
    rate: Rate | None = None,
    fixed: npt.NDArray[np.bool_] | None = None,
) -> F8:
    """Cap on s' f8[N] by feed and overrides, and by what no override raises; axis velocities come on top.

    fixed: bool[N], intervals whose feed the program does not let anybody override.
    """
    speed = p.feed_mm_s
    if rate is not None and rate != Rate():
        rapid = np.isinf(speed)
        share = np.where(rapid, rate.rapid, rate.feed)
        share = (share if fixed is None else np.where(fixed, 1.0, share)) * rate.bus
        slow = rapid & (share < 1)
        speed = np.where(rapid, np.inf, speed * share)
        if slow.any():
            most = np.maximum(np.abs(tangents[0][slow]), np.abs(tangents[1][slow]))
            speed[slow] = share[slow] * (velocity / np.maximum(most, 1e-12)).min(axis=1)
    if p.bound_mm_s is None:
        return speed
    return np.minimum(speed, p.bound_mm_s if rate is None else p.bound_mm_s * rate.bus)


def eased(tangents: tuple[F8, F8], ease: F8 | None) -> tuple[F8, F8]:
    """Tangents with which a bound of the accelerations is ``ease`` f8[N] of what it was."""
    return tangents if ease is None else (tangents[0] / ease[:, None], tangents[1] / ease[:, None])


def corner_caps(p: Intervals) -> F8:
    """Caps on s' at the nodes f8[N + 1] for the kernel, f8[0] where there are none."""
    return np.zeros(0) if p.corner_mm_s is None else p.corner_mm_s


def _has_toppra() -> bool:
    from importlib.util import find_spec

    return find_spec("toppra") is not None


def schedule(timed: Timed, constraints: Constraints) -> tuple[Pieces, list[Event]]:
    """Pieces of constant s'' with the rests between them, and every mark with its time from the first node on."""
    from planner import kernel

    p = timed.intervals
    tangents = eased(constraints.tangents(p), timed.ease)
    pieces = Pieces(*kernel.fill_pieces(p.length, *tangents, constraints.acceleration, timed.x, timed.cap))
    rests = _rests(timed)
    if not rests and not timed.marks:
        return pieces, []
    time = np.concatenate([[0.0], np.cumsum(pieces.duration_s)])
    nodes = np.array([node for node, _, _ in rests], dtype=np.intp)
    at = np.searchsorted(pieces.interval, nodes, side="left")
    events: list[Event] = []
    index, row = [], []
    waited = 0.0
    for (node, seconds, command), m in zip(rests, at, strict=True):
        if command is not None:
            events.append(Event(float(time[m]) + waited, command))
        if seconds > 0:
            i = max(node - 1, 0)
            index.append(m)
            row.append((seconds, i, float(p.length[i]) if node else 0.0))
            waited += seconds
    if not index:
        return pieces, events
    rest_s, interval, offset = (np.array(c) for c in zip(*row, strict=True))
    put = Pieces(
        np.insert(pieces.duration_s, index, rest_s),
        np.insert(pieces.interval, index, interval.astype(np.int32)),
        np.insert(pieces.offset_mm, index, offset),
        np.insert(pieces.speed_mm_s, index, 0.0),
        np.insert(pieces.accel_mm_s2, index, 0.0),
    )
    return put, events


def _rests(timed: Timed) -> list[tuple[int, float, Command | None]]:
    """(node, seconds, command or None) in the order of time: at a stop first the drain, then what the program does."""
    out: list[tuple[int, float, Command | None]] = []
    if timed.drain_s > 0:
        out = [(int(n), timed.drain_s, None) for n in np.flatnonzero(timed.intervals.stop[1:]) + 1]
    for mark in timed.marks:
        seconds = mark.command.seconds if isinstance(mark.command, Dwell) else 0.0
        out.append((mark.node, seconds, mark.command))
    return sorted(out, key=lambda r: r[0])
