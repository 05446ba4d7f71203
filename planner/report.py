"""The plan report: what the planned program does, as text and JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from planner.deviation import Deviation


@dataclass(frozen=True, slots=True)
class AxisReport:
    """One axis, mm (degrees) and s: reach in machine and in work coordinates, largest values, limits (None: none)."""

    least: float
    greatest: float
    velocity: float
    acceleration: float
    velocity_limit: float
    acceleration_limit: float
    jerk: float | None = None
    jerk_limit: float | None = None
    work_least: float = 0.0
    work_greatest: float = 0.0


@dataclass(frozen=True, slots=True)
class SoftLimitViolation:
    """The first move of a line that leaves the travel of an axis: where it goes and what is allowed."""

    line: int
    axis: str
    position: float
    limit: float


@dataclass(frozen=True, slots=True)
class SlowCorner:
    """A place that is passed much slower than programmed: line, speed and programmed feed (None: rapid), mm/s."""

    line: int
    speed_mm_s: float
    feed_mm_s: float | None


@dataclass(frozen=True, slots=True)
class PlanReport:
    """Times in s, axes by name, counts; ``text()`` for people, ``as_json()`` for tools.

    limited_by: share of the motion's time by cause: "feed", "velocity X", "acceleration X", "jerk" (the filter's
    share of the tolerance). tool_changes and waits take operator's time that no plan knows. notes: what else is to be
    known of this plan.
    """

    duration_s: float
    cutting_s: float
    rapid_s: float
    dwell_s: float
    filter_s: float
    tool_changes: int
    waits: int
    intervals: int
    stops: int
    solver: str
    axes: dict[str, AxisReport]
    deviation: Deviation
    tolerance_mm: float
    limited_by: dict[str, float] = field(default_factory=dict)
    slow_corners: tuple[SlowCorner, ...] = ()
    soft_limits: tuple[SoftLimitViolation, ...] = ()
    velocity_jumps: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def as_json(self) -> str:
        """One JSON object."""
        out = asdict(self)
        out["deviation"]["sum_mm"] = self.deviation.sum_mm
        return json.dumps(out)

    def text(self) -> str:
        """Some lines for a terminal."""
        d = self.deviation
        rows = [
            f"time       {self.duration_s:.2f} s: cutting {self.cutting_s:.2f}, rapids {self.rapid_s:.2f}, dwell "
            f"{self.dwell_s:.2f}, filter at stops {self.filter_s:.2f}; {self.tool_changes} tool changes, "
            f"{self.waits} waits for the operator",
            f"path       {self.intervals} intervals, {self.stops} exact stops, solver {self.solver}",
            f"deviation  merge {d.merge_mm * 1e3:.1f} + corners {d.blend_mm * 1e3:.1f} + arcs {d.chord_mm * 1e3:.2f} "
            f"+ filter {d.filter_mm * 1e3:.1f} um of {self.tolerance_mm * 1e3:.1f} um allowed by default"
            + (f"; measured {d.measured_mm * 1e3:.1f} um" if d.measured_mm is not None else ""),
        ]
        rows += [_axis_row(name, a) for name, a in self.axes.items()]
        if self.limited_by:
            causes = sorted(self.limited_by.items(), key=lambda c: -c[1])
            shown = [f"{name} {100 * share:.0f} %" for name, share in causes if share >= 0.005]
            rows.append("limited by " + ", ".join(shown))
        if self.velocity_jumps:
            jumps = ", ".join(f"{axis} {jump:.2f}" for axis, jump in self.velocity_jumps.items())
            rows.append(f"jumps      velocity jumps used at corners, mm/s: {jumps}")
        if self.slow_corners:
            slow = [
                f"line {c.line} {c.speed_mm_s:.1f} of {'rapid' if c.feed_mm_s is None else format(c.feed_mm_s, '.0f')}"
                for c in self.slow_corners[:5]
            ]
            rows.append(f"slowest    {', '.join(slow)} mm/s")
        rows += [
            f"SOFT LIMIT line {v.line}: {v.axis} at {v.position:.3f}, allowed {v.limit:.3f}" for v in self.soft_limits
        ]
        return "\n".join(rows + [f"note       {note}" for note in self.notes])


def _axis_row(name: str, a: AxisReport) -> str:
    row = (
        f"{name:<10} machine {a.least:.3f} to {a.greatest:.3f}, work {a.work_least:.3f} to {a.work_greatest:.3f}; "
        f"velocity {a.velocity:.2f} of {a.velocity_limit:g}, "
        f"acceleration {a.acceleration:.1f} of {a.acceleration_limit:g}"
    )
    if a.jerk is not None:
        row += f", jerk {a.jerk:.0f}" + (f" of {a.jerk_limit:g}" if a.jerk_limit is not None else "")
    return row
