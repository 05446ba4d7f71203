"""``groupstart tune``: gains of a PIC-SERVO axis by the procedure of its data sheet."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from groupstart.commissioning import ask_consent, own_file, told_in_words, write_machine
from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.files import writing
from groupstart.inputs import open_machine
from groupstart.options import machine_option

if TYPE_CHECKING:
    from machines.schema import MachineConfig
    from machines.servobench import Response
    from machines.tuning import Attempt, Tuned

TABLE_MS = (0, 1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 20, 30, 50, 100, 200)


@click.command(name="tune")
@click.argument("motor", metavar="AXIS")
@machine_option
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the simulated machine's chance.")
@click.option("--step", "step_counts", type=click.IntRange(8, 1000), default=40, show_default=True, metavar="COUNTS")
@click.option("--room", "room_counts", type=click.IntRange(min=50), default=400, show_default=True, metavar="COUNTS")
@click.option("--yes", is_flag=True, help="Do not ask before the machine moves.")
@click.option("--write", is_flag=True, help="Write the gains into the machine file.")
@click.option("--runs", type=click.Path(), default="runs", show_default=True, help="Folder of the folder it leaves.")
@click.option("--picture", type=click.Choice(["png", "svg"]), default="png", show_default=True, help="Its format.")
@click.option("--json", "as_json", is_flag=True, help="Gains and figures as JSON.")
def command(
    motor: str,
    machine: str,
    port: str | None,
    seed: int | None,
    step_counts: int,
    room_counts: int,
    yes: bool,
    write: bool,
    runs: str,
    picture: str,
    as_json: bool,
) -> None:
    """Find the gains of AXIS: Kd until it hums, Kp until a step overshoots, Ki until nothing is left, the least IL.

    Test steps of --step counts, within --room counts of where the axis stands; the output and current limits of the
    machine file hold. A folder keeps the search, the step responses and a picture. The axis ends where it began, with
    the gains of its file.
    """
    from groupstart.steppicture import draw_steps
    from groupstart.stopflag import StopFlag
    from machines.commission import at_work
    from machines.rundir import RunFolder
    from machines.tuning_axis import tune_motor, with_gains

    described = open_machine(machine)
    config = described.config
    _check(config, motor, step_counts, room_counts)
    path = own_file(machine)
    if write and path is None:
        raise VerbError(f"{machine} is a shipped machine: copy it to a file of your own to write gains", EXIT_REFUSED)
    ask_consent(config, port, yes, _warning(config, motor, room_counts))
    with RunFolder.create(Path(runs), f"tune-{motor}") as folder:

        def tell(attempt: Attempt) -> None:
            folder.note("attempt", 0, stage=attempt.stage, words=attempt.words, good=attempt.good, **_gains(attempt))
            click.echo(_attempt_line(attempt), err=True)

        with told_in_words(), StopFlag() as stop, at_work(config, port, seed) as connection:
            tuned = tune_motor(connection, motor, step=step_counts, room=room_counts, stop_requested=stop, tell=tell)
        folder.write("machine.toml", described.text)
        folder.write("steps.txt", "\n".join(step_table(tuned)) + "\n")
        folder.write_json("gains.json", as_record(motor, tuned))
        with writing(folder.path / f"steps.{picture}"):
            draw_steps(folder.path / f"steps.{picture}", f"{config.machine.name}, motor {motor}: a step", tuned)
        click.echo(f"folder: {folder.path}", err=True)
    if as_json:
        click.echo(json.dumps(as_record(motor, tuned), indent=2))
    else:
        click.echo("\n".join([*step_table(tuned), "", *_result_lines(motor, tuned)]))
    if write and path is not None:
        try:
            text = with_gains(described.text, config, motor, tuned.gains)
        except ValueError as error:
            raise VerbError(f"{path}: {error}; nothing is written", EXIT_REFUSED) from None
        write_machine(described, path, text)
    if folder.troubles:
        raise VerbError("\n".join(folder.troubles), EXIT_FAULT)


def _check(config: MachineConfig, motor: str, step: int, room: int) -> None:
    from machines.wiring import servo_tables

    able = list(servo_tables(config))
    if motor not in able:
        words = f"PIC-SERVO motors: {', '.join(able)}" if able else "it has no PIC-SERVO"
        raise VerbError(f"{config.machine.name}: {motor} is no motor on a PIC-SERVO; {words}", EXIT_REFUSED)
    if room < 3 * step:
        raise VerbError(f"--room {room} is too small for steps of {step} counts: at least three of them", EXIT_REFUSED)


def _warning(config: MachineConfig, motor: str, room: int) -> list[str]:
    from machines.wiring import servo_tables

    table = servo_tables(config)[motor][1]
    length = room / abs(table.counts_per_unit)
    return [
        f"Motor {motor} will jump in small steps and may hum; between trials with new gains it holds weakly, so a",
        f"hanging axis sinks a little. It stays within {room} counts ({length:.3g} mm or degrees) of where it stands.",
    ]


def _gains(attempt: Attempt) -> dict[str, int]:
    gains = attempt.gains
    return {
        "kp": gains.position_gain,
        "kd": gains.velocity_gain,
        "ki": gains.integral_gain,
        "integration_limit": gains.integration_limit,
    }


def _attempt_line(attempt: Attempt) -> str:
    gains = attempt.gains
    values = f"Kp {gains.position_gain:5d} Kd {gains.velocity_gain:5d} Ki {gains.integral_gain:5d}"
    mark = "" if attempt.good else "  <- too much" if attempt.stage in ("Kd", "Kp") else "  <- not good"
    return f"{attempt.stage}: {values} IL {gains.integration_limit:5d}: {attempt.words}{mark}"


def step_table(tuned: Tuned) -> list[str]:
    """The step responses as text: counts from the begin over ms, forward and back, before and after."""
    columns = (tuned.before[0], tuned.after[0], tuned.before[1], tuned.after[1])
    lines = [f"a step of {tuned.after[0].step} counts", "", "     ms   forward: before   after   back: before   after"]
    for at_ms in TABLE_MS:
        cells = [_at(response, at_ms) for response in columns]
        lines.append(f"{at_ms:7d} {cells[0]:17.0f} {cells[1]:7.0f} {cells[2]:14.0f} {cells[3]:7.0f}")
    lines.append("")
    for words, name, unit in (
        ("overshoot", "overshoot", "counts"),
        ("left over", "steady_error", "counts"),
        ("to nine tenths", "rise_ms", "ms"),
        ("settled after", "settle_ms", "ms"),
    ):
        values = [getattr(response, name) for response in columns]
        lines.append(f"{words:15s} {values[0]:9.1f} {values[1]:7.1f} {values[2]:14.1f} {values[3]:7.1f}  {unit}")
    return lines


def _at(response: Response, at_ms: float) -> float:
    """The last position read by then."""
    seen = response.time_ms <= at_ms
    return float(response.position[seen][-1]) if seen.any() else 0.0


def _result_lines(motor: str, tuned: Tuned) -> list[str]:
    gains = tuned.gains
    return [
        f"[axis.{motor}.servo]",
        f"kp = {gains.position_gain}",
        f"kd = {gains.velocity_gain}",
        f"ki = {gains.integral_gain}",
        f"integration_limit = {gains.integration_limit}",
        *(f"# {note}" for note in tuned.notes),
    ]


def as_record(motor: str, tuned: Tuned) -> dict[str, Any]:
    """Gains and figures by name; what never happens (a step that does not settle) is null."""
    gains = tuned.gains

    def figures(responses: tuple[Response, Response]) -> dict[str, float | None]:
        names = ("overshoot", "steady_error", "rise_ms", "settle_ms")
        worst = {name: max(getattr(response, name) for response in responses) for name in names}
        return {name: None if value == float("inf") else round(value, 3) for name, value in worst.items()}

    return {
        "motor": motor,
        "kp": gains.position_gain,
        "kd": gains.velocity_gain,
        "ki": gains.integral_gain,
        "integration_limit": gains.integration_limit,
        "step_counts": tuned.after[0].step,
        "before": figures(tuned.before),
        "after": figures(tuned.after),
        "attempts": len(tuned.attempts),
        "notes": list(tuned.notes),
    }
