"""``groupstart home``: axes to their machine zero."""

from __future__ import annotations

import json

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.inputs import open_machine
from groupstart.options import machine_option


@click.command(name="home")
@click.argument("axes", nargs=-1, metavar="[AXIS ...]")
@machine_option
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the simulated machine's chance.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each axis.")
def command(axes: tuple[str, ...], machine: str, port: str | None, seed: int | None, as_json: bool) -> None:
    """Home AXES in the order given; without any, all that have a [axis.X.home] table, Z first.

    Each axis seeks its switch, backs off, finds the edge again slowly and goes to machine zero, where its counter is
    set to zero. Ctrl-C stops every motor first.
    """
    from machines.session import Session, SessionError

    config = open_machine(machine).config
    able = [axis for axis in sorted(config.axis, key=lambda axis: axis != "Z") if config.axis[axis].home is not None]
    wanted = [axis.upper() for axis in axes] or able
    for axis in wanted:
        if axis not in able:
            raise VerbError(f"{config.machine.name}: no [axis.{axis}.home] in its file", EXIT_REFUSED)
    if not wanted:
        raise VerbError(f"{config.machine.name}: no axis has a home table", EXIT_REFUSED)
    with Session(config, port=port, seed=seed) as session:
        try:
            session.connect()
            for homed in session.home(wanted):
                if as_json:
                    record = {"axis": homed.axis, "edge_steps": homed.edge_steps, "spread_steps": homed.spread_steps}
                    click.echo(json.dumps(record))
                else:
                    words = f"switch repeats within {abs(homed.spread_steps)} steps"
                    click.echo(f"{homed.axis}: at machine zero, {words}")
        except SessionError as error:
            raise VerbError(str(error), EXIT_FAULT) from None
