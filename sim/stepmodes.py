"""PIC-STEP data sheet, Table 4: which mode may be entered from which and with which data; the mode a load asks for.

V the parameter must be loaded, o it may be, X it must not be. A pair that is missing is 'Not Allowed'.
"""

from __future__ import annotations

from enum import IntEnum


class Mode(IntEnum):
    """Operating modes, the columns of Table 4."""

    STOPPED = 0
    TRAP = 1
    VELOCITY = 2
    UNPROFILED_STOP = 3
    UNPROFILED = 4


POSITION, SPEED, ACCELERATION, COUNT = 1, 2, 4, 8  # control byte bits 0..3
_NAMES = ("position", "velocity", "acceleration", "timer count")

# (goal, start): position, velocity, acceleration, timer count
TABLE_4: dict[tuple[Mode, Mode], str] = {
    (Mode.TRAP, Mode.STOPPED): "VooX",
    (Mode.VELOCITY, Mode.STOPPED): "XooX",
    (Mode.VELOCITY, Mode.TRAP): "XooV",
    (Mode.VELOCITY, Mode.VELOCITY): "XooX",
    (Mode.VELOCITY, Mode.UNPROFILED_STOP): "XooX",
    (Mode.VELOCITY, Mode.UNPROFILED): "XooX",
    (Mode.UNPROFILED_STOP, Mode.STOPPED): "VXXV",
    (Mode.UNPROFILED_STOP, Mode.TRAP): "XXXV",
    (Mode.UNPROFILED_STOP, Mode.UNPROFILED_STOP): "XXXV",
    (Mode.UNPROFILED, Mode.STOPPED): "XXXV",
    (Mode.UNPROFILED, Mode.VELOCITY): "XXXV",
    (Mode.UNPROFILED, Mode.UNPROFILED): "XXXV",
}
# item of the conformance list for each cell: rows ST-171.. (trapezoid), ST-176.., ST-181.., ST-186.., five columns each
_CELL_ITEM: dict[tuple[Mode, Mode], str] = {
    (goal, start): f"ST-{171 + 5 * (goal - Mode.TRAP) + start}" for goal in list(Mode)[1:] for start in Mode
}


def _goal_of(start: Mode, loaded: int) -> Mode:
    if loaded & COUNT:
        if loaded & POSITION:
            return Mode.UNPROFILED_STOP
        return Mode.UNPROFILED_STOP if start in (Mode.TRAP, Mode.UNPROFILED_STOP) else Mode.UNPROFILED
    return Mode.TRAP if loaded & POSITION else Mode.VELOCITY


def _refusal(start: Mode, loaded: int) -> tuple[str, str] | None:
    goal = _goal_of(start, loaded)
    rule = _CELL_ITEM[goal, start]
    cell = TABLE_4.get((goal, start))
    what = f"{goal.name} from {start.name}"
    if cell is None:
        return rule, f"Table 4: {what} is not allowed"
    for bit, sign, name in zip((1, 2, 4, 8), cell, _NAMES, strict=True):
        if sign == "X" and loaded & bit:
            return rule, f"Table 4: {what} must not load {name}"
        if sign == "V" and not loaded & bit:
            # this cell prints a count, and loading a count is what selects an unprofiled mode
            doubtful = (goal, start) == (Mode.VELOCITY, Mode.TRAP)
            return "X-20" if doubtful else rule, f"Table 4: {what} must load {name}"
    return None


_LOADS = [(start, loaded) for start in Mode for loaded in range(16)]
_GOALS = {key: _goal_of(*key) for key in _LOADS}
_REFUSALS = {key: _refusal(*key) for key in _LOADS}


def goal_of(start: Mode, loaded: int) -> Mode:
    """The mode that a load asks for: it is chosen by which data are loaded (section 5.1)."""
    return _GOALS[start, loaded]


def refusal(start: Mode, loaded: int) -> tuple[str, str] | None:
    """Why Table 4 forbids executing a load in mode ``start``: (rule, reason); None if it is allowed."""
    return _REFUSALS[start, loaded]
