"""The front door of the interpreter: a program's text goes in, canonical commands and diagnostics come out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from gcode.canon import Command, MoveBlock
from gcode.errors import Diagnostic
from gcode.run import Run
from gcode.setup import Setup
from gcode.synch import Assumptions
from gcode.textsource import FileSource, TextSource


@dataclass(frozen=True)
class Interpretation:
    """What a program means.

    stream: everything before the first error, long runs of plain moves as blocks. commands: the same, one by one.
    diagnostics: of the whole file, in order of lines. dialect: the one it was read in, and why.
    """

    stream: list[Command | MoveBlock]
    diagnostics: list[Diagnostic]
    dialect: str = "linuxcnc"
    dialect_reason: str = ""

    @cached_property
    def commands(self) -> list[Command]:
        """The commands before the first error, blocks taken apart."""
        from gcode.expand import expanded

        return list(expanded(self.stream))

    @property
    def errors(self) -> list[Diagnostic]:
        """The diagnostics that are errors."""
        return [diagnostic for diagnostic in self.diagnostics if diagnostic.severity == "error"]


def interpret(text: str, setup: Setup | None = None, assumptions: Assumptions | None = None) -> Interpretation:
    """Interprets a program. Never raises for what the text contains: the diagnostics say it."""
    run = Run(TextSource(text), setup or Setup())
    stream = list(run.stream(assumptions))
    return Interpretation(stream, ordered(run), run.dialect.name, run.dialect_reason)


def diagnose(text: str, setup: Setup | None = None, assumptions: Assumptions | None = None) -> list[Diagnostic]:
    """The diagnostics of a program. What it commands is not kept, so a long loop needs no memory."""
    run = Run(TextSource(text), setup or Setup())
    for _ in run.stream(assumptions):
        pass
    return ordered(run)


__all__ = ["FileRun", "Interpretation", "Run", "diagnose", "interpret", "ordered"]


def ordered(run: Run) -> list[Diagnostic]:
    """The diagnostics of a run by file and place, those of the main program first."""
    return sorted(run.diagnostics, key=lambda d: (d.file != run.setup.file, d.file, d.line, d.column))


class FileRun:
    """A program in a file, interpreted piece by piece: iterate over it, then read ``diagnostics``."""

    def __init__(self, path: Path, setup: Setup | None = None, assumptions: Assumptions | None = None) -> None:
        self._run = Run(FileSource(path), setup or Setup(file=path.name))
        self._assumptions = assumptions

    def __iter__(self) -> Iterator[Command | MoveBlock]:
        """Commands and blocks as they come. Raises OSError if the file cannot be read."""
        return self._run.stream(self._assumptions)

    @property
    def diagnostics(self) -> list[Diagnostic]:
        """What was found so far."""
        return ordered(self._run)
