"""``groupstart run``: the main job, on the simulated machine or on a port."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.files import writing
from groupstart.inputs import open_machine, read_program
from groupstart.options import machine_option, servo_every_option, solver_option, stream_options
from groupstart.planned import checked_job, planned, refuse_unstreamable
from groupstart.programoptions import ProgramChoices, program_options

if TYPE_CHECKING:
    from gcode.canon import Position
    from machines.job import Job
    from machines.load import MachineFile
    from machines.rundir import RunFolder
    from machines.runner import Replan, RunOptions, RunResult
    from planner.plan import Plan

EXAMPLE = "compass.nc"


@click.command(name="run")
@click.argument("file", required=False, type=click.Path())
@machine_option
@program_options
@solver_option
@stream_options
@servo_every_option
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
@click.option("--home", multiple=True, metavar="AXIS", help="Home this axis before the run; may be repeated.")
@click.option("--yes", is_flag=True, help="Do not wait for anybody: tool changes and stops are taken as done.")
@click.option("--runs", type=click.Path(), default="runs", show_default=True, help="Folder of the run folders.")
@click.option("--json", "as_json", is_flag=True, help="The verdict as JSON.")
def command(
    file: str | None,
    machine: str,
    choices: ProgramChoices,
    solver: str,
    profile: str,
    seed: int | None,
    fit_bus: bool | None,
    servo_every: int,
    port: str | None,
    home: tuple[str, ...],
    yes: bool,
    runs: str,
    as_json: bool,
) -> None:
    """Run FILE (without it: the shipped example) and leave a run folder.

    The whole program is checked and planned before anything moves. On a terminal, space holds and resumes, + and -
    change the feed, < and > the rapids, q stops. Ctrl-C first stops every motor, then ends the program with exit
    status 2. On the simulated machine the verdict decides: 0 good, 1 not.
    """
    from machines.bringup import is_simulated
    from machines.rundir import RunFolder
    from machines.runner import RunOptions

    name = file or EXAMPLE
    text = read_program(file) if file is not None else example_text()
    described = open_machine(machine)
    refuse_unstreamable(described, profile, is_simulated(described.config, port))
    job = checked_job(name, text, choices, described)
    plan = planned(job, described, solver)
    with RunFolder.create(Path(runs), name) as folder:
        folder.write("job.nc", text)
        folder.write("machine.toml", described.text)
        with writing(folder.path / "plan.npz"):
            plan.save(folder.path / "plan.npz")
        options = RunOptions(port=port, seed=seed, profile=profile, home=home, ask=asker(yes), fit_bus=fit_bus)

        def replan(start: Position) -> tuple[Job, Plan]:
            again = checked_job(name, text, choices, described, start)
            return again, planned(again, described, solver)

        result = run_in(folder, job, plan, described, options, replan)
        leave(folder, described, result, servo_every)
    if result.verdict is None:
        raise VerbError("\n".join([result.fault, *folder.troubles, f"run folder: {folder.path}"]), EXIT_FAULT)
    if as_json:
        click.echo(json.dumps(result.verdict.as_json(), indent=2))
    else:
        from groupstart.verdicttable import print_verdict

        print_verdict(result.verdict)
    click.echo(f"run folder: {folder.path}", err=True)
    if folder.troubles or not result.verdict.ok:
        raise VerbError("\n".join(folder.troubles), EXIT_FAULT if result.verdict.ok else EXIT_REFUSED)


def asker(yes: bool) -> Callable[[str], bool] | None:
    """How requests reach whoever stands at the machine: on the terminal, if there is one."""
    if yes:
        return lambda request: True
    if not sys.stdin.isatty():
        return None
    return lambda request: click.confirm(f"{request}. Done?", default=True, err=True)


def example_text() -> str:
    """The program that runs when none is named."""
    return (resources.files("groupstart") / "data" / EXAMPLE).read_text(encoding="utf-8")


def run_in(
    folder: RunFolder, job: Job, plan: Plan, machine: MachineFile, options: RunOptions, replan: Replan
) -> RunResult:
    """Run with a progress bar and with the journal in the run folder."""
    from groupstart.keys import HELP, Keys
    from groupstart.progress import RunProgress
    from groupstart.stopflag import StopFlag
    from machines.runner import perform

    last_line = len(job.text.splitlines())
    progress = RunProgress(plan.trajectory.duration_s, last_line)
    with StopFlag() as stop, Keys(show=progress.show) as keys, progress:
        if keys.listening:
            progress.say(f"keys: {HELP}")

        def ask(request: str) -> bool:
            with progress.aside(), keys.aside():
                return options.ask is not None and options.ask(request)

        options = replace(options, control=keys, warn=progress.warn, tell=progress.tell)
        return perform(
            job,
            plan,
            machine,
            options if options.ask is None else replace(options, ask=ask),
            note=folder.note,
            progress=progress,
            stop_requested=stop,
            replan=replan,
        )


def leave(folder: RunFolder, machine: MachineFile, result: RunResult, servo_every: int = 1) -> None:
    """Write what a run leaves: verdict, bus record or trace, plan that ran, picture; as far as the disk takes it."""
    from machines.thin import thin_servo

    with folder.keep("verdict.json"):
        if result.verdict is not None:
            folder.write_json("verdict.json", result.verdict.as_json())
        else:
            folder.write_json("verdict.json", {"ok": False, "reasons": [result.fault]})
    for bus, lines in result.records.items():
        with folder.keep(f"bus-{bus}.txt"):
            folder.write(f"bus-{bus}.txt", "\n".join(lines) + "\n")
    with folder.keep("plan.npz") as path:
        result.plan.save(path)
    if result.trace is not None:
        with folder.keep("trace.npz") as path:
            thin_servo(result.trace, servo_every).save(path)
        with folder.keep("path.png") as path:
            draw_run(path, machine, result)


def draw_run(path: Path, machine: MachineFile, result: RunResult) -> None:
    """The picture of planned and simulated path."""
    from groupstart.picture import draw
    from groupstart.picturedata import path_data, pin_data

    planned_path = path_data(result.plan.trajectory, result.job.commands)
    title = f"{Path(result.job.name).name} on {machine.config.machine.name}: planned and simulated"
    draw(path, title, planned_path, pin_data(machine.config, result, planned_path.axes))
