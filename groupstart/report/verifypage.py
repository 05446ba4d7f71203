"""The report of a verify run: planned against simulated, as one page with a verdict on top."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gcode.canon import ORIGIN, Position
from groupstart.report.blocks import Block
from groupstart.report.busview import KINDS, BusView
from groupstart.report.clocks import clocks
from groupstart.report.compose import compose
from groupstart.report.digest import exchanges_digest, text_digest, trace_digest
from groupstart.report.measured import (
    Measured,
    envelope,
    measured_pins,
    shifts,
    simulated_path,
    steps_of,
    worst_places,
)
from groupstart.report.pathcolumns import FEED, PathColumns
from groupstart.report.pathpage import OverPath, PageInput, path_blocks, path_facts
from groupstart.report.preview import columns_of_plan
from groupstart.report.rates import rate_views
from groupstart.report.servo import servo_views
from groupstart.report.skew import starts
from groupstart.report.zmap import DEFAULT_DIAMETER_MM, HeightMap, height_maps
from machines.load import MachineFile
from machines.runner import RunResult
from machines.verdict import Verdict
from machines.wiring import nmc_buses
from planner.types import F8

MOST_SIMULATED, MOST_EXCHANGES, BINS, BARS, LATEST_LINES = 150_000, 250_000, 4000, 60, 8


@dataclass(frozen=True, slots=True, eq=False)
class ReportInput:
    """A finished run on the twin. reasons: why it is not good, those of ``--fail-over`` included; none: it is good."""

    result: RunResult
    machine: MachineFile
    bus: BusView | None
    reasons: tuple[str, ...]
    seed: int
    zero: Position | None = None
    diameter_mm: float = DEFAULT_DIAMETER_MM


def report_page(source: ReportInput) -> str:
    """The page as HTML."""
    result = source.result
    columns = columns_of_plan(result.plan)
    measured = measured_pins(source.machine.config, result, result.plan.trajectory)
    page = PageInput(result.job, source.machine, columns, path_facts(columns, result.job.text), source.zero or ORIGIN)
    blocks = _blocks(source, page, columns, measured)
    return compose(f"{result.job.name}: verify – groupstart", blocks)


def _blocks(source: ReportInput, page: PageInput, columns: PathColumns, measured: Measured | None) -> Iterator[str]:
    result, config = source.result, source.machine.config
    extra: dict[str, Any] = {"report": True, "first_tab": "error", **_summary(source)}
    over, worst, maps, lost = None, [], None, []
    if measured is not None and len(measured.t_s):
        over = OverPath(
            ("error", "lag"), measured.nearest_s,
            np.column_stack([measured.error_um, np.abs(measured.lag_ms)]), (1e-3, 1e-3),
        )  # fmt: skip
        worst = worst_places(measured, result.plan.trajectory)
        lost = shifts(measured, result.plan.trajectory, steps_of(config))
        s = columns.stretches
        maps = height_maps(measured, s.q, _on_feeds(columns), source.diameter_mm, page.zero[2])
        extra |= histograms(measured)
    extra["shifts"] = [asdict(shift) for shift in lost]
    extra |= {"worst": [asdict(place) for place in worst], "zmap": _map_fields(maps), "bus": _bus_fields(source)}
    servos = [] if result.trace is None else servo_views(config, result.trace)
    rates = [] if result.trace is None else rate_views(
        config, result.trace, result.plan.trajectory, columns.stretches.t_s)  # fmt: skip
    extra["clocks"] = [] if result.trace is None else [
        asdict(clock) for clock in clocks(config, result.trace, columns.duration_s)]  # fmt: skip
    begun = [] if result.trace is None else starts(config, result.trace, result.plan.trajectory)
    extra["starts"] = [asdict(start) for start in begun]
    extra["servos"] = [{"name": view.name, "pwm": view.pwm is not None} for view in servos]
    extra["rates"] = [view.name for view in rates]
    yield from path_blocks(page, extra, over)
    if measured is not None and len(measured.t_s):
        yield sim_block(measured).html()
        yield error_block(measured, columns.duration_s).html()
    for k, rate in enumerate(rates):
        block = Block(f"rate-{k}")
        block.add("planned_s", rate.planned_s, 1e-6)
        block.add("planned", rate.planned, 0.01)
        block.add("emitted_s", rate.emitted_s, 1e-6)
        block.add("emitted", rate.emitted, 0.01)
        yield block.html()
    for k, servo in enumerate(servos):
        block = Block(f"servo-{k}")
        block.add("t", servo.t_s, 1e-6)
        block.add("error", servo.error_um, 0.01)
        if servo.pwm is not None:
            block.add("pwm", servo.pwm, 1 / 255)
        yield block.html()
    if maps is not None:
        yield _map_block(maps).html()
    if source.bus is not None and len(source.bus):
        yield _bus_block(source.bus, columns.duration_s).html()


def _summary(source: ReportInput) -> dict[str, Any]:
    result, verdict = source.result, source.result.verdict
    digests = [["program", text_digest(result.job.text)], ["machine", text_digest(source.machine.text)]]
    if result.trace is not None:
        digests += [["exchanges", exchanges_digest(result.trace)], ["trace", trace_digest(result.trace)]]
    rows: list[tuple[str, str]] = []
    words = ""
    if verdict is not None:
        from groupstart.verdicttable import verdict_rows, words_of_go

        rows = verdict_rows(verdict) + [("warning", warning) for warning in verdict.warnings]
        words = words_of_go(verdict)
    violations = [
        {"time_s": (v.time_ns - (result.trace.plan_start_ns if result.trace else 0)) * 1e-9, "module": v.module,
         "rule": v.rule, "words": v.consequence}
        for v in result.violations[:50]
    ]  # fmt: skip
    return {
        "ok": not source.reasons,
        "reasons": list(source.reasons),
        "words": words,
        "verdict_rows": [list(row) for row in rows],
        "lags": [] if verdict is None else _lag_tables(verdict),
        "violations": violations,
        "digests": digests,
        "seed": source.seed,
        "subtitle": f"on {source.machine.config.machine.name}, planned against simulated",
    }


def _lag_tables(verdict: Verdict) -> list[dict[str, Any]]:
    """Lag by axis and in the lines that come latest, of commands and of shafts."""
    found = []
    for what, use in (("lag", verdict.lags), ("lag of the shafts", verdict.shaft_lags)):
        if use is not None and use.lines:
            latest = sorted(use.lines.items(), key=lambda item: -item[1][0])[:LATEST_LINES]
            axes = [[name, lag.max_ms, lag.rms_ms, lag.worst_line] for name, lag in use.motors.items()]
            found.append({"what": what, "axes": axes, "lines": [[line, *row] for line, row in latest]})
    return found


def histograms(m: Measured) -> dict[str, Any]:
    """Counts of pulses by error (shape) and by lag (along the path), kept apart."""
    error, error_edges = np.histogram(m.error_um, bins=BARS, range=(0.0, max(float(m.error_um.max()), 1e-3)))
    span = max(float(np.abs(m.lag_ms).max()), 1e-3)
    lag, lag_edges = np.histogram(m.lag_ms, bins=BARS, range=(-span, span))
    sorted_error = np.sort(m.error_um)
    marks = {name: float(sorted_error[min(int(q * len(sorted_error)), len(sorted_error) - 1)])
             for name, q in (("50 %", 0.5), ("99 %", 0.99), ("99.9 %", 0.999))}  # fmt: skip
    return {
        "error_histogram": {"counts": error.tolist(), "low": 0.0, "high": float(error_edges[-1]), "marks": marks},
        "lag_histogram": {"counts": lag.tolist(), "low": float(lag_edges[0]), "high": float(lag_edges[-1])},
    }


def _on_feeds(columns: PathColumns) -> F8:
    s = columns.stretches
    feed = np.flatnonzero(s.kind == FEED)
    return np.asarray(s.q[np.union1d(feed, feed + 1)])


def sim_block(measured: Measured) -> Block:
    """The second motion as a line: the planned place of each point, and how far from it the point lies."""
    m = simulated_path(measured, MOST_SIMULATED)
    block = Block("sim")
    block.add("t", m.t_s, 1e-6)
    block.columns("q", m.planned, 1e-4)
    block.columns("d", m.q - m.planned, 1e-5)
    return block


def error_block(m: Measured, end_s: float) -> Block:
    """Errors over time, the largest of each stretch."""
    block = Block("errors")
    t, error = envelope(m.nearest_s, m.error_um, end_s, BINS)
    block.add("t", t, 1e-6)
    block.add("error", error, 1e-3)
    lag_t, lag = envelope(m.t_s, np.abs(m.lag_ms), end_s, BINS)
    block.add("lag_t", lag_t, 1e-6)
    block.add("lag", lag, 1e-4)
    return block


def _map_fields(maps: HeightMap | None) -> dict[str, Any] | None:
    if maps is None:
        return None
    rows, columns = maps.planned.shape
    return {
        "rows": rows, "columns": columns, "cell_mm": maps.cell_mm, "low": list(maps.low), "top_mm": maps.top_mm,
        "diameter_mm": maps.diameter_mm, "scale_um": max(maps.typical_um, 1.0),
        "left_mm3": maps.left_mm3, "excess_mm3": maps.excess_mm3,
    }  # fmt: skip


def _map_block(maps: HeightMap) -> Block:
    block = Block("zmap-data")
    block.add("planned", maps.planned, 1e-3)
    block.add("simulated", maps.simulated, 1e-3)
    block.add("difference", maps.difference_um, 0.1)
    return block


def _bus_fields(source: ReportInput) -> dict[str, Any] | None:
    bus = source.bus
    if bus is None or not len(bus):
        return None
    names: dict[str, str] = {}
    config = source.machine.config
    for section in (config.axis, config.motor, config.module):
        for name, table in section.items():
            if table.chip != "cy545":
                names[f"{list(nmc_buses(config)).index(table.bus)}:{table.address}"] = f"{name} ({table.chip})"
    lanes = []
    for number, address in sorted({(int(b), int(a)) for b, a in zip(bus.bus, bus.address, strict=True)}):
        plain = f"group {address:#04x}" if address >= 0x80 else f"address {address}"
        lanes.append({"bus": number, "address": address, "name": names.get(f"{number}:{address}", plain)})
    run = bus.begin_s >= 0
    slack = bus.slack_ms[run]
    return {
        "lanes": lanes, "kinds": list(KINDS),
        "late": int(bus.late[run].sum()), "exchanges": int(run.sum()),
        "least_slack_ms": float(slack.min()) if len(slack) else 0.0,
        "latest_ms": float(bus.late_ms[run].max(initial=0)),
    }  # fmt: skip


def _bus_block(bus: BusView, end_s: float) -> Block:
    every = max(1, -(-len(bus) // MOST_EXCHANGES))
    keep = np.unique(np.concatenate([np.arange(0, len(bus), every), np.flatnonzero(bus.late)]))
    block = Block("bus-data")
    for name in ("bus", "address", "kind", "line"):
        block.add(name, getattr(bus, name)[keep])
    block.add("begin", bus.begin_s[keep], 1e-6)
    block.add("span", (bus.end_s - bus.begin_s)[keep], 1e-6)
    block.add("slack", bus.slack_ms[keep], 1e-3)
    block.add("late", np.where(bus.late, bus.late_ms, 0.0)[keep], 1e-3)
    t, share = bus.utilisation(end_s, min(BINS, max(int(end_s * 10), 1)))
    block.add("use_t", t, 1e-4)
    block.add("use", share, 1e-4)
    return block
