"""``groupstart scan``: who is on the bus."""

from __future__ import annotations

import json

import click

from groupstart.exits import EXIT_FAULT, VerbError
from groupstart.inputs import open_machine
from groupstart.options import machine_option


@click.command(name="scan")
@machine_option
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
@click.option("--reset", is_flag=True, help="Put the whole network back to its power-up state first.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each bus.")
def command(machine: str, port: str | None, reset: bool, as_json: bool) -> None:
    """Say who is on each bus: address, type, version, status in words.

    A network that has addresses is read without being disturbed; one without is given them, as at start-up.
    """
    from machines.bringup import connect
    from machines.wiring import nmc_buses
    from nmc.errors import NmcError
    from nmc.scan import scan

    config = open_machine(machine).config
    try:
        connection = connect(config, port)
    except (NmcError, ValueError) as error:
        raise VerbError(str(error), EXIT_FAULT) from None
    try:
        for name, bus in zip(nmc_buses(config), connection.buses, strict=True):
            try:
                result = scan(bus, reset=reset)
            except NmcError as error:
                raise VerbError(f"bus {name}: {error}", EXIT_FAULT) from None
            if as_json:
                modules = [module.as_json() for module in result.modules]
                click.echo(json.dumps({"bus": name, "baud": result.baud, "modules": modules}))
                continue
            click.echo(f"bus {name}: {len(result.modules)} modules at {result.baud} baud")
            for module in result.modules:
                click.echo(module.text())
        for axis, chip in connection.indexers.items():
            name, register = config.axis[axis].bus, chip.find()
            if as_json:
                found = {"chip": "cy545", "axis": axis, "position": register}
                click.echo(json.dumps({"bus": name, "baud": chip.baud, "modules": [found]}))
            else:
                click.echo(f"bus {name}: a CY545 at {chip.baud} baud, axis {axis}, position register {register}")
    except NmcError as error:
        raise VerbError(str(error), EXIT_FAULT) from None
    finally:
        connection.close()
