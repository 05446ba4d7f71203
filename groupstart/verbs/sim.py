"""``groupstart sim``: the simulated machine on a pseudo-terminal, in real time, for any NMC client."""

from __future__ import annotations

import click

from groupstart.exits import EXIT_FAULT, VerbError
from groupstart.inputs import open_machine
from groupstart.options import machine_option


@click.command(name="sim")
@machine_option
@click.option("--pty", is_flag=True, required=True, help="Serve on a pseudo-terminal (the only way there is so far).")
@click.option("--unpaced", is_flag=True, help="Answer at once; motion still follows the clock.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the simulated machine's chance.")
def command(machine: str, pty: bool, unpaced: bool, seed: int | None) -> None:
    """Serve a simulated machine until Ctrl-C or SIGTERM.

    The first line on stdout is the path of the device that clients open; a machine with further buses, such as the
    line of a CY545, prints theirs on the lines after it. The rate that a client sets is the rate of
    its bytes on the wire. What went against the data sheets is told on stderr at the end.
    """
    from groupstart.stopflag import StopFlag
    from machines.virtual import serve_on_pty

    config = open_machine(machine).config
    with StopFlag() as stop:
        try:
            simulation = serve_on_pty(config, _announce, stop, seed=seed, unpaced=unpaced)
        except ValueError as error:
            raise VerbError(f"{config.machine.name}: {error}", EXIT_FAULT) from None
    for violation in simulation.violations:
        time_s = violation.time_ns * 1e-9
        click.echo(f"{time_s:.6f} s {violation.module}: {violation.rule}: {violation.consequence}", err=True)
    click.echo(f"{len(simulation.violations)} violations", err=True)


def _announce(device: str) -> None:
    click.echo(device)  # click flushes: whoever reads a pipe has it now
