"""Table 4 of the PIC-STEP data sheet as data: which mode may be entered from which, and what must be loaded for it.

Section 5.1, "Operating Mode Transition Table", 25 cells. One cell is a likely misprint: Velocity Profile from
Trapezoidal Profile prints "timer count must be loaded", although loading a count is what selects an unprofiled mode.
It stands here as printed; the driver never uses it and a strict simulator refuses it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from types import MappingProxyType

from nmc.chips.picstep import LOAD_ACCELERATION, LOAD_COUNT, LOAD_POSITION, LOAD_SPEED

PARAMETERS = LOAD_POSITION | LOAD_SPEED | LOAD_ACCELERATION | LOAD_COUNT
"""The four control bits of Load Trajectory that announce data."""


class Mode(IntEnum):
    """Operating modes of a PIC-STEP."""

    STOPPED = 0
    TRAPEZOID = 1
    VELOCITY = 2
    UNPROFILED_STOP = 3
    UNPROFILED = 4


@dataclass(frozen=True, slots=True)
class Cell:
    """What one cell of the table prints, as masks of Load Trajectory control bits.

    must: data that has to be loaded. may: data that may be loaded. Everything else must not be.
    """

    must: int
    may: int = 0

    def admits(self, loaded: int) -> bool:
        """Whether a load with these control bits fits the cell."""
        return loaded & self.must == self.must and not loaded & PARAMETERS & ~(self.must | self.may)


@dataclass(frozen=True, slots=True)
class Refusal:
    """A cell without a load: "Use Stop Command", "Not Allowed" or, for Stopped from Stopped, a dash."""

    words: str


_STOP = Refusal("use Stop Motor")
_NEVER = Refusal("not allowed")
_RAMP = Cell(must=0, may=LOAD_SPEED | LOAD_ACCELERATION)
_COUNT = Cell(must=LOAD_COUNT)
_S, _T, _V, _U, _N = Mode

TABLE_4: Mapping[tuple[Mode, Mode], Cell | Refusal] = MappingProxyType(
    {
        (_S, _S): Refusal("already stopped"),
        (_S, _T): _STOP,
        (_S, _V): _STOP,
        (_S, _U): _STOP,
        (_S, _N): _STOP,
        (_T, _S): Cell(must=LOAD_POSITION, may=LOAD_SPEED | LOAD_ACCELERATION),
        (_T, _T): _NEVER,
        (_T, _V): _NEVER,
        (_T, _U): _NEVER,
        (_T, _N): _NEVER,
        (_V, _S): _RAMP,
        (_V, _T): Cell(must=LOAD_COUNT, may=LOAD_SPEED | LOAD_ACCELERATION),
        (_V, _V): _RAMP,
        (_V, _U): _RAMP,
        (_V, _N): _RAMP,
        (_U, _S): Cell(must=LOAD_POSITION | LOAD_COUNT),
        (_U, _T): _COUNT,
        (_U, _V): _NEVER,
        (_U, _U): _COUNT,
        (_U, _N): _NEVER,
        (_N, _S): _COUNT,
        (_N, _T): _NEVER,
        (_N, _V): _COUNT,
        (_N, _U): _NEVER,
        (_N, _N): _COUNT,
    }
)
"""(goal mode, starting mode) -> what the cell says."""


def goal_of(start: Mode, control: int) -> Mode | None:
    """Mode that a load with this control byte enters from ``start``, or None where Table 4 allows none.

    The misprinted cell is left out, so a count alone in a trapezoid means unprofiled with the trapezoid's stop.
    """
    for goal in Mode:
        cell = TABLE_4[goal, start]
        if (goal, start) != (Mode.VELOCITY, Mode.TRAPEZOID) and isinstance(cell, Cell) and cell.admits(control):
            return goal
    return None
