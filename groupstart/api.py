"""The Python API: what the command line does, without its words. ``from groupstart import check, plan, verify``.

A program is a path or, if it has a line end in it, the text itself. Nothing here prints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from gcode.canon import Position
    from gcode.errors import Diagnostic
    from gcode.setup import Setup
    from machines.control import Control
    from machines.job import Job
    from machines.load import MachineFile
    from machines.runner import RunResult
    from planner.plan import Plan

DEFAULT_MACHINE = "mill3-step"
Dialect = Literal["linuxcnc", "grbl", "fanuc", "mach", "auto"]


class ProgramRefusedError(Exception):
    """A program has errors. ``diagnostics``: all of them, and the warnings, in order of lines."""

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        super().__init__("\n".join(item.text() for item in self.diagnostics))


@dataclass(frozen=True, slots=True)
class Planned:
    """A program that passed on a machine, and its motion."""

    job: Job
    machine: MachineFile
    plan: Plan


def check(program: str | Path, machine: str | None = None, *, dialect: Dialect = "linuxcnc") -> tuple[Diagnostic, ...]:
    """Every error and warning of a program; with a machine also what leaves its axes or travel.

    Raises OSError where the file cannot be read, MachineError or MachineMissingError for the machine.
    """
    from machines.job import read_job
    from machines.load import read_machine

    name, text = _text(program)
    config = None if machine is None else read_machine(machine).config
    return read_job(text, _setup(name, dialect, ()), config).diagnostics


def plan(
    program: str | Path,
    machine: str = DEFAULT_MACHINE,
    *,
    work_offset: Sequence[float] = (),
    dialect: Dialect = "linuxcnc",
    solver: Literal["auto", "toppra", "kernel"] = "auto",
) -> Planned:
    """Check and plan a program. ``work_offset``: place of G54 in machine mm, up to nine numbers.

    Raises ProgramRefusedError with every error, planner.errors.PlanError, and as :func:`check`.
    """
    from machines.job import plan_job, read_job
    from machines.load import read_machine

    name, text = _text(program)
    described = read_machine(machine)
    job = read_job(text, _setup(name, dialect, work_offset), described.config)
    if job.errors:
        raise ProgramRefusedError(job.diagnostics)
    return Planned(job, described, plan_job(job, described.config, solver))


def verify(
    program: str | Path,
    machine: str = DEFAULT_MACHINE,
    *,
    work_offset: Sequence[float] = (),
    dialect: Dialect = "linuxcnc",
    solver: Literal["auto", "toppra", "kernel"] = "auto",
    profile: str = "auto",
    seed: int | None = None,
    control: Control | None = None,
    fit_bus: bool | None = None,
) -> RunResult:
    """Run a program on the machine's twin: its verdict, trace and violations. Raises as :func:`plan`.

    ``fit_bus``: lower accelerations or speeds, and slow down, where a bus cannot follow, or not; None: yes, except for
    profile ``stop-here``.
    ``control``: holds, resumes and overrides it, such as ``Script([(0.5, "hold"), (1.0, "resume"), (2.0, "feed 50")])``
    of ``machines.control``.
    """
    from machines.runner import RunOptions, perform

    ready = plan(program, machine, work_offset=work_offset, dialect=dialect, solver=solver)
    options = RunOptions(port="sim", seed=seed, profile=profile, control=control, fit_bus=fit_bus)
    return perform(ready.job, ready.plan, ready.machine, options)


def _text(program: str | Path) -> tuple[str, str]:
    """Name and text of a program."""
    if isinstance(program, str) and "\n" in program:
        return "<program>", program
    path = Path(program)
    data = path.read_bytes()
    try:
        return str(path), data.decode("utf-8")
    except UnicodeDecodeError:
        return str(path), data.decode("latin-1")


def _setup(name: str, dialect: str, work_offset: Sequence[float]) -> Setup:
    from gcode.setup import Setup

    setup = Setup(file=name, dialect=dialect, include=(str(Path(name).parent),))
    return replace(setup, work_offset=_nine(work_offset)) if work_offset else setup


def _nine(values: Sequence[float]) -> Position:
    x, y, z, a, b, c, u, v, w = (*values, *(0.0,) * (9 - len(values)))
    return x, y, z, a, b, c, u, v, w
