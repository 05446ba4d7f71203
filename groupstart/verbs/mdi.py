"""``groupstart mdi``: one line of G-code, now."""

from __future__ import annotations

import click

from groupstart.byhand import move_by_hand
from groupstart.options import machine_option


@click.command(name="mdi")
@click.argument("line", nargs=-1, required=True, metavar="G-CODE")
@machine_option
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
def command(line: tuple[str, ...], machine: str, port: str | None) -> None:
    """Run G-CODE from where the machine stands, in mm and absolute unless it says otherwise; print where it ends.

    Checked and planned as a program is, so it cannot leave the travel. Ctrl-C stops every motor first.
    """
    move_by_hand("G21 G90\n" + " ".join(line) + "\nM2\n", "mdi", machine, port)
