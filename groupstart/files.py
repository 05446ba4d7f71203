"""Files that verbs write: what the disk says is told with the file's name."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError


@contextmanager
def writing(path: str | Path) -> Iterator[None]:
    """Around everything that writes to ``path``. Raises VerbError (status 2) with its name where the disk refuses."""
    try:
        yield
    except BrokenPipeError:
        raise  # the reader of a pipe has left: nothing is wrong with a file
    except OSError as error:
        raise VerbError(f"{path}: {error.strerror or error}", EXIT_FAULT) from None


class Leftovers:
    """Files that a run leaves. One that cannot be written keeps neither the others nor the verdict from being told."""

    def __init__(self) -> None:
        self.troubles: list[str] = []

    @contextmanager
    def file(self, path: str | Path) -> Iterator[None]:
        """Around everything that writes to ``path``; where the disk refuses, that is told at the end."""
        try:
            with writing(path):
                yield
        except VerbError as error:
            self.troubles.append(error.text)

    def end(self, good: bool) -> None:
        """After the verdict. Raises VerbError: 1 if it was bad, 2 if it was good but a file is missing."""
        if not good:
            raise VerbError("\n".join(self.troubles), EXIT_REFUSED)
        if self.troubles:
            raise VerbError("\n".join(self.troubles), EXIT_FAULT)


def wrote(path: str | Path) -> None:
    """Say that a file is there."""
    click.echo(f"wrote {path}", err=True)
