"""``groupstart check``: every mistake of a program, each with its place and a hint, before anything moves."""

from __future__ import annotations

import click

from groupstart.exits import EXIT_REFUSED, VerbError
from groupstart.inputs import (
    counted,
    diagnostic_texts,
    open_machine,
    program_setup,
    read_program,
    tell_dialect,
)
from groupstart.options import file_argument
from groupstart.programoptions import ProgramChoices, program_options


@click.command(name="check")
@file_argument
@click.option("-m", "--machine", metavar="NAME|PATH", help="Hold the program against this machine's axes and travel.")
@program_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each diagnostic.")
def command(file: str, machine: str | None, choices: ProgramChoices, as_json: bool) -> None:
    """Parse and interpret FILE; print every error with line, column, caret and a hint.

    Exit status 1 if there are errors; warnings alone leave it at 0.
    """
    text = read_program(file)
    setup = program_setup(file, choices)
    if machine is None:
        from gcode.interp import diagnose

        diagnostics = diagnose(text, setup)
    else:
        from machines.job import read_job

        diagnostics = list(read_job(text, setup, open_machine(machine).config).diagnostics)
    for line in diagnostic_texts(diagnostics, text, as_json):
        click.echo(line)
    failed = any(item.severity == "error" for item in diagnostics)
    tell_dialect(text, choices, failed)
    summary = f"{file}: {counted(diagnostics)}"
    if failed:
        raise VerbError(summary, EXIT_REFUSED)
    click.echo(summary, err=True)
