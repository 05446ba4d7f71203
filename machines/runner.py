"""One run from a planned job to its verdict: what ``run`` and ``verify`` have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gcode.canon import AXES, Position
from machines.bringup import is_simulated
from machines.busload import Load, overload
from machines.cautions import cautions
from machines.choice import Choice
from machines.control import Control
from machines.fitting import fitted
from machines.job import Job
from machines.judge import judge
from machines.load import MachineFile
from machines.outcome import Outcome, StreamStatistics
from machines.outputs_judge import with_outputs_judged
from machines.parts import Part, parts_of, request
from machines.profiles import profiles_used
from machines.programmed import programmed_path
from machines.questions import NOBODY_READS, questions
from machines.schema import MachineConfig
from machines.session import Note, Session, SessionError
from machines.settling import with_settled_shafts
from machines.verdict import Verdict
from machines.wiring import every_motor, motors, planned_axes, scale_of, stands_within
from nmc.program import Evidence
from planner.motors import ServoMotor
from planner.plan import Plan
from planner.retime import RetimablePlan, rehearse
from planner.stream import Progress
from planner.types import Trajectory, nobody_asks
from sim.build import Simulation
from sim.trace import Trace
from sim.violations import Violation


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What the caller may choose. ``port``: instead of the file's; ``seed``: instead of the twin's."""

    port: str | None = None
    seed: int | None = None
    profile: str = "auto"
    home: tuple[str, ...] = ()
    ask: Callable[[str], bool] | None = None
    """Puts a request to whoever stands at the machine; True: it is done, go on. None: nobody is there."""
    watch: Callable[[Evidence], None] | None = None
    """Told of every exchange."""
    disturb: Callable[[Simulation, Evidence], None] | None = None
    """Told of every exchange on the twin, to make something go wrong there."""
    control: Control | None = None
    """Hold, resume, override, stop."""
    warn: Callable[[str], None] | None = None
    """Told in words, before anything moves, what the plan asks of a bus that cannot follow."""
    fit_bus: bool | None = None
    """Plan with lower accelerations or speeds where a bus cannot follow; slow down where that shows only later. None:
    so, unless a bus is led by Stop Here points: they are off by half of what an axis goes between two of them, in
    proportion to speed."""
    tell: Callable[[str], None] | None = None
    """Told in words, before anything moves, which profile was chosen and why, where that is not plain, and what was
    changed in the plan for a bus that is too slow."""


Replan = Callable[[Position], tuple[Job, Plan]]
"""Reads and plans the job again from another start."""


@dataclass(frozen=True, slots=True, eq=False)
class RunResult:
    """Everything a run leaves behind. ``trace``: of the twin; ``records``: bytes of real ports as text by bus.

    ``verdict`` is None after a stop or a fault; ``fault`` then says what happened. ``job`` and ``plan`` are those that
    ran: from where the machine really stood, slowed for a bus that cannot follow, and after holds and overrides with
    the times that held.
    """

    job: Job
    plan: Plan
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
    replan: Replan | None = None,
) -> RunResult:
    """Run a planned job on a machine and judge it. A fault of the machine is a result, not an exception.

    ``replan``: called when the machine does not stand where the plan begins; what it raises ends the run before motion.
    """
    config = machine.config
    asked = None if is_simulated(config, options.port) else next(questions(job.commands), None)
    if asked is not None:
        return RunResult(job, plan, None, None, None, (), {}, f"line {asked[0]}: {NOBODY_READS}; nothing has moved")
    outcome: Outcome | None = None
    load: Load | None = None
    choice: Choice | None = None
    bus_notes: tuple[str, ...] = ()
    fault = ""
    with Session(config, port=options.port, seed=options.seed, note=note) as session:
        session.watch = partial(_told, session, options)
        try:
            if not is_simulated(config, options.port):
                rehearse(plan, motors(config))
            session.connect()
            if options.home:
                session.home(options.home)
            job, plan = _from_here(session, job, plan, replan)
            choice = _choose(session, options)
            options = replace(options, profile=choice.profile)
            plan, load, bus_notes = _overload(config, job, plan, options)
            for words in bus_notes:
                session.note("planned_for_bus", session.now_ns, message=words)
            plan, outcome = _run_parts(session, plan, options, progress or _nothing, stop_requested or _never)
        except SessionError as error:
            fault = _with_places(str(error), error.positions, machine)
        simulation = session.simulation
        records = session.records()
        trace = _scaled(simulation.trace(), outcome, machine) if simulation else None
        violations = tuple(simulation.violations) if simulation else ()
        counts = simulation.log.counts() if simulation else {}
        if outcome is not None and outcome.finished:
            outcome = with_settled_shafts(session.connection, outcome)
    if outcome is not None and not outcome.finished:
        fault = _with_places(f"stopped on request in line {outcome.line}", outcome.positions, machine)
    if outcome is None or fault:
        return RunResult(job, plan, outcome, None, trace, violations, records, fault)
    programmed = programmed_path(job.commands, planned_axes(config), job.start)
    verdict = judge(config, plan, outcome, trace, counts, programmed)
    verdict = with_outputs_judged(verdict, config, outcome.switched, trace, outcome.plan_start_ns)
    profiles = profiles_used(config, options.profile, is_simulated(config, options.port))
    verdict = replace(
        verdict,
        profiles=profiles,
        warnings=cautions(verdict, load, config.verify.contour_steps),
        profile_notes=choice.notes if choice else (),
        bus_notes=bus_notes,
    )
    return RunResult(job, plan, outcome, verdict, trace, violations, records)


def _choose(session: Session, options: RunOptions) -> Choice:
    """The profile of the run, told where it is not plain."""
    choice = session.choose(options.profile)
    if options.tell is not None:
        for words in choice.notes:
            options.tell(words)
    return choice


def _fits(config: MachineConfig, options: RunOptions) -> bool:
    """Whether the motion is to be slowed for a bus that cannot follow."""
    if options.fit_bus is not None:
        return options.fit_bus
    used = profiles_used(config, options.profile, is_simulated(config, options.port))
    return "stop-here" not in used.values()


def _overload(
    config: MachineConfig, job: Job, plan: Plan, options: RunOptions
) -> tuple[Plan, Load | None, tuple[str, ...]]:
    """The plan to run, made slower where a bus cannot follow; what is still too much for it, if anything; and notes.

    All of it is told before anything moves.
    """
    simulated = is_simulated(config, options.port)
    try:
        load = overload(config, plan.trajectory, options.profile, simulated)
    except ValueError as error:
        raise SessionError(str(error)) from None
    fits = _fits(config, options)
    notes: tuple[str, ...] = ()
    if load is not None and fits:
        fit = fitted(job, config, plan, load, options.profile, simulated)
        plan, load = fit.plan, fit.load
        notes = (fit.words,) if fit.words else ()
        if notes and options.tell is not None:
            options.tell(fit.words)
    if load is not None and options.warn is not None:
        options.warn(load.words() if fits else f"{load.words()} (--fit-bus)")
    return plan, load, notes


def _run_parts(
    session: Session,
    plan: Plan,
    options: RunOptions,
    progress: Callable[[Progress], None],
    stop_requested: Callable[[], bool],
) -> tuple[Plan, Outcome]:
    """Run the trajectory; on ports, part by part, with a wait for whoever stands at the machine before each.

    The plan comes back with the times that held in the end; one in several parts as it was.
    """

    def run(trajectory: Trajectory, told: Callable[[Progress], None]) -> Outcome:
        return session.run(
            trajectory,
            profile=options.profile,
            progress=told,
            stop_requested=stop_requested,
            control=options.control,
            fit_bus=_fits(session.config, options),
        )

    alive = session.connection.alive
    whole = retimable(plan, alive=alive)
    parts = (
        [] if session.simulation is not None else list(parts_of(plan.trajectory, session.config.spindle is not None))
    )
    if len(parts) < 2 and not any(part.waits for part in parts):
        outcome = run(whole, progress)
        if outcome.retimed and outcome.finished and isinstance(whole, RetimablePlan):
            plan = replace(plan, trajectory=whole.streamed())
        return plan, outcome
    asked = session.config.user_command
    requests = [request(wait, asked) for part in parts for wait in part.waits]
    if requests and options.ask is None:
        raise SessionError(f"{requests[0]}: nobody is there to do it")
    outcomes: list[Outcome] = []
    for part in parts:
        for wait in part.waits:
            session.hold(request(wait, asked), options.ask or _nobody)

        def shifted(inner: Progress, begin_s: float = part.begin_s) -> None:
            progress(replace(inner, time_s=inner.time_s + begin_s, duration_s=plan.trajectory.duration_s))

        outcomes.append(run(retimable(plan, part, alive), shifted))
        if not outcomes[-1].finished:
            break
    return plan, _joined(outcomes)


def retimable(plan: Plan, part: Part | None = None, alive: Callable[[], None] = nobody_asks) -> Trajectory:
    """The plan, or a part of it, so that it can be held and overridden, if it can be.

    ``alive``: called between bounded pieces of what that takes.
    """
    if plan.setting is None:
        return plan.trajectory if part is None else part
    if part is None:
        return RetimablePlan(plan, alive=alive)
    return RetimablePlan(plan, part, part.begin_s, part.own, alive)


def _joined(outcomes: list[Outcome]) -> Outcome:
    """One outcome of several parts: bus use is summed, the rest is that of the first and the last."""
    if len(outcomes) == 1:
        return outcomes[0]
    each = [outcome.statistics for outcome in outcomes]
    strains = [statistics.strain_steps for statistics in each if statistics.strain_steps is not None]
    total = StreamStatistics(
        packets=sum(statistics.packets for statistics in each),
        bytes=sum(statistics.bytes for statistics in each),
        busy_ns=sum(statistics.busy_ns for statistics in each),
        loads=sum(statistics.loads for statistics in each),
        late_slices=sum(statistics.late_slices for statistics in each),
        slice_ms=max(statistics.slice_ms for statistics in each),
        host_delay_p99_ms=max(statistics.host_delay_p99_ms for statistics in each),
        host_delay_max_ms=max(statistics.host_delay_max_ms for statistics in each),
        late_exchanges=sum(statistics.late_exchanges for statistics in each),
        least_speed=min(statistics.least_speed for statistics in each),
        strain_steps=max(strains, default=None),
        unheeded=next((statistics.unheeded for statistics in each if statistics.unheeded), ""),
    )
    first, last = outcomes[0], outcomes[-1]
    holds = tuple(hold for outcome in outcomes for hold in outcome.holds)
    return replace(
        last,
        plan_start_ns=first.plan_start_ns,
        begins_at=first.begins_at,
        statistics=total,
        holds=holds,
        retimed=any(outcome.retimed for outcome in outcomes),
    )


def _told(session: Session, options: RunOptions, evidence: Evidence) -> None:
    if options.watch is not None:
        options.watch(evidence)
    if options.disturb is not None and session.simulation is not None:
        options.disturb(session.simulation, evidence)


def _nobody(_request: str) -> bool:
    return False


def _never() -> bool:
    return False


def _nothing(_progress: Progress) -> None:
    return None


def _from_here(session: Session, job: Job, plan: Plan, replan: Replan | None) -> tuple[Job, Plan]:
    """The job and plan that begin where the machine stands."""
    where = session.where()
    slack = {motor.axis: (stands_within(motor) + 0.5) / abs(scale_of(motor)) for motor in every_motor(session.config)}
    away = [axis for axis, place in where.items() if abs(place - job.start[AXES.index(axis)]) > slack[axis]]
    if not away:
        return job, plan
    if replan is None:
        places = ", ".join(f"{axis} at {where[axis]:.3f}" for axis in away)
        raise SessionError(f"the plan does not begin where the machine stands ({places})")
    return replan(position_of(where))


def position_of(where: Mapping[str, float]) -> Position:
    """A position of nine from axes by name, 0 for those that are not there."""
    x, y, z, a, b, c, u, v, w = (where.get(axis, 0.0) for axis in AXES)
    return x, y, z, a, b, c, u, v, w


def _scaled(trace: Trace, outcome: Outcome | None, machine: MachineFile) -> Trace:
    """The trace with what only the machine's description knows: scales, and where the plan begins."""
    driven = {motor.name: motor for motor in every_motor(machine.config)}
    steps = [0.0 if isinstance(motor := driven[name], ServoMotor) else scale_of(motor) for name in trace.axes]
    counts = [scale_of(motor) if isinstance(motor := driven[name], ServoMotor) else 0.0 for name in trace.axes]
    return replace(
        trace,
        steps_per_unit=np.array(steps),
        counts_per_unit=np.array(counts),
        plan_start_ns=outcome.plan_start_ns if outcome else 0,
    )


def scales(machine: MachineFile) -> dict[str, float]:
    """Steps or counts a unit by motor."""
    return {motor.name: scale_of(motor) for motor in every_motor(machine.config)}


def _with_places(words: str, positions: dict[str, int] | None, machine: MachineFile) -> str:
    """The fault and where the motors stand, as read back from their chips."""
    if not positions:
        return words
    by_motor = scales(machine)
    spaced = {name: f"{name} " if name[-1].isdigit() else name for name in positions}
    places = " ".join(f"{spaced[name]}{steps / by_motor[name]:.3f}" for name, steps in positions.items())
    return f"{words}; every motor stands, at {places} (read back)"
