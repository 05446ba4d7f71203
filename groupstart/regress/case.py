"""One case of a suite: a job on a machine, run on the twin, and what is kept of it as text.

A case is plain data and its result as well, so it runs wherever the package is installed: in this process, in a pool,
on a cluster. Same case, same result, to the bit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from gcode.canon import Position
from gcode.canontext import canon_lines
from gcode.setup import Setup
from gcode.tooltable import read_tool_table
from groupstart.regress.motiontable import motion_rows
from groupstart.report.digest import exchanges_digest, text_digest, trace_digest
from machines.job import plan_job, read_job
from machines.load import MachineFile, parse_machine
from machines.runner import RunOptions, RunResult, perform
from machines.verdict import Verdict
from planner.errors import PlanError
from planner.plan import Plan
from planner.timing import Solver


@dataclass(frozen=True, slots=True)
class Case:
    """What runs. work_offset: nine numbers or None; tools: text of a tool table; seed: None for the machine's own."""

    job: str
    machine: str
    file: str
    text: str
    machine_text: str
    machine_file: str
    work_offset: tuple[float, ...] | None = None
    dialect: str = "auto"
    tools: str | None = None
    profile: str = "auto"
    solver: str = "auto"
    seed: int | None = None

    @property
    def name(self) -> str:
        """Job and machine."""
        return f"{self.job} on {self.machine}"


@dataclass(frozen=True, slots=True)
class Result:
    """What came of a case. fields: in the order in which they stand in the baseline; canon: canonical commands;
    rows: the motion line by line; fault: why there is no result."""

    job: str
    machine: str
    fields: tuple[tuple[str, str], ...]
    canon: tuple[str, ...]
    rows: tuple[str, ...]
    fault: str = ""


def run_case(case: Case) -> Result:
    """Run a case. A refused program or a fault of the twin is a result, not an exception."""
    config = parse_machine(case.machine_text, case.machine_file)
    machine = MachineFile(case.machine_file, case.machine_text, config)
    tools = None if case.tools is None else read_tool_table(case.tools, "tool table")[0]
    offset = cast("Position | None", case.work_offset)
    setup = Setup(tools=tools, work_offset=offset, dialect=case.dialect, file=case.file)
    job = read_job(case.text, setup, config)
    if job.errors:
        return _failed(case, "; ".join(item.text("").splitlines()[0] for item in job.errors[:3]))
    try:
        plan = plan_job(job, config, cast("Solver", case.solver))
    except PlanError as error:
        return _failed(case, str(error))
    ran = perform(job, plan, machine, RunOptions(port="sim", seed=case.seed, profile=case.profile))
    if ran.verdict is None or ran.trace is None:
        return _failed(case, ran.fault)
    fields = [
        ("program.digest", text_digest(case.text)),
        *(("machine." + key, value) for key, value in flat(config.model_dump(exclude_unset=True))),
        *_plan_fields(plan),
        *_run_fields(ran),
        *_verdict_fields(ran.verdict),
    ]
    canon = tuple(canon_lines(job.commands))
    return Result(case.job, case.machine, tuple(fields), canon, tuple(motion_rows(plan.trajectory)))


def _failed(case: Case, words: str) -> Result:
    return Result(case.job, case.machine, (), (), (), words or "no result")


def flat(data: Any, path: str = "") -> Iterator[tuple[str, str]]:
    """Every value of nested tables with its key path; what is not given is left out."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from flat(value, f"{path}.{key}" if path else str(key))
    elif isinstance(data, list | tuple):
        yield path, ", ".join(_shown(value) for value in data)
    elif data is not None:
        yield path, _shown(data)


def _shown(value: Any) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def _plan_fields(plan: Plan) -> Iterator[tuple[str, str]]:
    report = plan.report
    yield "plan.time_s", f"{report.duration_s:.6f}"
    yield "plan.dwell_s", f"{report.dwell_s:.6f}"
    yield "plan.intervals", str(report.intervals)
    yield "plan.stops", str(report.stops)
    yield "plan.solver", report.solver
    for name, axis in report.axes.items():
        yield f"plan.{name}.reach", f"{axis.least:.4f}, {axis.greatest:.4f}"
        yield f"plan.{name}.velocity", f"{axis.velocity:.4f}"
        yield f"plan.{name}.acceleration", f"{axis.acceleration:.2f}"
    deviation = report.deviation
    for cause in ("merge_mm", "blend_mm", "chord_mm", "filter_mm"):
        yield f"plan.{cause}", f"{getattr(deviation, cause):.6f}"


def _run_fields(ran: RunResult) -> Iterator[tuple[str, str]]:
    trace = ran.trace
    assert trace is not None
    yield "exchanges.bytes", str(len(trace.bus_byte))
    yield "exchanges.digest", exchanges_digest(trace)
    end = trace.start_steps.astype(np.int64)
    pulses = np.zeros(len(trace.axes), np.int64)
    np.add.at(pulses, trace.run_axis, trace.run_count)
    np.add.at(end, trace.run_axis, trace.run_dir.astype(np.int64) * trace.run_count)
    for k, name in enumerate(trace.axes):
        mine = trace.servo_axis == k
        if mine.any():
            yield f"trace.{name}.end_counts", str(int(trace.servo_position[mine][-1]))
            error = trace.servo_command[mine].astype(np.float64) - trace.servo_position[mine]
            yield f"trace.{name}.error_counts", f"{np.abs(error).max():.0f}, {np.sqrt(np.mean(error**2)):.3f}"
        else:
            yield f"trace.{name}.pulses", str(int(pulses[k]))
            yield f"trace.{name}.end_steps", str(int(end[k]))
    yield "trace.digest", trace_digest(trace)


def _verdict_fields(verdict: Verdict) -> Iterator[tuple[str, str]]:
    yield "verdict.ok", str(verdict.ok)
    if verdict.reasons:
        yield "verdict.reasons", "; ".join(verdict.reasons)
    if verdict.sim_time_s is not None:
        yield "verdict.sim_time_s", f"{verdict.sim_time_s:.6f}"
    for name in ("contour_um", "motor_contour_um"):
        spread = getattr(verdict, name)
        if spread is not None:
            for part in ("max", "p999", "rms"):
                yield f"verdict.{name}.{part}", f"{getattr(spread, part):.3f}"
    if verdict.program_um is not None:
        yield "verdict.program_um", f"{verdict.program_um:.3f}"
    if verdict.lag_ms is not None:
        yield "verdict.lag_ms.max", f"{verdict.lag_ms[0]:.3f}"
    for name, error in verdict.end_error_steps.items():
        yield f"verdict.end_error_steps.{name}", str(error)
    yield "verdict.worst_line", str(verdict.worst_line)
    yield "verdict.late_slices", str(verdict.late_slices)
    yield "verdict.packets", str(verdict.bus.packets)
    yield "verdict.utilisation", f"{verdict.bus.utilisation:.4f}"
    yield "verdict.violations", ", ".join(f"{name}: {count}" for name, count in verdict.violations.items()) or "none"
