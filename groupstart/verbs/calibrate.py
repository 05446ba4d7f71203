"""``groupstart calibrate``: how far each module's crystal is off, measured and remembered."""

from __future__ import annotations

import json
import sys
from functools import partial
from typing import TYPE_CHECKING

import click

from groupstart.commissioning import ask_consent, date_of, own_file, told_in_words, write_machine
from groupstart.exits import EXIT_REFUSED, VerbError
from groupstart.inputs import open_machine
from groupstart.options import machine_option

if TYPE_CHECKING:
    from machines.calibration import Crystal
    from machines.load import MachineFile
    from machines.schema import MachineConfig


@click.command(name="calibrate")
@click.argument("motors", nargs=-1, metavar="[AXIS ...]")
@machine_option
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the simulated machine's chance.")
@click.option("--seconds", type=click.FloatRange(4, 300), default=10, show_default=True, help="Length of a run.")
@click.option("--yes", is_flag=True, help="Do not ask before the machine moves.")
@click.option("--no-write", is_flag=True, help="Only print what was found.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object for each motor.")
def command(
    motors: tuple[str, ...],
    machine: str,
    port: str | None,
    seed: int | None,
    seconds: float,
    yes: bool,
    no_write: bool,
    as_json: bool,
) -> None:
    """Measure the crystals of the modules against the clock of this computer (AXIS: all motors).

    A stepper runs slowly towards the side of its travel that has more room, and back, --seconds each way; a servo
    stands and is only asked. The result is certain within the bounds that it gives; it is written into the machine
    file, and streams then allow for that instead of 100 ppm. Longer runs give narrower bounds.
    """
    from groupstart.stopflag import StopFlag
    from machines.calibrating import calibrate_motor
    from machines.commission import UndecidedError, at_work

    described = open_machine(machine)
    config = described.config
    wanted = _wanted(config, motors)
    ask_consent(config, port, yes, _warning(config, wanted, seconds))
    found: list[tuple[str, Crystal]] = []
    undecided: list[str] = []
    with told_in_words(), StopFlag() as stop, at_work(config, port, seed) as connection:
        for motor in wanted:
            with click.progressbar(length=2, label=f"motor {motor}", file=sys.stderr) as bar:
                try:
                    crystal = calibrate_motor(
                        connection, motor, seconds=seconds, stop_requested=stop, progress=partial(bar.update, 1)
                    )
                except UndecidedError as error:
                    undecided.append(f"{motor}: {error}")
                    continue
            found.append((motor, crystal))
            _print(motor, crystal, as_json)
        place = connection.place
    if found and not no_write:
        _write(described, machine, found, place)
    if undecided:
        raise VerbError("\n".join(["not decided:", *undecided]), EXIT_REFUSED)


def _wanted(config: MachineConfig, named: tuple[str, ...]) -> list[str]:
    """The motors to measure: those named, or all on NMC chips."""
    from machines.wiring import motors

    able = [motor.name for motor in motors(config)]
    for motor in named:
        if motor not in able:
            raise VerbError(f"{config.machine.name}: no motor {motor}; motors: {', '.join(able)}", EXIT_REFUSED)
    if not able:
        raise VerbError(f"{config.machine.name}: no motor is on an NMC bus", EXIT_REFUSED)
    return list(dict.fromkeys(named)) or able


def _warning(config: MachineConfig, motors: list[str], seconds: float) -> list[str]:
    from machines.calibrating import RATE_HZ
    from machines.wiring import motor_tables

    steppers = motor_tables(config)
    lines = ["Servos stand. These motors will run, one after another, and back:"] if steppers else ["Nothing moves."]
    for motor in motors:
        if motor in steppers:
            axis, table = steppers[motor]
            travel = config.axis[axis].travel
            length = min(RATE_HZ * seconds / abs(table.steps_per_unit), travel[1] - travel[0])
            lines.append(f"  {motor}: at most {length:.3g} mm or degrees in {seconds:g} s")
    return lines


def _print(motor: str, crystal: Crystal, as_json: bool) -> None:
    if as_json:
        record = {"motor": motor, "ppm": round(crystal.ppm, 3), "within_ppm": round(crystal.within_ppm, 3)}
        click.echo(json.dumps(record | {"events": crystal.events}))
        return
    click.echo(
        f"motor {motor}: its crystal runs {crystal.ppm:+.1f} ppm fast, certainly within {crystal.within_ppm:.1f} "
        f"({crystal.events} events)"
    )


def _write(described: MachineFile, machine: str, found: list[tuple[str, Crystal]], place: str) -> None:
    from machines.calibrating import with_crystals

    path = own_file(machine)
    if path is None:
        click.echo(f"{machine} is a shipped machine: copy it to a file of your own to keep this", err=True)
        return
    try:
        text = with_crystals(described.text, described.config, found, place, date_of(path))
    except ValueError as error:
        raise VerbError(f"{path}: {error}; nothing is written", EXIT_REFUSED) from None
    write_machine(described, path, text)
