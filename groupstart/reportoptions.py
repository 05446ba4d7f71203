"""``--report``, ``--fail-over``, ``--lose-steps``: what ``verify`` does beside its verdict, gathered into one value."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.files import Leftovers, wrote

if TYPE_CHECKING:
    from groupstart.programoptions import ProgramChoices
    from groupstart.report.busview import BusWatch
    from machines.load import MachineFile
    from machines.runner import RunOptions, RunResult
    from nmc.program import Evidence
    from planner.plan import Plan
    from sim.build import Simulation

REPORTS = (".html", ".json")


@dataclass(slots=True)
class ReportChoices:
    """What was asked for beside the verdict."""

    path: Path | None = None
    fail_over: dict[str, float] = field(default_factory=dict)
    slips: tuple[tuple[str, int, int], ...] = ()
    _bus: BusWatch | None = None
    _slips: Slips | None = None

    def watched(self, options: RunOptions, plan: Plan) -> RunOptions:
        """The options of a run that is watched for the report and disturbed as asked."""
        if self.path is not None:
            from groupstart.report.busview import BusWatch

            self._bus = BusWatch()
            options = replace(options, watch=self._bus.watch)
        if self.slips:
            _refuse_beyond(self.slips, plan)
            self._slips = Slips(self.slips)
            options = replace(options, disturb=self._slips.disturb)
        return options

    def finish(
        self,
        result: RunResult,
        machine: MachineFile,
        choices: ProgramChoices,
        options: RunOptions,
        leftovers: Leftovers,
    ) -> RunResult:
        """The run with the limits of ``--fail-over`` in its verdict; writes the report."""
        from groupstart.report.limits import broken_limits

        verdict = result.verdict
        if verdict is None:
            return result
        for words in [] if self._slips is None else self._slips.left():
            click.echo(words, err=True)
        reasons = verdict.reasons + lost_places(result, machine) + broken_limits(verdict, self.fail_over)
        result = replace(result, verdict=replace(verdict, ok=not reasons, reasons=reasons))
        if self.path is not None:
            seed = machine.config.sim.seed if options.seed is None else options.seed
            with leftovers.file(self.path):
                self.path.write_text(self._text(result, machine, choices, seed), encoding="utf-8")
                wrote(self.path)
        return result

    def _text(self, result: RunResult, machine: MachineFile, choices: ProgramChoices, seed: int) -> str:
        from groupstart.report.verifyjson import report_json
        from groupstart.report.verifypage import ReportInput, report_page

        assert self.path is not None
        start_ns = result.outcome.plan_start_ns if result.outcome else 0
        bus = None if self._bus is None else self._bus.view(start_ns)
        reasons = () if result.verdict is None else result.verdict.reasons
        source = ReportInput(result, machine, bus, reasons, seed, choices.work_offset)
        if self.path.suffix.lower() == ".json":
            return json.dumps(report_json(source), indent=2) + "\n"
        return report_page(source)


def _refuse_beyond(slips: tuple[tuple[str, int, int], ...], plan: Plan) -> None:
    """Raise VerbError for a line behind all in which the program moves."""
    last = int(plan.trajectory.line(plan.trajectory.junctions_s()).max())
    for name, steps, line in slips:
        if line > last:
            words = f"--lose-steps {name}:{steps}@{line}: the program moves in no line from {line} on"
            raise VerbError(f"{words}; the last in which it moves is {last}", EXIT_REFUSED)


def lost_places(result: RunResult, machine: MachineFile) -> tuple[str, ...]:
    """For each axis that ends elsewhere: in which line it lost its place."""
    if result.verdict is None or not any(result.verdict.end_error_steps.values()):
        return ()
    from groupstart.report.measured import measured_pins, shifts, steps_of

    trajectory = result.plan.trajectory
    measured = measured_pins(machine.config, result, trajectory)
    found = [] if measured is None else shifts(measured, trajectory, steps_of(machine.config))
    return tuple(f"{s.axis} loses {s.um:+.0f} um ({s.steps:+.1f} steps) in line {s.line}" for s in found)


class Slips:
    """Motors of the twin that slip by some steps when the program first comes to a line."""

    def __init__(self, slips: tuple[tuple[str, int, int], ...]) -> None:
        self._left = list(slips)

    def left(self) -> list[str]:
        """What has not come to slip, in words."""
        return [f"--lose-steps {name}:{steps}@{line}: nothing has slipped" for name, steps, line in self._left]

    def disturb(self, simulation: Simulation, evidence: Evidence) -> None:
        """Told of every exchange: lets what is due slip."""
        for slip in [item for item in self._left if evidence.exchange.line >= item[2]]:
            name, steps, _ = slip
            stepper = simulation.steppers().get(name)
            if stepper is None:
                known = ", ".join(simulation.steppers()) or "none"
                raise VerbError(f"--lose-steps: there is no stepper {name} on this machine; steppers: {known}")
            stepper.lose_steps(steps)
            self._left.remove(slip)


def _path(_ctx: click.Context, _param: click.Parameter, value: str | None) -> Path | None:
    if value is None:
        return None
    path = Path(value)
    if path.suffix.lower() not in REPORTS:
        raise VerbError(f"{value}: a report is {' or '.join(REPORTS)}", EXIT_FAULT)
    return path


def _limits(_ctx: click.Context, _param: click.Parameter, value: str | None) -> dict[str, float]:
    from groupstart.report.limits import parse_limits

    try:
        return parse_limits(value or "")
    except ValueError as error:
        raise VerbError(f"--fail-over: {error}", EXIT_FAULT) from None


def _slips(_ctx: click.Context, _param: click.Parameter, value: tuple[str, ...]) -> tuple[tuple[str, int, int], ...]:
    found = []
    for text in value:
        match = re.fullmatch(r"([A-Za-z]\w*):([+-]?\d+)@(\d+)", text)
        if match is None:
            raise VerbError(f"--lose-steps {text!r}: give MOTOR:STEPS@LINE, such as X:-4@120", EXIT_FAULT)
        found.append((match.group(1), int(match.group(2)), int(match.group(3))))
    return tuple(found)


def report_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a verb, which is given them as one argument ``report``."""

    @functools.wraps(function)
    def call(**options: Any) -> Any:
        chosen = ReportChoices(options.pop("report"), options.pop("fail_over"), options.pop("lose_steps"))
        return function(report=chosen, **options)

    wrapped: Callable[..., Any] = call
    for option in (
        click.option(
            "--lose-steps", multiple=True, callback=_slips, metavar="MOTOR:STEPS@LINE",
            help="Let a motor of the twin slip when the program comes to LINE, to see it found.",
        ),
        click.option("--fail-over", callback=_limits, metavar="NAME=NUMBER,...",
                     help="Exit status 1 also over these, such as contour_um=20,late_slices=0."),
        click.option("--report", callback=_path, metavar="FILE", help="Report as a page (.html) or for tools (.json)."),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return wrapped
