"""The report of a verify run for tools: verdict, worst places, errors by line, digests."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from groupstart.report.clocks import clocks
from groupstart.report.digest import exchanges_digest, text_digest, trace_digest
from groupstart.report.measured import measured_pins, shifts, steps_of, worst_by_line, worst_places
from groupstart.report.skew import starts
from groupstart.report.verifypage import ReportInput
from machines.lags import by_line


def report_json(source: ReportInput) -> dict[str, Any]:
    """Fields: verdict (as ``verify --json``), worst, error_by_line, lag_by_line, digests, seed, bus."""
    result = source.result
    data: dict[str, Any] = {
        "verdict": None if result.verdict is None else result.verdict.as_json(),
        "seed": source.seed,
        "digests": {"program": text_digest(result.job.text), "machine": text_digest(source.machine.text)},
        "worst": [],
        "shifts": [],
        "error_by_line": {},
    }
    if result.trace is not None:
        data["digests"] |= {"exchanges": exchanges_digest(result.trace), "trace": trace_digest(result.trace)}
    trajectory = result.plan.trajectory
    measured = measured_pins(source.machine.config, result, trajectory)
    if measured is not None and len(measured.t_s):
        data["worst"] = [asdict(place) for place in worst_places(measured, trajectory)]
        data["shifts"] = [asdict(shift) for shift in shifts(measured, trajectory, steps_of(source.machine.config))]
        lines, worst = worst_by_line(measured, trajectory)
        data["error_by_line"] = {int(n): round(float(um), 3) for n, um in zip(lines, worst, strict=True)}
    if result.verdict is not None:
        for name, use in (("lag_by_line", result.verdict.lags), ("shaft_lag_by_line", result.verdict.shaft_lags)):
            if use is not None:
                data[name] = by_line(use)
    if result.trace is not None:
        found = clocks(source.machine.config, result.trace, trajectory.duration_s)
        data["starts"] = [asdict(s) for s in starts(source.machine.config, result.trace, trajectory)]
        data["clocks"] = [asdict(clock) for clock in found]
    if source.bus is not None:
        run = source.bus.begin_s >= 0
        data["bus"] = {
            "exchanges": int(run.sum()),
            "late": int(source.bus.late[run].sum()),
            "latest_ms": float(source.bus.late_ms[run].max(initial=0.0)),
            "least_slack_ms": float(source.bus.slack_ms[run].min()) if run.any() else None,
        }
    return data
