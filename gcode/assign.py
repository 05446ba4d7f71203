"""Parameter settings of a line: all are computed with the old values, then take effect before the line is executed."""

from __future__ import annotations

from gcode.block import Line
from gcode.errors import GcodeError
from gcode.expressions import evaluate, whole
from gcode.parameters import Parameters


def assign(parameters: Parameters, line: Line) -> None:
    """Executes the assignments of ``line``. Raises GC014, GC030, GC031 and what their values raise."""
    settings: list[tuple[str | int, float]] = []
    for assignment in line.assignments:
        try:
            target: str | int
            if assignment.name is None:
                target = whole(evaluate(assignment.index, parameters), "a parameter number")
                parameters.check_writable(target)
            else:
                target = assignment.name
            settings.append((target, evaluate(assignment.value, parameters)))
        except GcodeError as error:
            raise error.placed(assignment.span) from None
    for (target, value), assignment in zip(settings, line.assignments, strict=True):
        if isinstance(target, int):
            parameters.set_numbered(target, value)
            continue
        try:
            parameters.set_named(target, value)
        except GcodeError as error:
            raise error.placed(assignment.span) from None
