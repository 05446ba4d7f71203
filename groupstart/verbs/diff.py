"""``groupstart diff``: two programs, or one program on two machines, compared as motion, not as text."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.files import writing, wrote
from groupstart.inputs import open_machine, read_program
from groupstart.options import machine_option, solver_option
from groupstart.planned import checked_job, planned
from groupstart.programoptions import ProgramChoices, program_options

if TYPE_CHECKING:
    from groupstart.report.motiondiff import Change, Motion, MotionDiff
    from machines.load import MachineFile
    from planner.plan import Plan

SHOWN = 40


@click.command(name="diff")
@click.argument("first", type=click.Path())
@click.argument("second", required=False, type=click.Path())
@machine_option
@click.option("--other-machine", metavar="NAME|PATH", help="Machine of the second motion, if it is another one.")
@program_options
@solver_option
@click.option(
    "--tolerance-um",
    type=click.FloatRange(min=0),
    default=0.01,
    show_default=True,
    help="Paths nearer than this are the same.",
)
@click.option(
    "--tolerance-s",
    type=click.FloatRange(min=0),
    default=1e-6,
    show_default=True,
    help="Times nearer than this are the same.",
)
@click.option("--report", type=click.Path(), help="Page with both motions over each other (.html).")
@click.option("--json", "as_json", is_flag=True, help="The differences as JSON.")
def command(
    first: str,
    second: str | None,
    machine: str,
    other_machine: str | None,
    choices: ProgramChoices,
    solver: str,
    tolerance_um: float,
    tolerance_s: float,
    report: str | None,
    as_json: bool,
) -> None:
    """Compare the motion of FIRST and SECOND, or of FIRST on two machines: moves, paths, times.

    Exit status 0 if both are the same motion within the tolerances, 1 if they differ.
    """
    from groupstart.report.motiondiff import compare_motions

    if second is None and other_machine is None:
        raise VerbError("give a second program, or --other-machine", EXIT_FAULT)
    described = open_machine(machine)
    other = described if other_machine is None else open_machine(other_machine)
    a, plan_a = _motion(first, described, choices, solver)
    b, _ = _motion(second or first, other, choices, solver)
    if tuple(a.trajectory.axes) != tuple(b.trajectory.axes):
        raise VerbError("the two machines have different axes", EXIT_REFUSED)
    found = compare_motions(a, b)
    if as_json:
        click.echo(json.dumps(found.as_json(), indent=2))
    else:
        click.echo("\n".join(told(found)))
    if report is not None:
        _write(report, found, a, plan_a, described, f"{first} against {second or other.config.machine.name}")
    if not found.same(tolerance_um * 1e-3, tolerance_s):
        raise VerbError("", EXIT_REFUSED)


def _motion(file: str, machine: MachineFile, choices: ProgramChoices, solver: str) -> tuple[Motion, Plan]:
    from groupstart.report.motiondiff import motion_of

    job = checked_job(file, read_program(file), choices, machine)
    plan = planned(job, machine, solver)
    return motion_of(job, plan), plan


def told(found: MotionDiff) -> list[str]:
    """The differences for a terminal, a line each."""
    rows = [
        f"time {found.time_a_s:.3f} s and {found.time_b_s:.3f} s ({found.time_b_s - found.time_a_s:+.3f} s)",
        f"where the moves are the same the paths are within {1e3 * found.same_mm:.3f} um",
        *(change_text(change) for change in found.changes[:SHOWN]),
    ]
    if len(found.changes) > SHOWN:
        rows.append(f"and {len(found.changes) - SHOWN} more changes")
    return rows


def change_text(change: Change) -> str:
    """One difference in words, with its lines."""
    places = [
        f"{side} {lines[0]}" + (f"-{lines[1]}" if lines[1] != lines[0] else "")
        for side, lines in (("line", change.lines_a), ("now line", change.lines_b))
        if lines is not None
    ]
    measure = f"{1e3 * change.distance_mm:.1f} um apart, {change.time_s:+.3f} s"
    return f"{', '.join(places)}: {change.words} ({measure})"


def _write(path: str, found: MotionDiff, a: Motion, plan: Plan, machine: MachineFile, subtitle: str) -> None:
    from groupstart.report.measured import worst_places
    from groupstart.report.overlay import OverlayInput, overlay_page
    from groupstart.report.preview import columns_of_plan

    rows = told(found)
    worst = [place for place in worst_places(found.other, a.trajectory) if place.error_um > 1e-3]
    page = overlay_page(
        OverlayInput(
            a.job, machine, columns_of_plan(plan), found.other, worst,
            [change_text(change) for change in found.changes], [("compared", row) for row in rows[:2]], subtitle,
        )
    )  # fmt: skip
    with writing(path):
        Path(path).write_text(page, encoding="utf-8")
    wrote(path)
