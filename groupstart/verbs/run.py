"""``groupstart run``: the main job, on the simulated machine or on a port."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.inputs import open_machine, read_program
from groupstart.options import machine_option, solver_option, stream_options
from groupstart.planned import checked_job, planned, refuse_unstreamable
from groupstart.programoptions import ProgramChoices, program_options

if TYPE_CHECKING:
    from machines.job import Job
    from machines.load import MachineFile
    from machines.rundir import RunFolder
    from machines.runner import RunOptions, RunResult
    from planner.plan import Plan
    from sim.trace import Trace

EXAMPLE = "compass.nc"


@click.command(name="run")
@click.argument("file", required=False, type=click.Path())
@machine_option
@program_options
@solver_option
@stream_options
@click.option("--port", metavar="sim|PATH", help="Port of the machine's bus instead of the one in its file.")
@click.option("--runs", type=click.Path(), default="runs", show_default=True, help="Folder of the run folders.")
@click.option("--json", "as_json", is_flag=True, help="The verdict as JSON.")
def command(
    file: str | None,
    machine: str,
    choices: ProgramChoices,
    solver: str,
    profile: str,
    seed: int | None,
    port: str | None,
    runs: str,
    as_json: bool,
) -> None:
    """Run FILE (without it: the shipped example) and leave a run folder.

    The whole program is checked and planned before anything moves. Ctrl-C first stops every motor, then ends the
    program with exit status 2. On the simulated machine the verdict decides: 0 good, 1 not.
    """
    from machines.rundir import RunFolder
    from machines.runner import RunOptions

    name = file or EXAMPLE
    text = read_program(file) if file is not None else example_text()
    described = open_machine(machine)
    refuse_unstreamable(described)
    job = checked_job(name, text, choices, described)
    plan = planned(job, described, solver)
    with RunFolder.create(Path(runs), name) as folder:
        folder.write("job.nc", text)
        folder.write("machine.toml", described.text)
        plan.save(folder.path / "plan.npz")
        result = run_in(folder, job, plan, described, RunOptions(port=port, seed=seed, profile=profile))
        leave(folder, job, plan, described, result)
    if result.verdict is None:
        raise VerbError(f"{result.fault}\nrun folder: {folder.path}", EXIT_FAULT)
    if as_json:
        click.echo(json.dumps(result.verdict.as_json(), indent=2))
    else:
        from groupstart.verdicttable import print_verdict

        print_verdict(result.verdict)
    click.echo(f"run folder: {folder.path}", err=True)
    if not result.verdict.ok:
        raise VerbError("", EXIT_REFUSED)


def example_text() -> str:
    """The program that runs when none is named."""
    return (resources.files("groupstart") / "data" / EXAMPLE).read_text(encoding="utf-8")


def run_in(folder: RunFolder, job: Job, plan: Plan, machine: MachineFile, options: RunOptions) -> RunResult:
    """Run with a progress bar and with the journal in the run folder."""
    from groupstart.progress import RunProgress
    from groupstart.stopflag import StopFlag
    from machines.runner import perform

    last_line = len(job.text.splitlines())
    with RunProgress(plan.trajectory.duration_s, last_line) as progress, StopFlag() as stop:
        return perform(job, plan, machine, options, note=folder.note, progress=progress, stop_requested=stop)


def leave(folder: RunFolder, job: Job, plan: Plan, machine: MachineFile, result: RunResult) -> None:
    """Write what the run has left: trace or bus record, verdict, picture."""
    from machines.runner import scales

    if result.trace is not None:
        start_ns = result.outcome.plan_start_ns if result.outcome else 0
        scale = scales(machine)
        trace = result.trace.save(folder.path / "trace.npz", steps_per_unit=scale, plan_start_ns=start_ns)
        draw_run(folder.path / "path.png", job, plan, machine, trace, scale)
    for bus, lines in result.records.items():
        folder.write(f"bus-{bus}.txt", "\n".join(lines) + "\n")
    if result.verdict is not None:
        folder.write_json("verdict.json", result.verdict.as_json())
    else:
        folder.write_json("verdict.json", {"ok": False, "reasons": [result.fault]})


def draw_run(path: Path, job: Job, plan: Plan, machine: MachineFile, trace: Trace, scale: dict[str, float]) -> None:
    """The picture of planned and simulated path."""
    from groupstart.picture import draw
    from groupstart.picturedata import path_data, pin_data
    from machines.wiring import motor_tables

    motor_axis = {name: axis for name, (axis, _) in motor_tables(machine.config).items()}
    planned_path = path_data(plan.trajectory, job.commands)
    pins = pin_data(trace, planned_path.axes, motor_axis, scale)
    title = f"{Path(job.name).name} on {machine.config.machine.name}: planned and simulated"
    draw(path, title, planned_path, pins)
