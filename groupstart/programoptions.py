"""The options by which a verb is told how to read a program, gathered into one value."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import click

from groupstart.options import Offset

if TYPE_CHECKING:
    from gcode.canon import Position

DIALECTS = ("linuxcnc", "grbl", "fanuc", "mach", "auto")


@dataclass(frozen=True, slots=True)
class ProgramChoices:
    """How a program is read. Paths are as given; nothing has been opened yet."""

    work_offset: Position | None = None
    dialect: str = "linuxcnc"
    machine_units: Literal["mm", "inch"] = "mm"
    tool_table: str | None = None
    parameters: str | None = None
    include: tuple[str, ...] = ()
    ini: str | None = None
    trim_concave: bool = False


_OPTIONS = (
    click.option("--work-offset", type=Offset(), help="The program's zero (G54) in machine mm: X,Y,Z."),
    click.option(
        "--dialect",
        type=click.Choice(DIALECTS),
        default="linuxcnc",
        show_default=True,
        help="How the program is read; auto guesses and says so.",
    ),
    click.option("--tool-table", type=click.Path(), help="Tool table in LinuxCNC's format; none: any tool is good."),
    click.option("--parameters", type=click.Path(), help="Parameter file in LinuxCNC's format."),
    click.option("--include", multiple=True, type=click.Path(), help="Folder of subprogram files; may be repeated."),
    click.option("--ini", type=click.Path(), help="LinuxCNC ini: parameter file, subroutine path, #<_ini[...]>."),
    click.option(
        "--trim-concave",
        is_flag=True,
        help="Cutter compensation: trim the path where the tool does not fit, instead of refusing it.",
    ),
    click.option(
        "--machine-units",
        type=click.Choice(["mm", "inch"]),
        default="mm",
        show_default=True,
        help="Units of tool table and parameters.",
    ),
)


def program_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options to a verb, which is given them as one argument ``choices``."""

    @functools.wraps(function)
    def call(**options: Any) -> Any:
        names = ProgramChoices.__dataclass_fields__
        chosen = {name: options.pop(name) for name in names}
        return function(choices=ProgramChoices(**chosen), **options)

    wrapped: Callable[..., Any] = call
    for option in reversed(_OPTIONS):
        wrapped = option(wrapped)
    return wrapped
