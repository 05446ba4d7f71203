"""``groupstart probe-latch``: what a PIC-STEP does where its data sheet is silent, measured."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import click

from groupstart.commissioning import ask_consent, date_of, own_file, told_in_words, write_machine
from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.inputs import open_machine
from groupstart.options import machine_option

if TYPE_CHECKING:
    from machines.load import MachineFile
    from machines.probing import Probed
    from machines.schema import MachineConfig
    from machines.silences import Answer


@click.command(name="probe-latch")
@click.argument("motors", nargs=-1, metavar="[AXIS ...]")
@machine_option
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the simulated machine's chance.")
@click.option("--amplifier-off", is_flag=True, help="Also try motion with the amplifier off: the motor holds nothing.")
@click.option("--reset", is_flag=True, help="First reset the bus and try motion before Set Parameters.")
@click.option("--yes", is_flag=True, help="Do not ask before the machine moves.")
@click.option("--no-write", is_flag=True, help="Only print what was found.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each motor.")
def command(
    motors: tuple[str, ...],
    machine: str,
    port: str | None,
    seed: int | None,
    amplifier_off: bool,
    reset: bool,
    yes: bool,
    no_write: bool,
    as_json: bool,
) -> None:
    """Measure when a new timer count takes effect and when the first step comes (AXIS: all PIC-STEP motors).

    Each motor makes some ninety runs of two to six steps, there and back, slower than a hundred steps a second, and
    ends where it began. What is found is written into the machine file; where it is not decided nothing is written
    (exit status 1).
    """
    from groupstart.stopflag import StopFlag
    from machines.commission import at_work
    from machines.latchprobe import TRIALS
    from machines.probing import probe_motor

    described = open_machine(machine)
    config = described.config
    wanted = _wanted(config, motors)
    ask_consent(config, port, yes, _warning(config, wanted, amplifier_off, reset))
    first = _before_parameters(config, wanted, port, seed) if reset else {}
    found: list[Probed] = []
    with told_in_words(), StopFlag() as stop, at_work(config, port, seed) as connection:
        place = connection.place
        for motor in wanted:
            with click.progressbar(length=TRIALS, label=f"motor {motor}", file=sys.stderr) as bar:
                one = probe_motor(
                    connection,
                    motor,
                    amplifier_off=amplifier_off,
                    stop_requested=stop,
                    progress=partial(bar.update, 1),
                )
            one = replace(one, answers=(*one.answers, *first.get(motor, ())))
            found.append(one)
            _print(one, as_json)
    if not no_write:
        _write(described, machine, found, place)
    undecided = [one.motor for one in found if not one.latch.decided]
    if undecided:
        raise VerbError(f"not decided for {', '.join(undecided)}: nothing is written about them", EXIT_REFUSED)


def _wanted(config: MachineConfig, named: tuple[str, ...]) -> list[str]:
    """The motors to probe: those named, or all on PIC-STEPs."""
    from machines.wiring import motor_tables

    able = list(motor_tables(config))
    for motor in named:
        if motor not in able:
            words = f"PIC-STEP motors: {', '.join(able)}" if able else "it has no PIC-STEP"
            raise VerbError(f"{config.machine.name}: {motor} is no motor on a PIC-STEP; {words}", EXIT_REFUSED)
    if not able:
        raise VerbError(f"{config.machine.name}: no motor is on a PIC-STEP", EXIT_REFUSED)
    return list(dict.fromkeys(named)) or able


def _before_parameters(
    config: MachineConfig, motors: list[str], port: str | None, seed: int | None
) -> dict[str, list[Answer]]:
    """Of each motor what it does before Set Parameters; the bus is left reset."""
    from machines.bringup import bus_of, connect
    from machines.silences import before_parameters
    from machines.wiring import motor_tables
    from nmc.errors import NmcError

    try:
        connection = connect(config, port, seed)
    except (NmcError, ValueError) as error:
        raise VerbError(str(error), EXIT_FAULT) from None
    try:
        found = {}
        for motor in motors:
            table = motor_tables(config)[motor][1]
            bus = bus_of(connection, table.bus)
            found[motor] = [before_parameters(config, bus, table.bus, table.address)]
        return found
    except NmcError as error:
        raise VerbError(str(error), EXIT_FAULT) from None
    finally:
        connection.close()


def _warning(config: MachineConfig, motors: list[str], amplifier_off: bool, reset: bool) -> list[str]:
    from machines.probing import reach

    lines = ["These motors will move, one after another, slowly, and end where they began:"]
    for motor in motors:
        steps, length = reach(config, motor)
        lines.append(f"  {motor}: at most {steps} steps ({length:.3g} mm or degrees) either way")
    if amplifier_off:
        lines.append("With --amplifier-off each motor lets its axis go for a second: a hanging axis falls.")
    if reset:
        lines.append("With --reset all amplifiers of the bus go off first, and where the axes stand is forgotten.")
    return lines


def _print(probed: Probed, as_json: bool) -> None:
    from machines.probing import as_record, evidence_lines

    click.echo(json.dumps(as_record(probed)) if as_json else "\n".join(evidence_lines(probed)))


def _write(described: MachineFile, machine: str, found: list[Probed], place: str) -> None:
    """Into the user's own machine file; of a shipped one only say what would be written."""
    from machines.probing import with_probed

    decided = [one for one in found if one.latch.decided]
    path = own_file(machine)
    if not decided or path is None:
        if decided:
            click.echo(f"{machine} is a shipped machine: copy it to a file of your own to keep this", err=True)
        return
    text, date = described.text, date_of(path)
    try:
        for one in decided:
            text = with_probed(text, described.config, one, place, date)
    except ValueError as error:
        raise VerbError(f"{path}: {error}; nothing is written", EXIT_REFUSED) from None
    write_machine(described, path, text)
