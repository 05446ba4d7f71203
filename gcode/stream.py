"""Executing a program without O-words as it is read: plain runs as columns, every other line by the interpreter.

Nothing but the present chunk is kept. If an O-word turns up, the whole program is read and execution goes on in it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Protocol

from gcode.dialects import Dialect
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.reading import read_line
from gcode.textsource import Source

if TYPE_CHECKING:
    from gcode.block import Line
    from gcode.columns import F8, I8
    from gcode.flow import Flow
    from gcode.templates import Templates

THREADS = "OPENBLAS_NUM_THREADS"
FEW_BYTES = 1 << 9
"""Shorter programs are executed line by line."""
WORTH_LOADING_BYTES = 1 << 16
"""Shorter programs are executed line by line too if numpy is not there yet: to load it would take longer."""
WORTH_SHAPES = 300
"""Lines with expressions after which shapes are looked for, if numpy is not there yet."""
CALLS = (98.0,)
LATHE_CYCLES = (70.0, 71.0, 71.1, 71.2, 72.0, 72.1, 72.2)
MAX_STOPS = 12
"""A chunk in which the columns stop so often is executed line by line."""


def load_numpy() -> None:
    """Imports numpy without the threads of its linear algebra: columns do not use them, and they cost time."""
    if "numpy" in sys.modules or THREADS in os.environ:
        return
    os.environ[THREADS] = "1"
    try:
        import numpy  # noqa: F401
    finally:
        del os.environ[THREADS]


class Executor(Protocol):
    """What the stream needs of a run."""

    machine: Machine
    dialect: Dialect

    def execute_text(self, number: int, text: str) -> None:
        """Reads and executes one line, and reports what is wrong with it."""

    flow: Flow

    def may_run_columns(self) -> bool:
        """Whether runs of lines may be executed at once."""

    def warn_rapid(self, number: int) -> None:
        """Warns of a rapid below Z0 on a line."""

    def has_reported(self, code: str) -> bool:
        """Whether a once-only diagnostic was given."""


class NeedsStructureError(Exception):
    """The line at ``index`` (from 0) has an O-word, or a call: the whole program must be known."""

    def __init__(self, index: int) -> None:
        super().__init__(index)
        self.index = index


class Stream:
    """The state of reading: percent signs, and the number of the next line."""

    def __init__(self, run: Executor, source: Source) -> None:
        self.run = run
        self.source = source
        self.number = 0
        self.percent = False
        self.closed = False
        self.last_text = ""
        self.last_number = 0
        self._begun = False
        self._maybe_closed = False
        self._templates: Templates | None = None
        self._expressions = 0
        self._columns_begun = False

    def steps(self) -> Iterator[int]:
        """Executes the program; yields after every line or run, so that what it gave can be taken.

        Raises ``NeedsStructureError``.
        """
        for chunk in self.source.chunks():
            worth = FEW_BYTES if "numpy" in sys.modules else WORTH_LOADING_BYTES
            if len(chunk) < worth or not self.run.may_run_columns():
                yield from self._lines(chunk.decode("utf-8", "surrogateescape").split("\n")[:-1])
            else:
                yield from self._chunk(chunk)
            if self.run.machine.finished:
                return
        self._flush()
        yield self.number

    def _chunk(self, chunk: bytes) -> Iterator[int]:
        load_numpy()
        import numpy as np

        from gcode.blockpath import MIN_RUN
        from gcode.columns import keep_freed_memory, tabulate

        if not self._columns_begun:
            self._columns_begun = True
            keep_freed_memory()
        table = tabulate(chunk)
        count = len(table.plain)
        edges = np.flatnonzero(np.diff(table.plain)) + 1
        bounds = [0, *edges.tolist(), count]
        starts = table.starts
        stops = 0
        for first, last in pairwise(bounds):
            at = first
            if table.plain[first] and last - first >= MIN_RUN and self._ready():
                while at < last and stops < MAX_STOPS:
                    done = self._columns(table.values[:, at:last])
                    at += done
                    if done:
                        yield self.number
                    if at < last:
                        stops += 1
                        yield from self._lines(_texts(chunk, starts, at, at + 1))
                        at += 1
                        if self.run.machine.finished or last - at < MIN_RUN or not self._ready():
                            break
            if at < last:
                yield from self._lines(_texts(chunk, starts, at, last))
            if self.run.machine.finished:
                return

    def _ready(self) -> bool:
        from gcode.blockpath import can_run

        return can_run(self.run.machine)

    def _columns(self, values: F8) -> int:
        from gcode.blockpath import execute_run

        machine = self.run.machine
        self._flush()
        done = execute_run(
            machine,
            values,
            self.number + 1,
            machine.emit.block,
            strict_arcs=not self.run.has_reported("GC206"),
            strict_rapids=not self.run.has_reported("GC216"),
        )
        if done:
            if self._templates is not None:
                self._templates.prepare()
            self.number += done
            self.last_number = self.number
            self._begun = True
            self._maybe_closed = False
        return done

    def _lines(self, texts: list[str]) -> Iterator[int]:
        for text in texts:
            self.number += 1
            stripped = text.strip()
            if not stripped:
                continue
            self.last_text, self.last_number = text, self.number
            if stripped == "%" and self._percent_line():
                if self.closed:
                    return
                continue
            self._begun = True
            self._maybe_closed = False
            templates = self._shapes() if "[" in text or "#" in text else None
            if templates is not None and templates.allowed and templates.run(self.number, text):
                if templates.is_full():
                    self._flush()
                    yield self.number
                continue
            self._flush()
            self.run.execute_text(self.number, text)
            if self._templates is not None:
                self._templates.prepare()
            yield self.number
            if self.run.machine.finished:
                return

    def _shapes(self) -> Templates | None:
        """The shapes of lines with expressions, once there are enough of these."""
        if self._templates is None and self.run.may_run_columns():
            self._expressions += 1
            if self._expressions > WORTH_SHAPES or "numpy" in sys.modules:
                load_numpy()
                from gcode.templates import Templates

                self._templates = Templates(self.run.machine, self.run.flow.program)
                self._templates.prepare()
        return self._templates

    def _flush(self) -> None:
        """Hands out rows that shapes gave."""
        if self._templates is not None and self._templates.rows:
            for line in self._templates.flush():
                self.run.warn_rapid(line)

    def _percent_line(self) -> bool:
        """The first percent sign opens, the next one closes; elsewhere it is an error (lenient dialects: a remark)."""
        if not self._begun and not self.percent:
            self.percent = True
            return True
        if self.run.dialect.lenient:
            self._maybe_closed = True
            return True
        if self.percent:
            self.closed = True
            self.run.machine.finished = True
            return True
        return False

    def is_closed(self) -> bool:
        """Whether the program ended with a percent sign."""
        return self.closed or self._maybe_closed


def _texts(chunk: bytes, starts: I8, first: int, last: int) -> list[str]:
    """The lines from ``first`` to before ``last``."""
    text = chunk[starts[first] : starts[last] - 1].decode("utf-8", "surrogateescape")
    lines = text.split("\n")
    return [line.rstrip("\r") for line in lines] if "\r" in text else lines


def plain_line(text: str, number: int, dialect: Dialect) -> tuple[Line | None, tuple[GcodeError, ...]]:
    """Reads a line of a stream. Raises ``NeedsStructureError`` for O-words and calls, and ``GcodeError``."""
    read = read_line(text, number, dialect)
    line = read.line
    if line is not None and line.statement is not None:
        raise NeedsStructureError(number - 1)
    if line is not None:
        for word in line.words:
            if word.value in (LATHE_CYCLES if word.letter == "g" else CALLS if word.letter == "m" else ()):
                raise NeedsStructureError(number - 1)
    return line, read.warnings
