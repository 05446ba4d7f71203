"""``groupstart verify``: the dry run. A program on the machine's twin, judged; exit status 1 if it is not good."""

from __future__ import annotations

import json
from dataclasses import replace

import click

from groupstart.exits import EXIT_FAULT, VerbError
from groupstart.files import Leftovers, wrote
from groupstart.inputs import open_machine, read_program
from groupstart.options import file_argument, machine_option, servo_every_option, solver_option, stream_options
from groupstart.planned import checked_job, planned, refuse_unstreamable
from groupstart.programoptions import ProgramChoices, program_options
from groupstart.reportoptions import ReportChoices, report_options


@click.command(name="verify")
@file_argument
@machine_option
@program_options
@solver_option
@stream_options
@servo_every_option
@click.option("--json", "as_json", is_flag=True, help="The verdict as JSON.")
@click.option("--trace", type=click.Path(), help="File for everything that came out of the pins (trace.npz).")
@report_options
def command(
    file: str,
    machine: str,
    choices: ProgramChoices,
    solver: str,
    profile: str,
    seed: int | None,
    fit_bus: bool | None,
    servo_every: int,
    as_json: bool,
    trace: str | None,
    report: ReportChoices,
) -> None:
    """Run FILE on the simulated machine and judge what comes out of its pins.

    The simulator is given the bytes that chips would be given if they were fed with the same profile and answered after
    the same times; the verdict names the profile. Exit status 0 if the verdict is good, 1 if not.
    """
    from machines.runner import RunOptions, perform
    from machines.thin import thin_servo

    text = read_program(file)
    described = open_machine(machine)
    refuse_unstreamable(described, profile, simulated=True)
    job = checked_job(file, text, choices, described)
    plan = planned(job, described, solver)
    from groupstart.progress import RunProgress
    from groupstart.stopflag import StopFlag

    progress = RunProgress(plan.trajectory.duration_s, len(text.splitlines()))
    asked = RunOptions(port="sim", seed=seed, profile=profile, fit_bus=fit_bus)
    options = report.watched(replace(asked, warn=progress.warn, tell=progress.tell), plan)
    with progress, StopFlag() as stop:
        result = perform(job, plan, described, options, progress=progress, stop_requested=stop)
    leftovers = Leftovers()
    if trace is not None and result.trace is not None:
        with leftovers.file(trace):
            thin_servo(result.trace, servo_every).save(trace)
            wrote(trace)
    if result.verdict is None:
        raise VerbError("\n".join([result.fault, *leftovers.troubles]), EXIT_FAULT)
    result = report.finish(result, described, choices, options, leftovers)
    assert result.verdict is not None
    if as_json:
        click.echo(json.dumps(result.verdict.as_json(), indent=2))
    else:
        from groupstart.verdicttable import print_verdict

        print_verdict(result.verdict)
    leftovers.end(result.verdict.ok)
