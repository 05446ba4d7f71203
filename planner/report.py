"""The plan report: what the planned program does, as text and JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

import numpy as np

from gcode import canon
from planner.deviation import Deviation
from planner.jerk import FilteredTrajectory
from planner.timing import Timed
from planner.trajectory import PathTrajectory
from planner.types import Limits


@dataclass(frozen=True, slots=True)
class AxisReport:
    """One axis: reach in machine coordinates, peaks and limits, mm (degrees) and s."""

    least: float
    greatest: float
    velocity: float
    acceleration: float
    velocity_limit: float
    acceleration_limit: float


@dataclass(frozen=True, slots=True)
class PlanReport:
    """Times in s, axes by name, counts; ``text()`` for people, ``as_json()`` for tools."""

    duration_s: float
    dwell_s: float
    intervals: int
    stops: int
    solver: str
    axes: dict[str, AxisReport]
    deviation: Deviation

    def as_json(self) -> str:
        """One JSON object."""
        return json.dumps(asdict(self))

    def text(self) -> str:
        """A few lines for a terminal."""
        rows = [
            f"time            {self.duration_s:.2f} s (dwell {self.dwell_s:.2f} s)",
            f"path            {self.intervals} intervals, {self.stops} exact stops, solver {self.solver}",
        ]
        for name, a in self.axes.items():
            rows.append(
                f"{name}  {a.least:10.3f} to {a.greatest:10.3f}   velocity {a.velocity:.2f} of {a.velocity_limit:g}   "
                f"acceleration {a.acceleration:.1f} of {a.acceleration_limit:g}"
            )
        return "\n".join(rows)


def report_of(
    trajectory: PathTrajectory | FilteredTrajectory, timed: Timed, limits: Limits, solver: str, deviation: Deviation
) -> PlanReport:
    """Peaks at all piece ends (where they are exact), reach at interval ends."""
    p = timed.intervals
    junctions = trajectory.junctions_s()
    moments = np.concatenate([junctions, np.nextafter(junctions[1:], 0.0)])
    velocity, acceleration = np.abs(trajectory.v(moments)).max(axis=0), np.abs(trajectory.a(moments)).max(axis=0)
    ends = np.concatenate([p.start, trajectory.q(np.array([0.0, trajectory.duration_s]))])
    axes = {
        name: AxisReport(
            float(ends[:, k].min()),
            float(ends[:, k].max()),
            float(velocity[k]),
            float(acceleration[k]),
            float(limits.velocity[k]),
            float(limits.acceleration[k]),
        )
        for k, name in enumerate(limits.axes)
    }
    dwell = sum(e.command.seconds for e in trajectory.events if isinstance(e.command, canon.Dwell))
    return PlanReport(trajectory.duration_s, dwell, len(p), int(p.stop.sum()), solver, axes, deviation)
