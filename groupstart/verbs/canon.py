"""``groupstart canon``: canonical commands as text, in the spelling of LinuxCNC's stand-alone interpreter."""

from __future__ import annotations

import click

from groupstart.exits import EXIT_REFUSED, VerbError
from groupstart.files import writing
from groupstart.inputs import counted, diagnostic_texts, program_setup, read_program, tell_dialect
from groupstart.options import file_argument
from groupstart.programoptions import ProgramChoices, program_options


@click.command(name="canon")
@file_argument
@program_options
@click.option("--digits", type=click.IntRange(0, 12), default=4, show_default=True, help="Decimals of positions.")
@click.option("-o", "--output", type=click.Path(), help="File to write instead of stdout.")
def command(
    file: str,
    choices: ProgramChoices,
    digits: int,
    output: str | None,
) -> None:
    """Print the canonical commands of FILE, one a line; what stands before the first error is printed in any case."""
    from gcode.canontext import canon_lines
    from gcode.interp import interpret

    text = read_program(file)
    result = interpret(text, program_setup(file, choices))
    with writing(output or "standard output"), click.open_file(output or "-", "w", encoding="utf-8") as stream:
        for line in canon_lines(result.commands, digits):
            stream.write(line + "\n")
    for words in diagnostic_texts(result.diagnostics, text):
        click.echo(words, err=True)
    tell_dialect(text, choices, failed=bool(result.errors))
    if result.errors:
        raise VerbError(f"{file}: {counted(result.diagnostics)}", EXIT_REFUSED)
