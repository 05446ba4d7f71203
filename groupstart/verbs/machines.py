"""``groupstart machines``: list, show and check machine files."""

from __future__ import annotations

import json

import click

from groupstart.exits import EXIT_REFUSED, VerbError


@click.group(name="machines", invoke_without_command=True)
@click.pass_context
def command(ctx: click.Context) -> None:
    """List the shipped machines, one a line; or show or check a machine file."""
    if ctx.invoked_subcommand is None:
        from machines.load import shipped_machines

        for name in shipped_machines():
            click.echo(name)


@command.command()
@click.argument("machine", metavar="NAME|PATH")
@click.option("--json", "as_json", is_flag=True, help="All values, defaults included, as JSON.")
def show(machine: str, as_json: bool) -> None:
    """Print a machine file: as it is written, or with all defaults as JSON."""
    from groupstart.inputs import open_machine

    file = open_machine(machine)
    if as_json:
        click.echo(json.dumps(file.config.model_dump(), indent=2))
    else:
        click.echo(file.text, nl=not file.text.endswith("\n"))


@command.command()
@click.argument("machine", nargs=-1, required=True, metavar="NAME|PATH ...")
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each mistake.")
def check(machine: tuple[str, ...], as_json: bool) -> None:
    """Check machine files; print every mistake with key and line, and warn of a bus too slow for its axes."""
    from machines.busload import possible_overload
    from machines.errors import MachineError, MachineMissingError
    from machines.load import read_machine

    bad = 0
    for name in machine:
        try:
            config = read_machine(name).config
        except MachineError as error:
            bad += 1
            for item in error.errors:
                click.echo(json.dumps(item.as_json()) if as_json else item.text())
        except MachineMissingError as error:
            bad += 1
            click.echo(str(error), err=True)
        else:
            axes = " ".join(f"{axis}:{table.chip}" for axis, table in config.axis.items())
            click.echo(f"{name}: good ({axes})", err=as_json)
            simulated = all(bus.port == "sim" for bus in config.bus.values())
            load = possible_overload(config, simulated)
            if load is not None:
                click.echo(f"{name}: warning: where all axes move at once, {load.words()}", err=True)
    if bad:
        raise VerbError(f"{bad} of {len(machine)} machine files refused", EXIT_REFUSED)
