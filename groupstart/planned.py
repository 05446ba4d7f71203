"""From a file and options to a planned job, with the words for every refusal on the way."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import click

from groupstart.exits import EXIT_REFUSED, VerbError
from groupstart.inputs import diagnostic_texts, program_setup, refuse_if_bad, tell_dialect

if TYPE_CHECKING:
    from gcode.canon import Position
    from groupstart.programoptions import ProgramChoices
    from machines.job import Job
    from machines.load import MachineFile
    from planner.plan import Plan
    from planner.timing import Solver


def checked_job(
    name: str, text: str, choices: ProgramChoices, machine: MachineFile, start: Position | None = None
) -> Job:
    """Read and check a program; its diagnostics go to stderr. Raises VerbError if there are errors.

    ``start``: where the machine stands, machine zero if it is not known yet.
    """
    from machines.job import read_job

    setup = program_setup(name, choices)
    if start is not None:
        setup = replace(setup, start=start)
    job = read_job(text, setup, machine.config)
    tell_dialect(text, choices, failed=bool(job.errors))
    refuse_if_bad(job)
    return job


def planned(job: Job, machine: MachineFile, solver: str) -> Plan:
    """Plan a checked job. Raises VerbError with the program's line if it cannot be planned on this machine."""
    from machines.cy545 import stand_ins
    from machines.job import plan_diagnostic, plan_job
    from planner.errors import PlanError

    for words in stand_ins(machine.config):
        click.echo(f"note: {words}", err=True)
    try:
        return plan_job(job, machine.config, cast("Solver", solver))
    except PlanError as error:
        found = plan_diagnostic(error, job)
        raise VerbError("\n".join(diagnostic_texts([found], job.text)), EXIT_REFUSED) from None


def refuse_unstreamable(machine: MachineFile, profile: str, simulated: bool) -> None:
    """Raise VerbError if programs cannot run on this machine, or not with this profile."""
    from machines.profiles import choose_profile, why_not_streamed

    reason = why_not_streamed(machine.config)
    try:
        if not reason:
            choose_profile(machine.config, profile, simulated)
    except ValueError as error:
        reason = str(error)
    if reason:
        raise VerbError(f"{machine.config.machine.name}: {reason}", EXIT_REFUSED)


def print_report(plan: Plan, as_json: bool) -> None:
    """The plan report on stdout."""
    if as_json:
        click.echo(json.dumps(json.loads(plan.report.as_json()), indent=2))
    else:
        click.echo(plan.report.text())
