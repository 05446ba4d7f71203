"""``groupstart preview``: a picture of a program's path."""

from __future__ import annotations

from pathlib import Path

import click

from groupstart.exits import EXIT_FAULT, VerbError
from groupstart.inputs import open_machine, read_program
from groupstart.options import file_argument, machine_option, solver_option
from groupstart.planned import checked_job, planned
from groupstart.programoptions import ProgramChoices, program_options

FORMATS = (".png", ".svg")


@click.command(name="preview")
@file_argument
@machine_option
@program_options
@solver_option
@click.option("-o", "--output", type=click.Path(), default="preview.png", show_default=True, help="PNG or SVG file.")
def command(file: str, machine: str, choices: ProgramChoices, solver: str, output: str) -> None:
    """Draw the planned path of FILE: plan view coloured by speed, height and velocities over time."""
    from groupstart.picture import draw
    from groupstart.picturedata import path_data

    target = Path(output)
    if target.suffix.lower() not in FORMATS:
        raise VerbError(f"{output}: a picture is {' or '.join(FORMATS)}", EXIT_FAULT)
    text = read_program(file)
    described = open_machine(machine)
    job = checked_job(file, text, choices, described)
    result = planned(job, described, solver)
    title = f"{Path(file).name} on {described.config.machine.name}, {result.trajectory.duration_s:.1f} s"
    draw(target, title, path_data(result.trajectory, job.commands))
    click.echo(f"wrote {output}", err=True)
