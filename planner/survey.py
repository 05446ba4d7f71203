"""Survey of a planned trajectory: everything the report says of it, vectorised over pieces and intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gcode import canon
from planner.constraints import Constraints
from planner.deviation import Deviation
from planner.jerk import FilteredTrajectory
from planner.report import AxisReport, PlanReport, SlowCorner, SoftLimitViolation
from planner.timing import Timed, speed_cap
from planner.trajectory import PathTrajectory
from planner.types import F8, Event, Limits

SLOW_CORNERS = 10
SLOW = 0.9
"""share of the programmed feed below which a corner counts as slow."""
AT_CAP = 1 - 1e-6
MOST_SAMPLES = 200_000


def survey(
    trajectory: PathTrajectory | FilteredTrajectory,
    timed: Timed,
    limits: Limits,
    constraints: Constraints,
    solver: str,
    deviation: Deviation,
    work_offset: F8 | None = None,
    travel: Mapping[str, tuple[float, float]] | None = None,
) -> PlanReport:
    """The report. work_offset: f8[A], machine position of the work zero. travel: allowed reach by axis, machine mm."""
    p = timed.intervals
    base = trajectory.base if isinstance(trajectory, FilteredTrajectory) else trajectory
    pieces = base.pieces
    moving = (pieces.speed_mm_s > 0) | (pieces.accel_mm_s2 != 0)
    rapid = np.isinf(base.intervals.feed_mm_s)[pieces.interval]
    dwell = sum(e.command.seconds for e in trajectory.events if isinstance(e.command, canon.Dwell))
    still = float(pieces.duration_s[~moving].sum())
    if isinstance(trajectory, FilteredTrajectory):
        deviation = replace(deviation, filter_mm=_filter_cut(trajectory))
    return PlanReport(
        duration_s=trajectory.duration_s,
        cutting_s=float(pieces.duration_s[moving & ~rapid].sum()),
        rapid_s=float(pieces.duration_s[moving & rapid].sum()),
        dwell_s=dwell,
        filter_s=max(still - dwell, 0.0),
        tool_changes=_count(trajectory.events, canon.ToolChange),
        waits=_count(trajectory.events, canon.Stop),
        intervals=len(p),
        stops=int(p.stop.sum()),
        solver=solver,
        axes=_axes(trajectory, p.start, limits, np.zeros(len(limits.axes)) if work_offset is None else work_offset),
        deviation=deviation,
        tolerance_mm=limits.tolerance_mm,
        limited_by=_causes(base, timed, constraints, moving) if len(p) else {},
        slow_corners=_slow_corners(timed) if len(p) else (),
        soft_limits=soft_limits(timed, limits.axes, travel or {}),
        velocity_jumps=_jumps(timed, limits.axes),
    )


def _jumps(timed: Timed, axes: tuple[str, ...]) -> dict[str, float]:
    """Largest jump of each axis's velocity at a node, mm/s, of the axes that have one."""
    p = timed.intervals
    if p.corner_mm_s is None or len(p) < 2:
        return {}
    step = np.abs(p.tangent_in[1:] - p.tangent_out[:-1]) * np.sqrt(timed.x[1:-1])[:, None]
    most = step.max(axis=0)
    return {name: float(most[k]) for k, name in enumerate(axes) if most[k] > 1e-6}


def _count(events: Sequence[Event], kind: type[canon.Command]) -> int:
    return sum(isinstance(e.command, kind) for e in events)


def _axes(
    trajectory: PathTrajectory | FilteredTrajectory, start: F8, limits: Limits, work: F8
) -> dict[str, AxisReport]:
    """Peaks at all piece ends, where they are exact; reach at interval ends."""
    junctions = trajectory.junctions_s()
    moments = np.concatenate([junctions, np.nextafter(junctions[1:], 0.0)])
    velocity, acceleration = np.abs(trajectory.v(moments)).max(axis=0), np.abs(trajectory.a(moments)).max(axis=0)
    jerk = np.abs(trajectory.j(moments)).max(axis=0) if isinstance(trajectory, FilteredTrajectory) else None
    ends = np.concatenate([start, trajectory.q(np.array([0.0, trajectory.duration_s]))])
    least, greatest = ends.min(axis=0), ends.max(axis=0)
    return {
        name: AxisReport(
            float(least[k]),
            float(greatest[k]),
            float(velocity[k]),
            float(acceleration[k]),
            float(limits.velocity[k]),
            float(limits.acceleration[k]),
            None if jerk is None else float(jerk[k]),
            None if limits.jerk is None else float(limits.jerk[k]),
            float(least[k] - work[k]),
            float(greatest[k] - work[k]),
        )
        for k, name in enumerate(limits.axes)
    }


def _filter_cut(trajectory: FilteredTrajectory) -> float:
    """Largest distance of the filtered from the unfiltered path, by samples."""
    from planner.follow import follow

    step = max(1e-3, trajectory.duration_s / MOST_SAMPLES)
    t = np.append(np.arange(0.0, trajectory.duration_s, step), trajectory.duration_s)
    q = trajectory.base.q(np.union1d(t, trajectory.base.junctions_s()))
    line = q[np.concatenate([[True], np.linalg.norm(np.diff(q, axis=0), axis=1) > 1e-7])]
    if len(line) < 2:
        return 0.0
    reach = float(np.linalg.norm(np.diff(trajectory.base.q(t), axis=0), axis=1).max()) * 2 + 0.05
    return float(follow(trajectory.q(t), line, 0, reach, reach / 4)[0].max())


def _causes(base: PathTrajectory, timed: Timed, c: Constraints, moving: np.ndarray) -> dict[str, float]:
    """Share of the moving time by what limits it: at the cap what makes the cap, elsewhere the axis at its
    acceleration."""
    pieces, p = base.pieces, timed.intervals
    tangents = c.tangents(p)
    names = [*base.axes, *(f"joint {k}" for k in range(len(c.velocity) - len(base.axes)))]
    m = np.flatnonzero(moving)
    i = pieces.interval[m]
    tau = pieces.duration_s[m] / 2
    speed = pieces.speed_mm_s[m] + pieces.accel_mm_s2[m] * tau
    most = np.maximum(np.abs(tangents[0]), np.abs(tangents[1]))
    by_axis = c.velocity / np.maximum(most, 1e-12)
    feed = speed_cap(p, tangents, c.velocity)
    bounded = np.zeros(len(p), dtype=bool) if p.bound_mm_s is None else p.bound_mm_s < p.feed_mm_s
    at_cap = speed >= np.sqrt(timed.cap[i]) * AT_CAP
    slowest = by_axis.argmin(axis=1)
    by_velocity = by_axis.min(axis=1) <= feed
    share = (base.pieces.offset_mm[m] + (pieces.speed_mm_s[m] + pieces.accel_mm_s2[m] * tau / 2) * tau) / p.length[i]
    bend = (tangents[1] - tangents[0])[i]
    a = (tangents[0][i] + bend * share[:, None]) * pieces.accel_mm_s2[m][:, None]
    a = a + bend / p.length[i][:, None] * (speed**2)[:, None]
    busiest = (np.abs(a) / c.acceleration).argmax(axis=1)
    total = float(pieces.duration_s[m].sum()) or 1.0
    out: dict[str, float] = {}

    def add(name: str, where: np.ndarray) -> None:
        seconds = float(pieces.duration_s[m][where].sum())
        if seconds > 0:
            out[name] = seconds / total

    add("feed", at_cap & ~by_velocity[i] & ~bounded[i])
    add("jerk", at_cap & ~by_velocity[i] & bounded[i])
    for k, name in enumerate(names):
        add(f"velocity {name}", at_cap & by_velocity[i] & (slowest[i] == k))
        add(f"acceleration {name}", ~at_cap & (busiest == k))
    return out


def _slow_corners(timed: Timed) -> tuple[SlowCorner, ...]:
    """The slowest bends below the programmed feed, one a line."""
    p = timed.intervals
    bent = (p.tangent_in != p.tangent_out).any(axis=1)
    speed = np.sqrt(np.minimum(timed.x[:-1], timed.x[1:]))
    slow = np.flatnonzero(bent & (speed < SLOW * p.feed_mm_s) & ~p.stop[:-1] & ~p.stop[1:])
    out: dict[int, SlowCorner] = {}
    for k in slow[np.argsort(speed[slow], kind="stable")]:
        line = int(p.line[k])
        if line not in out:
            feed = float(p.feed_mm_s[k])
            out[line] = SlowCorner(line, float(speed[k]), feed if np.isfinite(feed) else None)
        if len(out) == SLOW_CORNERS:
            break
    return tuple(out.values())


def soft_limits(
    timed: Timed, axes: tuple[str, ...], travel: Mapping[str, tuple[float, float]]
) -> tuple[SoftLimitViolation, ...]:
    """Every line that leaves the travel, with its farthest position; intervals are checked at both ends."""
    p = timed.intervals
    half = p.length[:, None] / 2
    end = p.start + (p.tangent_in + p.tangent_out) * half
    out = []
    for name, (least, greatest) in travel.items():
        if name not in axes or not len(p):
            continue
        k = axes.index(name)
        low, high = np.minimum(p.start[:, k], end[:, k]), np.maximum(p.start[:, k], end[:, k])
        for reach, limit, sign in ((low, least, -1.0), (high, greatest, 1.0)):
            beyond = np.flatnonzero(sign * (reach - limit) > 1e-6)
            for line in sorted(set(p.line[beyond].tolist())):
                rows = beyond[p.line[beyond] == line]
                far = reach[rows].max() if sign > 0 else reach[rows].min()
                out.append(SoftLimitViolation(int(line), name, float(far), float(limit)))
    return tuple(sorted(out, key=lambda v: (v.line, v.axis)))
