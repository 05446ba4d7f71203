"""``groupstart reset``: every module back to its power-up state."""

from __future__ import annotations

import click

from groupstart.exits import EXIT_FAULT, VerbError
from groupstart.inputs import open_machine
from groupstart.options import machine_option


@click.command(name="reset")
@machine_option
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
def command(machine: str, port: str | None) -> None:
    """Hard Reset of every bus, at whatever rate and with whatever addresses an earlier session has left it.

    Motors stop, amplifiers go off, positions are lost.
    """
    from machines.bringup import connect
    from machines.wiring import nmc_buses
    from nmc.errors import NmcError
    from nmc.setup import reset_network

    config = open_machine(machine).config
    try:
        connection = connect(config, port)
    except (NmcError, ValueError) as error:
        raise VerbError(str(error), EXIT_FAULT) from None
    try:
        for name, bus in zip(nmc_buses(config), connection.buses, strict=True):
            reset_network(bus)
            click.echo(f"bus {name}: reset", err=True)
        for axis, chip in connection.indexers.items():
            chip.start_up()
            click.echo(f"axis {axis}: CY545 reset", err=True)
    except NmcError as error:
        raise VerbError(str(error), EXIT_FAULT) from None
    finally:
        connection.close()
