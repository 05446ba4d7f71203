"""What the verbs are given, opened: programs and machines, with the words for what cannot be read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError

if TYPE_CHECKING:
    from gcode.canon import Position
    from gcode.errors import Diagnostic
    from gcode.setup import Setup
    from machines.job import Job
    from machines.load import MachineFile


@dataclass(frozen=True, slots=True)
class ProgramChoices:
    """Options of the verbs that read a program."""

    work_offset: Position | None = None
    dialect: str = "linuxcnc"
    machine_units: Literal["mm", "inch"] = "mm"

    @classmethod
    def of(
        cls, work_offset: tuple[float, ...] | None, dialect: str, machine_units: Literal["mm", "inch"] = "mm"
    ) -> ProgramChoices:
        """From the values of the command line."""
        offset = None
        if work_offset is not None:
            x, y, z, a, b, c, u, v, w = work_offset
            offset = (x, y, z, a, b, c, u, v, w)
        return cls(offset, "linuxcnc" if dialect == "auto" else dialect, machine_units)


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
    """What the interpreter is told beside the program itself."""
    from gcode.setup import Setup

    return Setup(
        work_offset=choices.work_offset,
        dialect=choices.dialect,
        machine_units=choices.machine_units,
        file=file,
    )


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
