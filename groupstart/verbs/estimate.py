"""``groupstart estimate``: how long programs take, by operation and tool."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import click

from groupstart.exits import EXIT_REFUSED, VerbError
from groupstart.inputs import diagnostic_texts, open_machine, read_program
from groupstart.options import machine_option, solver_option
from groupstart.planned import checked_job
from groupstart.programoptions import ProgramChoices, program_options

if TYPE_CHECKING:
    from groupstart.report.estimate import Estimate, Share
    from machines.load import MachineFile


@click.command(name="estimate")
@click.argument("files", nargs=-1, required=True, type=click.Path(), metavar="FILE...")
@machine_option
@program_options
@solver_option
@click.option("--json", "as_json", is_flag=True, help="One JSON object a file, one a line.")
def command(files: tuple[str, ...], machine: str, choices: ProgramChoices, solver: str, as_json: bool) -> None:
    """Print the time of every FILE on a machine, by kind of motion, operation (the program's comments) and tool.

    The time is that of the plan which the machine will run. Exit status 1 if a file is refused; the others are printed.
    """
    described = open_machine(machine)
    refused, total_s = [], 0.0
    for file in files:
        try:
            found = _one(file, described, choices, solver)
        except VerbError as error:
            if len(files) == 1:
                raise
            click.echo(error.text, err=True)
            refused.append(file)
            continue
        total_s += found.time_s
        click.echo(json.dumps(found.as_json()) if as_json else _text(found))
    if len(files) > 1 and not as_json:
        click.echo(f"all: {clock(total_s)} ({total_s:.2f} s)")
    if refused:
        raise VerbError(f"{len(refused)} of {len(files)} files refused", EXIT_REFUSED)


def _one(file: str, machine: MachineFile, choices: ProgramChoices, solver: str) -> Estimate:
    from groupstart.report.estimate import estimate
    from machines.job import plan_diagnostic
    from planner.errors import PlanError

    job = checked_job(file, read_program(file), choices, machine)
    try:
        return estimate(job, machine, solver)
    except PlanError as error:
        raise VerbError("\n".join(diagnostic_texts([plan_diagnostic(error, job)], job.text)), EXIT_REFUSED) from None


def _text(found: Estimate) -> str:
    rows = [
        f"{found.file}: {clock(found.time_s)} ({found.time_s:.2f} s) on {found.machine}: "
        f"cutting {found.cutting_s:.1f} s, rapids {found.rapid_s:.1f} s, at rest {found.rest_s:.1f} s"
    ]
    for title, shares in (("operation", found.operations), ("tool", found.tools)):
        if len(shares) > 1 or (shares and shares[0].line):
            rows += [_row(title, share, found.time_s) for share in shares]
    return "\n".join(rows)


def _row(title: str, share: Share, all_s: float) -> str:
    percent = 100 * share.time_s / all_s if all_s else 0.0
    place = f"line {share.line}" if share.line else ""
    return f"  {title:<10}{clock(share.time_s):>9} {percent:5.1f} %  {place:<11} {share.name}".rstrip()


def clock(seconds: float) -> str:
    """``3725.4`` as ``1:02:05``, ``62`` as ``1:02``."""
    whole = round(seconds)
    hours, minutes = divmod(whole // 60, 60)
    return f"{hours}:{minutes:02d}:{whole % 60:02d}" if hours else f"{minutes}:{whole % 60:02d}"
