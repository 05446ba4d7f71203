"""What the verbs are given, opened: programs and machines, with the words for what cannot be read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError

if TYPE_CHECKING:
    from gcode.errors import Diagnostic
    from gcode.inifile import Ini
    from gcode.setup import Setup, Tool
    from groupstart.programoptions import ProgramChoices
    from machines.job import Job
    from machines.load import MachineFile

Table = TypeVar("Table")


def read_program(path: str) -> str:
    """Text of a program. Line ends stay as they are; bytes that are not UTF-8 are read as Latin-1.

    Raises VerbError (status 2) if there is no readable file.
    """
    try:
        data = Path(path).read_bytes()
    except (OSError, ValueError) as error:
        words = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise VerbError(f"{path}: {words}", EXIT_FAULT) from None
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def open_machine(name_or_path: str) -> MachineFile:
    """Machine of a name or path. Raises VerbError: 1 for a file with mistakes, 2 if there is none."""
    from machines.errors import MachineError, MachineMissingError
    from machines.load import read_machine

    try:
        return read_machine(name_or_path)
    except MachineError as error:
        raise VerbError(str(error), EXIT_REFUSED) from None
    except MachineMissingError as error:
        raise VerbError(str(error), EXIT_FAULT) from None


def program_setup(file: str, choices: ProgramChoices) -> Setup:
    """What the interpreter is told beside the program itself; opens the files that the options name.

    Raises VerbError: 2 for a file that cannot be read, 1 for one that says what it must not.
    """
    from gcode.setup import Setup

    parameter_file, include, values = choices.parameters, choices.include, None
    if choices.ini is not None:
        ini = _read_ini(choices.ini)
        values = ini.values
        include += ini.subroutine_path
        # LinuxCNC makes the file when it first saves parameters: until then it is not there, and that is no mistake
        if parameter_file is None and ini.parameter_file is not None and ini.parameter_file.exists():
            parameter_file = str(ini.parameter_file)
    tools = None if choices.tool_table is None else _tools(choices.tool_table)
    parameters = {} if parameter_file is None else _parameters(parameter_file)
    return Setup(
        tools=tools,
        parameters=parameters,
        work_offset=choices.work_offset,
        dialect=choices.dialect,
        machine_units=choices.machine_units,
        file=file,
        include=(*include, str(Path(file).parent)),
        ini=values,
        trim_concave=choices.trim_concave,
    )


def tell_dialect(text: str, choices: ProgramChoices, failed: bool) -> None:
    """After a refusal, say on stderr if another dialect would read the program."""
    if not failed or choices.dialect == "auto":
        return
    from gcode.dialects import guess

    guessed, sign = guess(text)
    if guessed not in (choices.dialect, "linuxcnc"):
        click.echo(f"it looks like {guessed}: {sign}; --dialect auto reads it so", err=True)


def _tools(path: str) -> dict[int, Tool]:
    from gcode.tooltable import read_tool_table

    return _table(path, read_tool_table)


def _parameters(path: str) -> dict[int, float]:
    from gcode.tooltable import read_parameters

    return _table(path, read_parameters)


def _table(path: str, reader: Callable[[str, str], tuple[Table, list[Diagnostic]]]) -> Table:
    """Contents of a tool table or parameter file."""
    text = read_program(path)
    contents, found = reader(text, path)
    if found:
        raise VerbError("\n".join(diagnostic_texts(found, text)), EXIT_REFUSED)
    return contents


def _read_ini(path: str) -> Ini:
    from configparser import Error

    from gcode.inifile import read_ini

    try:
        return read_ini(Path(path))
    except OSError as error:
        raise VerbError(f"{path}: {error.strerror or error}", EXIT_FAULT) from None
    except Error as error:
        raise VerbError(f"{path}: not an ini file: {error.message}", EXIT_REFUSED) from None


def refuse_if_bad(job: Job, as_json: bool = False) -> None:
    """Print a job's diagnostics on stderr; raise VerbError (status 1) if there are errors among them."""
    if job.diagnostics:
        click.echo("\n".join(diagnostic_texts(job.diagnostics, job.text, as_json)), err=True)
    if job.errors:
        raise VerbError(f"{job.name}: refused, {counted(job.diagnostics)}", EXIT_REFUSED)


def diagnostic_texts(diagnostics: Sequence[Diagnostic], text: str, as_json: bool = False) -> list[str]:
    """Each diagnostic as a compiler prints it, or as one JSON object."""
    from gcode.source import split_lines

    if as_json:
        return [item.as_json() for item in diagnostics]
    lines = split_lines(text)
    return [item.text(lines[item.line - 1] if 1 <= item.line <= len(lines) else "") for item in diagnostics]


def counted(diagnostics: Sequence[Diagnostic]) -> str:
    """``2 errors, 1 warning``."""
    words = []
    for severity in ("error", "warning"):
        count = sum(item.severity == severity for item in diagnostics)
        if count:
            words.append(f"{count} {severity}" + ("s" if count > 1 else ""))
    return ", ".join(words) or "no errors"
