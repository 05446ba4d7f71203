"""What can be wrong with a machine: the description (:class:`ConfigError`, :class:`MachineError`) or a run of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ConfigError:
    """One mistake of a machine file: dotted ``key``, 1-based ``line`` (None: unknown), what, and the cure."""

    file: str
    line: int | None
    key: str
    message: str
    hint: str = ""

    def text(self) -> str:
        """``FILE:LINE: key: message`` with the hint on a second line."""
        place = self.file if self.line is None else f"{self.file}:{self.line}"
        what = f"{self.key}: {self.message}" if self.key else self.message
        return f"{place}: error: {what}" + (f"\n    hint: {self.hint}" if self.hint else "")

    def as_json(self) -> dict[str, str | int | None]:
        """The fields by name."""
        return {"file": self.file, "line": self.line, "key": self.key, "message": self.message, "hint": self.hint}


class MachineError(Exception):
    """A machine file cannot be used; ``errors`` has all of its mistakes in the order of the file."""

    def __init__(self, errors: Sequence[ConfigError]) -> None:
        self.errors = tuple(errors)
        super().__init__("\n".join(error.text() for error in errors))


class MachineMissingError(Exception):
    """No machine of that name is shipped and no such file can be read."""
