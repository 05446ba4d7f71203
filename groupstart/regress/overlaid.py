"""The page of a case that changed: its motion now over the motion of its baseline."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from gcode.canon import Position
from gcode.setup import Setup
from groupstart.regress.baseline import Baseline
from groupstart.regress.case import Case
from groupstart.regress.compare import Difference
from groupstart.regress.motiontable import polyline, read_rows
from groupstart.report.measured import Measured, worst_places
from groupstart.report.overlay import OverlayInput, overlay_page
from groupstart.report.preview import columns_of_plan
from machines.job import plan_job, read_job
from machines.load import MachineFile, parse_machine
from planner.timing import Solver
from planner.types import F8, Trajectory

SAMPLES = 40_000
AHEAD_MM, LOST_MM, REACH = 1.0, 2.0, 400


def overlaid(case: Case, baseline: Baseline, differences: Sequence[Difference]) -> str | None:
    """The page as HTML, or None where one of the two has no motion."""
    rows = read_rows(baseline.rows)
    config = parse_machine(case.machine_text, case.machine_file)
    offset = cast("Position | None", case.work_offset)
    job = read_job(case.text, Setup(work_offset=offset, dialect=case.dialect, file=case.file), config)
    if not rows or job.errors:
        return None
    plan = plan_job(job, config, cast("Solver", case.solver))
    trajectory = plan.trajectory
    start = trajectory.q(np.zeros(1))[0]
    if len(rows[0].end) != len(start):
        return None
    knots_s, knots = polyline(rows, start.tolist())
    old_s = np.linspace(0.0, knots_s[-1], max(min(SAMPLES, int(knots_s[-1] * 500)), 2))
    old_q = np.column_stack([np.interp(old_s, knots_s, knots[:, k]) for k in range(knots.shape[1])])
    measured = against(trajectory, old_s, old_q)
    worst = [place for place in worst_places(measured, trajectory) if place.error_um > 1]
    texts = [difference.text() for difference in differences]
    machine = MachineFile(case.machine_file, case.machine_text, config)
    times = [("time now, s", f"{trajectory.duration_s:.3f}"), ("time of the baseline, s", f"{knots_s[-1]:.3f}")]
    return overlay_page(OverlayInput(
        job, machine, columns_of_plan(plan), measured, worst, texts, times,
        f"on {case.machine}: now in colours, the baseline as a line (chords of its table)",
    ))  # fmt: skip


def against(trajectory: Trajectory, old_s: F8, old_q: F8) -> Measured:
    """Another motion, f8[K] and f8[K, A], measured against a planned one along the way."""
    from sim.compare_kernel import distances, follow

    now_s = np.linspace(0.0, trajectory.duration_s, len(old_s))
    now_q = np.ascontiguousarray(trajectory.q(now_s))
    old_q = np.ascontiguousarray(old_q)
    segment = follow(old_q, now_q, AHEAD_MM, LOST_MM)
    first = np.clip(segment - REACH, 0, len(now_s) - 2)
    last = np.clip(segment + REACH, 1, len(now_s) - 1)
    distance, nearest_s = distances(old_s, old_q, first, last, now_s, now_q)
    planned = np.column_stack([np.interp(nearest_s, now_s, now_q[:, k]) for k in range(now_q.shape[1])])
    return Measured(tuple(trajectory.axes), old_s, old_q, planned, nearest_s, 1e3 * distance, 1e3 * (old_s - nearest_s))
