"""Jobs a to f of the planning benchmark on mill3-step, at its limits: pins against planned and programmed path."""

from __future__ import annotations

from benchmarks.planning_jobs import JOBS, text
from gcode.canon import ORIGIN
from gcode.setup import Setup
from machines.job import plan_job, read_job
from machines.load import MachineFile, parse_machine, read_machine
from machines.runner import RunOptions, perform

MACHINE, JITTER_LINE = "mill3-step", "host_jitter_ms = 0.2"


def row(job: tuple[str, str, float]) -> str:
    """One line of the table for (profile, job, jitter in ms)."""
    profile, name, jitter_ms = job
    shipped = read_machine(MACHINE).text
    assert JITTER_LINE in shipped
    changed = shipped.replace(JITTER_LINE, f"host_jitter_ms = {jitter_ms}")
    machine = MachineFile(MACHINE, changed, parse_machine(changed, MACHINE))
    read = read_job(text(name), Setup(file=f"{name}.nc", start=ORIGIN), machine.config)
    plan = plan_job(read, machine.config, "kernel")
    verdict = perform(read, plan, machine, RunOptions(profile=profile)).verdict
    assert verdict is not None
    assert verdict.contour_steps is not None
    contour, ends = verdict.contour_steps, sum(abs(n) for n in verdict.end_error_steps.values())
    figures = f"{contour.max:6.2f} {contour.p999:6.2f} {contour.rms:5.2f} steps   program {verdict.program_um:5.1f} um"
    broken, bus = sum(verdict.violations.values()), verdict.bus.utilisation
    label = f"job {name}, {verdict.plan_time_s:.1f} s, jitter {jitter_ms}"
    return f"{profile:9s} {label:30s} {figures}   ends {ends} broken rules {broken} bus {bus:4.0%}"


def names() -> tuple[str, ...]:
    """The jobs."""
    return tuple(JOBS)
