"""The machine by hand: one short program, run from where the machine stands, without a run folder."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.inputs import open_machine
from groupstart.planned import checked_job, planned, refuse_unstreamable
from groupstart.programoptions import ProgramChoices

if TYPE_CHECKING:
    from planner.plan import Plan
    from planner.types import F8


def move_by_hand(text: str, what: str, machine: str, port: str | None) -> None:
    """Check, plan and run ``text`` and print where the axes end. Raises VerbError as ``run`` does."""
    from gcode.canon import ORIGIN, Position
    from groupstart.stopflag import StopFlag
    from machines.bringup import is_simulated
    from machines.job import Job
    from machines.runner import RunOptions, perform

    described = open_machine(machine)
    refuse_unstreamable(described, "auto", is_simulated(described.config, port))
    choices = ProgramChoices()

    def from_place(start: Position) -> tuple[Job, Plan]:
        job = checked_job(what, text, choices, described, start)
        return job, planned(job, described, "kernel")

    job, plan = from_place(ORIGIN)
    with StopFlag() as stop:
        options = RunOptions(port=port, warn=partial(_say, "warning"), tell=partial(_say, "note"))
        result = perform(job, plan, described, options, stop_requested=stop, replan=from_place)
    if result.verdict is None or result.outcome is None:
        raise VerbError(result.fault, EXIT_FAULT)
    end = result.plan.trajectory.q(_end(result.plan))[0]
    places = zip(result.plan.trajectory.axes, end, strict=True)
    click.echo(" ".join(f"{axis}{value + 0.0:.4f}" for axis, value in places))
    if not result.verdict.ok:
        raise VerbError("; ".join(result.verdict.reasons), EXIT_REFUSED)


def _end(plan: Plan) -> F8:
    import numpy as np

    return np.array([plan.trajectory.duration_s])


def _say(kind: str, words: str) -> None:
    click.echo(f"{kind}: {words}", err=True)
