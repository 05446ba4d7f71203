"""What the verbs that measure a machine share: consent before anything moves, and the machine file they write."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.files import writing

if TYPE_CHECKING:
    from machines.load import MachineFile
    from machines.schema import MachineConfig


def ask_consent(config: MachineConfig, port: str | None, yes: bool, lines: Sequence[str]) -> None:
    """On a port nothing moves before somebody has said yes. Raises VerbError (status 1) otherwise."""
    from machines.bringup import is_simulated

    if is_simulated(config, port):
        return
    for line in lines:
        click.echo(line, err=True)
    if yes:
        return
    if not sys.stdin.isatty():
        raise VerbError("this moves the machine: say --yes, or run it on a terminal where it can ask", EXIT_REFUSED)
    if not click.confirm("Is everything clear, and a hand on the emergency stop?", default=False, err=True):
        raise VerbError("nothing has moved", EXIT_REFUSED)


@contextmanager
def told_in_words() -> Iterator[None]:
    """Failures of a machine at work become words and exit statuses: 1 undecided, 2 fault or stopped."""
    from machines.commission import StoppedError, UndecidedError
    from machines.session import SessionError

    try:
        yield
    except UndecidedError as error:
        raise VerbError(f"not decided: {error}; nothing is written", EXIT_REFUSED) from None
    except StoppedError:
        raise VerbError("stopped: every motor stands; nothing is written", EXIT_FAULT) from None
    except SessionError as error:
        raise VerbError(f"{error}; nothing is written", EXIT_FAULT) from None


def own_file(machine: str) -> Path | None:
    """The machine file that was named, if it is the user's own and none of the shipped ones."""
    from machines.load import shipped_machines

    return None if machine in shipped_machines() else Path(machine)


def date_of(path: Path) -> str:
    """Today, as the file system of the machine file tells it: no other wall clock is read here."""
    with writing(path):
        os.utime(path)
    return datetime.fromtimestamp(path.stat().st_mtime).strftime("%Y-%m-%d")


def write_machine(described: MachineFile, path: Path, text: str) -> None:
    """Replace the machine file in one go, if the new text is a machine and the old one is still there unchanged.

    Raises VerbError (status 2) otherwise.
    """
    from machines.errors import MachineError
    from machines.load import parse_machine

    try:
        parse_machine(text, str(path))
    except MachineError as error:
        raise VerbError(f"nothing is written: {error}", EXIT_FAULT) from None
    if path.read_text(encoding="utf-8") != described.text:
        raise VerbError(f"{path}: has been changed meanwhile; nothing is written", EXIT_FAULT)
    real = path.resolve()  # a link stays one: the file that it leads to is replaced
    beside = real.with_name(real.name + ".new")
    try:
        beside.write_text(text, encoding="utf-8", newline="")
        shutil.copymode(real, beside)
        os.replace(beside, real)
    except OSError as error:
        with suppress(OSError):
            beside.unlink(missing_ok=True)
        raise VerbError(f"{path}: {error.strerror or error}; it is as it was", EXIT_FAULT) from None
    click.echo(f"written to {path}", err=True)
