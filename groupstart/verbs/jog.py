"""``groupstart jog``: a bounded relative move."""

from __future__ import annotations

import re

import click

from groupstart.byhand import move_by_hand
from groupstart.exits import EXIT_FAULT, VerbError
from groupstart.options import machine_option

_WORD = re.compile(r"([XYZABCUVW])([+-]?(?:\d+\.?\d*|\.\d+))", re.IGNORECASE)


@click.command(name="jog", context_settings={"ignore_unknown_options": True})
@click.argument("distances", nargs=-1, required=True, metavar="X+5 Y-2.5 ...")
@machine_option
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
@click.option("--velocity", type=click.FloatRange(min=0, min_open=True), help="mm/s; without it as fast as a rapid.")
def command(distances: tuple[str, ...], machine: str, port: str | None, velocity: float | None) -> None:
    """Move by DISTANCES (mm, degrees) from where the machine stands and print where it ends.

    A jog is a move with an end, planned as a program is: it cannot run away, and it cannot leave the travel.
    """
    words = []
    for distance in distances:
        match = _WORD.fullmatch(distance)
        if match is None:
            raise VerbError(f"{distance!r} is no jog; give an axis and a distance, such as X+5 or Z-0.1", EXIT_FAULT)
        words.append(f"{match.group(1).upper()}{match.group(2)}")
    if len({word[0] for word in words}) != len(words):
        raise VerbError("an axis is given twice", EXIT_FAULT)
    how = "G0" if velocity is None else f"G1 F{velocity * 60:.6f}"
    move_by_hand(f"G21 G91\n{how} {' '.join(words)}\nM2\n", "jog", machine, port)
