"""The progress of a run on stderr: a bar with line, time left and position; silent where stderr is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.progress import Progress

    from machines.control import RateStatus
    from planner.stream import Progress as StreamProgress


class RunProgress:
    """Use as a context; call it with every progress of the stream."""

    def __init__(self, duration_s: float, last_line: int) -> None:
        self._bar = bar(last_line) if sys.stderr.isatty() else None
        if self._bar is not None:
            self._task = self._bar.add_task("run", total=max(duration_s, 1e-9), line=0, left="", place="", state="")

    def __enter__(self) -> RunProgress:
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Take the bar off the screen while something else is said there."""
        if self._bar is None:
            yield
            return
        self._bar.stop()
        try:
            yield
        finally:
            self._bar.start()

    def __call__(self, progress: StreamProgress) -> None:
        """Show where the stream is."""
        if self._bar is None:
            return
        place = " ".join(f"{axis}{value:.2f}" for axis, value in progress.position.items())
        left = minutes(max(progress.duration_s - progress.time_s, 0.0))
        total = max(progress.duration_s, 1e-9)
        self._bar.update(self._task, total=total, completed=progress.time_s, line=progress.line, left=left, place=place)

    def say(self, words: str) -> None:
        """A line above the bar."""
        if self._bar is None:
            click.echo(words, err=True)
        else:
            self._bar.console.print(words, highlight=False)

    def warn(self, words: str) -> None:
        """A warning above the bar."""
        self.say(f"warning: {words}")

    def tell(self, words: str) -> None:
        """A note above the bar."""
        self.say(f"note: {words}")

    def show(self, status: RateStatus) -> None:
        """Show whether the machine is held, and overrides."""
        if self._bar is not None:
            self._bar.update(self._task, state=rate_words(status))


def bar(last_line: int) -> Progress:
    """An empty bar on stderr."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    return Progress(
        TextColumn("running"),
        BarColumn(),
        TextColumn("line {task.fields[line]} of " + str(last_line)),
        TextColumn("{task.fields[left]} left"),
        TextColumn("{task.fields[place]}"),
        TextColumn("{task.fields[state]}"),
        console=Console(stderr=True),
        transient=True,
    )


def rate_words(status: RateStatus) -> str:
    """What is not as programmed: ``HELD  feed 80 %``."""
    found = []
    if status.state == "holding":
        found.append(f"holding: rest in {status.rest_s:.2f} s, {status.rest_mm:.2f} mm")
    elif status.state == "held":
        found.append("HELD")
    if status.feed_percent != 100:
        found.append(f"feed {status.feed_percent:.0f} %")
    if status.rapid_percent != 100:
        found.append(f"rapids {status.rapid_percent:.0f} %")
    if status.bus_percent < 100:
        found.append(f"slowed to {status.bus_percent:.0f} % for host or bus")
    if status.refused:
        found.append(f"refused: {status.refused}")
    return "  ".join(found)


def minutes(seconds: float) -> str:
    """``75.2`` as ``1:15``."""
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"
