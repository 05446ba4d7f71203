"""Canonical commands: the one output of the interpreter, and all that the planner knows of a program.

Every position is absolute, in the machine frame, in mm (linear axes) and degrees (rotary axes), as a tuple of nine
floats in the order of ``AXES``. All offsets, units, rotation and modes are already applied; inches and per-minute
feeds exist only inside the interpreter. Every command carries its 1-based physical source line.

Source: NIST RS274/NGC version 3, section 4 (canonical machining functions), in LinuxCNC's extension of it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from gcode.records import dataclass

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

AXES = "XYZABCUVW"
"""Order of the coordinates in every ``Position``."""

Position = tuple[float, float, float, float, float, float, float, float, float]
Plane = Literal["XY", "ZX", "YZ"]
"""G17, G18, G19, named by their first and second axis in the right-handed order of the standard."""

ORIGIN: Position = (0.0,) * 9


@dataclass(frozen=True, slots=True)
class Command:
    """Base of all canonical commands. ``line``: physical source line, 1-based."""

    line: int


@dataclass(frozen=True, slots=True)
class Rapid(Command):
    """G0: straight move to ``end`` as fast as the axes allow."""

    end: Position


@dataclass(frozen=True, slots=True)
class Feed(Command):
    """G1: straight move to ``end`` at ``feed_mm_s`` along XYZ (UVW if XYZ rest; deg/s if only rotary axes move)."""

    end: Position
    feed_mm_s: float


@dataclass(frozen=True, slots=True)
class Arc(Command):
    """G2/G3: arc or helix to ``end`` about ``center`` (first and second axis of ``plane``, mm).

    ``turns``: +n counter-clockwise, -n clockwise, seen from the positive end of the third axis; |turns| = 1 is an arc
    of at most one full circle (exactly one if start and end agree in the plane), each further unit one circle more.
    The other axes move in proportion to the angle.
    """

    end: Position
    center: tuple[float, float]
    plane: Plane
    turns: int
    feed_mm_s: float


@dataclass(frozen=True, slots=True)
class TiltedArc(Command):
    """G2/G3 in G18 or G19 under a rotation of XY: its plane is no plane of the machine.

    ``center``: a point of the plane, absolute machine mm. ``plane``: the programmed one, turned by ``rotation_deg``
    about Z. Else as ``Arc``.
    """

    end: Position
    center: Position
    plane: Plane
    rotation_deg: float
    turns: int
    feed_mm_s: float


@dataclass(frozen=True, slots=True)
class Nurbs(Command):
    """G5, G5.1, G5.2: a rational B-spline in the XY plane (other axes stand).

    ``points``: (x, y, weight) control points in machine mm; ``order`` = degree + 1; clamped uniform knots as in
    RS274/NGC of LinuxCNC.
    """

    end: Position
    points: tuple[tuple[float, float, float], ...]
    order: int
    feed_mm_s: float


@dataclass(frozen=True, slots=True)
class Probe(Command):
    """G38.2-.5: straight probe towards ``end``. ``away``: stop on loss of contact; ``required``: fault if none."""

    end: Position
    feed_mm_s: float
    away: bool
    required: bool


@dataclass(frozen=True, slots=True)
class RigidTap(Command):
    """G33.1: synchronised tap down to ``end`` and back. ``pitch_mm`` per revolution."""

    end: Position
    pitch_mm: float


@dataclass(frozen=True, slots=True)
class SpindleSynch(Command):
    """G33, G33.1, G76: the feed moves that follow advance ``pitch_mm`` a revolution of the spindle; None ends it."""

    pitch_mm: float | None


@dataclass(frozen=True, slots=True)
class Dwell(Command):
    """G4: rest for ``seconds``."""

    seconds: float


@dataclass(frozen=True, slots=True)
class PathControl(Command):
    """G61, G61.1, G64. ``tolerance_mm`` of G64 P (None: machine default); ``merge_mm`` of G64 Q (None: as P)."""

    mode: Literal["exact_path", "exact_stop", "continuous"]
    tolerance_mm: float | None = None
    merge_mm: float | None = None


@dataclass(frozen=True, slots=True)
class Spindle(Command):
    """M3, M4, M5, S, M19. ``direction``: +1 clockwise, -1 counter-clockwise, 0 stopped.

    ``surface_mm_s``: under G96 the surface speed that S asks for, 0 under G97; ``limit_rpm``: D of G96;
    ``axis_x_mm``: machine X at which the radius is zero.
    """

    direction: Literal[-1, 0, 1]
    speed_rpm: float
    spelled: str = ""
    """The canonical function as it is printed (several lines: one each); "" prints what the fields say."""
    surface_mm_s: float = 0.0
    limit_rpm: float = math.inf
    axis_x_mm: float = 0.0


@dataclass(frozen=True, slots=True)
class Coolant(Command):
    """M7, M8, M9: state after the command."""

    mist: bool
    flood: bool
    spelled: str = ""
    """The canonical function as it is printed (several lines: one each); "" prints what the fields say."""


@dataclass(frozen=True, slots=True)
class ToolChange(Command):
    """M6: the machine waits until ``tool`` is in the spindle."""

    tool: int


@dataclass(frozen=True, slots=True)
class Stop(Command):
    """M0, M1, M60: rest until resumed. ``optional`` for M1."""

    optional: bool


@dataclass(frozen=True, slots=True)
class End(Command):
    """M2, M30 or the closing percent sign: the program is over. ``spelled`` is "" where no function is printed."""

    spelled: str = "PROGRAM_END()"


@dataclass(frozen=True, slots=True)
class Output(Command):
    """M62-M65, M67, M68: digital or analog output. ``synchronised`` with motion (M62, M63, M67) or at once."""

    index: int
    value: float
    analog: bool
    synchronised: bool


@dataclass(frozen=True, slots=True)
class InputWait(Command):
    """M66: the machine rests, waits for an input (``mode``: L of M66) at most ``timeout_s``, and tells its value.

    It has no canonical function: nothing is printed for it.
    """

    index: int
    analog: bool
    mode: int
    timeout_s: float


@dataclass(frozen=True, slots=True)
class UserCommand(Command):
    """M100 to M199: what the machine's owner has given the code ``number``. The machine waits until it is done.

    p, q: the P and Q words of the line, None where there is none.
    """

    number: int
    p: float | None = None
    q: float | None = None


@dataclass(frozen=True, slots=True)
class Message(Command):
    """(MSG, ...) and friends: shown to the operator when the program reaches it."""

    text: str


@dataclass(frozen=True, slots=True)
class Text(Command):
    """A canonical function that moves nothing (SET_G5X_OFFSET, COMMENT, ...): kept for the golden text, not planned.

    ``function`` with its arguments, spelled as LinuxCNC's stand-alone interpreter prints it.
    """

    function: str


@dataclass(frozen=True, slots=True)
class Printed(Text):
    """(PRINT, ...): a line for the terminal; ``function`` is the text itself."""


KIND_RAPID, KIND_FEED, KIND_ARC = 0, 1, 2
PLANES: tuple[Plane, ...] = ("XY", "ZX", "YZ")


@dataclass(frozen=True, slots=True, eq=False)
class MoveBlock:
    """N plain moves (rapid, feed, arc) in columns: what long files become.

    kind: u1[N] of ``KIND_*``; line: i4[N]; end: f8[N, len(axes)], machine mm and degrees, the other axes stand;
    feed_mm_s: f8[N]; plane: u1[N], index into ``PLANES``; center: f8[N, 2] and turns: i4[N], of arcs.
    notes: texts that move nothing, each with the row before which it stands (N: behind the last).
    """

    axes: str
    kind: npt.NDArray[np.uint8]
    line: npt.NDArray[np.int32]
    end: npt.NDArray[np.float64]
    feed_mm_s: npt.NDArray[np.float64]
    plane: npt.NDArray[np.uint8]
    center: npt.NDArray[np.float64]
    turns: npt.NDArray[np.int32]
    notes: tuple[tuple[int, Text], ...] = ()

    def __len__(self) -> int:
        return len(self.kind)
