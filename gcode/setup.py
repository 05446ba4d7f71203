"""What the interpreter is told before it reads: tools, parameters, offsets, start position and dialect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

from gcode.canon import AXES, ORIGIN, Position

if TYPE_CHECKING:
    from configparser import ConfigParser


@dataclass(frozen=True, slots=True)
class Tool:
    """One tool. ``offset``, ``diameter``: machine units; angles: degrees; ``orientation``: 0 to 9 of a lathe tool."""

    number: int
    pocket: int = 0
    offset: Position = ORIGIN
    diameter: float = 0.0
    front_angle: float = 0.0
    back_angle: float = 0.0
    orientation: int = 0
    comment: str = ""


def _no_parameters() -> Mapping[int, float]:
    return MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Setup:
    """The state before the first line.

    tools: by number; None accepts any tool as one without length and diameter. parameters: numbered parameters as a
    parameter file gives them, in machine units. work_offset: the offset of G54 in mm and degrees (over parameters).
    start: where the machine stands, absolute mm and degrees. machine_units: of tools and parameters.
    axes: the axes that the machine has. block_delete: the switches that are on (1 is ``/``).
    file: the name in diagnostics. include: folders of subprogram files. ini: what ``#<_ini[section]name>`` reads.
    user_commands: the M100 to M199 that the machine has; None where no machine is known (then any is taken).
    trim_concave: a path under cutter compensation is trimmed where the tool does not fit, instead of refused.
    max_errors: a check ends after so many. max_steps: a program with loops ends after so many lines of compiled loops,
    or a 20th of it of other lines.
    """

    tools: Mapping[int, Tool] | None = None
    parameters: Mapping[int, float] = field(default_factory=_no_parameters)
    work_offset: Position | None = None
    start: Position = ORIGIN
    dialect: str = "linuxcnc"
    machine_units: Literal["mm", "inch"] = "mm"
    axes: str = AXES
    block_delete: frozenset[int] = frozenset()
    file: str = "<program>"
    include: tuple[str, ...] = ()
    user_commands: frozenset[int] | None = None
    trim_concave: bool = False
    max_errors: int = 100
    max_steps: int = 40_000_000
    ini: ConfigParser | None = None
