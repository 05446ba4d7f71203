"""What the planner refuses, always with the line of the program."""

from __future__ import annotations


class PlanError(Exception):
    """A program that cannot be planned on this machine.

    line: 1-based source line, 0 if none. axis: its name or "". hint: what would help, or "".
    """

    def __init__(self, line: int, axis: str, message: str, hint: str = "") -> None:
        self.line = line
        self.axis = axis
        self.message = message
        self.hint = hint
        where = f"line {line}: " if line else ""
        super().__init__(f"{where}{message}" + (f" ({hint})" if hint else ""))
