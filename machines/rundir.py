"""The folder of a run: what was run, on what, what was planned, what came out, and a journal written as it happens.

Every line of the journal is flushed, so that after a crash or a power cut the folder tells how far the run came.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from io import TextIOWrapper
from pathlib import Path
from types import TracebackType
from typing import Any

_MAX_SAME_SECOND = 1000


class RunFolder:
    """One run's folder; use it as a context so that the journal is closed.

    Making it and ``write`` raise OSError, with the file's name, where the disk does. Once it is made, a journal that
    can be written no more stops no motion: what the disk refuses of it, and of what ``keep`` is around, is noted in
    ``troubles``.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.troubles: list[str] = []
        self._journal_ends = False
        self._journal: TextIOWrapper = (path / "journal.jsonl").open("x", encoding="utf-8")

    @classmethod
    def create(cls, parent: Path, job: str) -> RunFolder:
        """Make ``parent/<time>-<job>/``; a second run of the same second gets a number behind it."""
        parent.mkdir(parents=True, exist_ok=True)
        name = f"{_stamp(parent)}-{safe_name(job)}"
        for attempt in range(_MAX_SAME_SECOND):
            path = parent / (name if attempt == 0 else f"{name}-{attempt + 1}")
            try:
                path.mkdir()
            except FileExistsError:
                continue
            return cls(path)
        raise FileExistsError(17, "too many runs of the same second", str(parent / name))

    def write(self, name: str, text: str) -> Path:
        """Write a text file of the run, line ends as they are."""
        path = self.path / name
        try:
            path.write_text(text, encoding="utf-8", newline="")
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from None
        return path

    @contextmanager
    def keep(self, name: str) -> Iterator[Path]:
        """Around everything that writes the file of that name; where the disk refuses, that becomes a trouble."""
        try:
            yield self.path / name
        except OSError as error:
            self.troubles.append(f"{self.path / name}: {error.strerror or error}")

    def write_json(self, name: str, data: Mapping[str, Any]) -> Path:
        """Write a JSON file of the run."""
        return self.write(name, json.dumps(data, indent=2) + "\n")

    def note(self, event: str, time_ns: int, **fields: Any) -> None:
        """Add a line to the journal: what happened at which link time, with its particulars."""
        if self._journal_ends:
            return
        with self.keep("journal.jsonl"):
            self._journal_ends = True
            self._journal.write(json.dumps({"time_ns": time_ns, "event": event, **fields}) + "\n")
            self._journal.flush()
            self._journal_ends = False

    def close(self) -> None:
        """Close the journal."""
        try:
            self._journal.close()
        except OSError:
            if not self._journal_ends:  # else it has been told
                raise

    def __enter__(self) -> RunFolder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _stamp(parent: Path) -> str:
    """Local date and time, as the file system tells it: no other wall clock is read in this room."""
    os.utime(parent)
    return datetime.fromtimestamp(parent.stat().st_mtime).strftime("%Y%m%d-%H%M%S")


def safe_name(job: str) -> str:
    """A job's name as part of a folder's name: letters, digits, dot, dash, underscore."""
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(job).stem).strip("._")
    return stem[:60] or "job"
