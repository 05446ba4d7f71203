"""What the verbs are given, opened: programs and machines, with the words for what cannot be read."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError

if TYPE_CHECKING:
    from machines.load import MachineFile


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
