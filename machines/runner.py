"""One run from a planned job to its verdict: what ``run`` and ``verify`` have in common."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from machines.job import Job
from machines.judge import judge
from machines.load import MachineFile
from machines.programmed import programmed_path
from machines.session import Note, Outcome, Session, SessionError
from machines.verdict import Verdict
from machines.wiring import motor_tables, planned_axes
from planner.plan import Plan
from planner.stream import Progress
from sim.trace import Trace
from sim.violations import Violation


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What the caller may choose. ``port``: instead of the file's; ``seed``: instead of the twin's."""

    port: str | None = None
    seed: int | None = None
    profile: str = "auto"


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """Everything a run leaves behind. ``trace``: of the twin; ``records``: bytes of real ports as text by bus.

    ``verdict`` is None after a stop or a fault; ``fault`` then says what happened.
    """

    outcome: Outcome | None
    verdict: Verdict | None
    trace: Trace | None
    violations: tuple[Violation, ...]
    records: dict[str, list[str]]
    fault: str = ""


def perform(
    job: Job,
    plan: Plan,
    machine: MachineFile,
    options: RunOptions,
    *,
    note: Note | None = None,
    progress: Callable[[Progress], None] | None = None,
    stop_requested: Callable[[], bool] | None = None,
) -> RunResult:
    """Run a planned job on a machine and judge it. A fault of the machine is a result, not an exception."""
    config = machine.config
    outcome: Outcome | None = None
    fault = ""
    with Session(config, port=options.port, seed=options.seed, note=note) as session:
        try:
            session.connect()
            outcome = session.run(
                plan.trajectory,
                profile=options.profile,
                progress=progress,
                stop_requested=stop_requested or (lambda: False),
            )
        except SessionError as error:
            fault = _with_places(str(error), error.positions, machine)
        simulation = session.simulation
        records = session.records()
    trace = simulation.trace() if simulation else None
    violations = tuple(simulation.violations) if simulation else ()
    if outcome is not None and not outcome.finished:
        fault = _with_places(f"stopped on request in line {outcome.line}", outcome.positions, machine)
    if outcome is None or fault:
        return RunResult(outcome, None, trace, violations, records, fault)
    programmed = programmed_path(job.commands, planned_axes(config), job.start)
    counts = simulation.log.counts() if simulation else {}
    verdict = judge(config, plan, outcome, trace, counts, programmed)
    return RunResult(outcome, verdict, trace, violations, records)


def scales(machine: MachineFile) -> dict[str, float]:
    """Steps a unit by motor, as a trace keeps them."""
    return {name: table.steps_per_unit for name, (_, table) in motor_tables(machine.config).items()}


def _with_places(words: str, positions: dict[str, int] | None, machine: MachineFile) -> str:
    """The fault and where the motors stand, as read back from their chips."""
    if not positions:
        return words
    by_motor = scales(machine)
    places = " ".join(f"{name}{steps / by_motor[name]:.3f}" for name, steps in positions.items())
    return f"{words}; every motor stands, at {places} (read back)"
