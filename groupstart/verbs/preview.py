"""``groupstart preview``: a picture of a program's path."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from groupstart.exits import EXIT_FAULT, VerbError
from groupstart.files import writing, wrote
from groupstart.inputs import open_machine, read_program
from groupstart.options import file_argument, machine_option, solver_option
from groupstart.planned import checked_job, planned
from groupstart.programoptions import ProgramChoices, program_options

if TYPE_CHECKING:
    from machines.job import Job
    from machines.load import MachineFile

FORMATS = (".png", ".svg", ".html")


@click.command(name="preview")
@file_argument
@machine_option
@program_options
@solver_option
@click.option(
    "-o", "--output", type=click.Path(), default="preview.png", show_default=True, help="PNG, SVG or HTML file."
)
def command(file: str, machine: str, choices: ProgramChoices, solver: str, output: str) -> None:
    """Draw the planned path of FILE: a picture (PNG, SVG), or a page to look into it (HTML, opens from disk)."""
    from groupstart.picture import draw
    from groupstart.picturedata import path_data

    target = Path(output)
    if target.suffix.lower() not in FORMATS:
        raise VerbError(f"{output}: a preview is {' or '.join(FORMATS)}", EXIT_FAULT)
    text = read_program(file)
    described = open_machine(machine)
    job = checked_job(file, text, choices, described)
    if target.suffix.lower() == ".html":
        write_page(target, job, described, solver, choices)
        return
    result = planned(job, described, solver)
    title = f"{Path(file).name} on {described.config.machine.name}, {result.trajectory.duration_s:.1f} s"
    with writing(target):
        draw(target, title, path_data(result.trajectory, job.commands))
    wrote(output)


def write_page(target: Path, job: Job, machine: MachineFile, solver: str, choices: ProgramChoices) -> None:
    """Write the page; VerbError with the program's line if it cannot be planned on this machine."""
    from groupstart.inputs import diagnostic_texts
    from groupstart.report.preview import preview_page
    from machines.job import plan_diagnostic
    from planner.errors import PlanError

    try:
        page = preview_page(job, machine, solver, choices.work_offset)
    except PlanError as error:
        raise VerbError("\n".join(diagnostic_texts([plan_diagnostic(error, job)], job.text))) from None
    with writing(target):
        target.write_text(page, encoding="utf-8")
    click.echo(f"wrote {target}, {len(page) / 1e6:.1f} MB", err=True)
