"""``groupstart plan``: a program's motion, planned: the report on stdout, the trajectory in a file."""

from __future__ import annotations

import click

from groupstart.files import writing, wrote
from groupstart.inputs import open_machine, read_program
from groupstart.options import file_argument, machine_option, solver_option
from groupstart.planned import checked_job, planned, print_report
from groupstart.programoptions import ProgramChoices, program_options


@click.command(name="plan")
@file_argument
@machine_option
@program_options
@solver_option
@click.option("-o", "--output", type=click.Path(), help="File for the trajectory (plan.npz).")
@click.option("--json", "as_json", is_flag=True, help="The report as JSON.")
def command(
    file: str,
    machine: str,
    choices: ProgramChoices,
    solver: str,
    output: str | None,
    as_json: bool,
) -> None:
    """Plan FILE on a machine: print the report; with -o also write the trajectory.

    plan.npz holds t_s (at most 1 ms apart, and every junction), q, v (mm or degrees, machine coordinates), line, axes.
    """
    text = read_program(file)
    described = open_machine(machine)
    job = checked_job(file, text, choices, described)
    result = planned(job, described, solver)
    if output is not None:
        with writing(output):
            result.save(output)
        wrote(output)
    print_report(result, as_json)
