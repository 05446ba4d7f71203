"""``groupstart regress``: a suite of jobs on machines against its baselines."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.files import writing, wrote

if TYPE_CHECKING:
    from collections.abc import Sequence

    from groupstart.regress.case import Result
    from groupstart.regress.outputs import Outcome
    from groupstart.regress.suite import Suite

SHOWN = 12


@click.command(name="regress")
@click.argument("suite", type=click.Path())
@click.option("--update", is_flag=True, help="Take what comes out as the new baselines.")
@click.option("--only", metavar="REGEX", help="Only cases whose name (JOB on MACHINE) has this in it.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes; one for each core if it is not given.")
@click.option("--scheduler", metavar="tcp://HOST:PORT", help="Run on a Dask cluster instead (needs groupstart[dask]).")
@click.option("--report", type=click.Path(), help="Folder for an overlay page of every case that changed.")
@click.option("--junit", type=click.Path(), help="File for the results as JUnit XML.")
@click.option("--json", "as_json", is_flag=True, help="The results as JSON.")
def command(
    suite: str,
    update: bool,
    only: str | None,
    workers: int | None,
    scheduler: str | None,
    report: str | None,
    junit: str | None,
    as_json: bool,
) -> None:
    """Run every job of SUITE (a TOML file) on its machines and tell what is not as in the baselines.

    Exit status 0 if everything is, or with --update; 1 if something changed; 2 if the suite cannot be run.
    """
    from groupstart.regress.baseline import read_baseline, write_baseline
    from groupstart.regress.compare import differences
    from groupstart.regress.outputs import Outcome, as_junit
    from groupstart.regress.outputs import as_json as json_of

    chosen = _suite(suite, only)
    results = _run(chosen, workers, scheduler)
    outcomes = []
    for result in results:
        found = differences(result, read_baseline(chosen.baselines, result.job, result.machine), chosen.tolerance)
        outcomes.append(Outcome(result, tuple(found)))
    if update:
        written = sum(write_baseline(chosen.baselines, result) for result in results)
        click.echo(f"{written} of {len(results)} baselines are new, in {chosen.baselines}", err=True)
    if junit is not None:
        with writing(junit):
            Path(junit).write_text(as_junit(chosen.name, outcomes), encoding="utf-8")
        wrote(junit)
    if report is not None:
        _write_overlays(Path(report), chosen, outcomes)
    if as_json:
        click.echo(json.dumps(json_of(chosen.name, outcomes), indent=2))
    else:
        click.echo("\n".join(told(outcomes)))
    if not update and not all(outcome.ok for outcome in outcomes):
        raise VerbError("", EXIT_REFUSED)


def _suite(path: str, only: str | None) -> Suite:
    from dataclasses import replace

    from groupstart.regress.suite import SuiteError, read_suite

    try:
        suite = read_suite(Path(path))
    except SuiteError as error:
        raise VerbError(str(error), EXIT_FAULT) from None
    if only is None:
        return suite
    try:
        cases = tuple(case for case in suite.cases if re.search(only, case.name))
    except re.error as error:
        raise VerbError(f"--only {only!r}: {error}", EXIT_FAULT) from None
    if not cases:
        raise VerbError(f"--only {only!r}: no case of {path} has such a name", EXIT_FAULT)
    return replace(suite, cases=cases)


def _run(suite: Suite, workers: int | None, scheduler: str | None) -> list[Result]:
    """Run the cases with a progress bar on stderr; results in the order of the suite."""
    from rich.console import Console
    from rich.progress import Progress

    from groupstart.regress.pool import SchedulerError, run_cases

    place = {(case.job, case.machine): k for k, case in enumerate(suite.cases)}
    found: dict[int, Result] = {}
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(suite.name, total=len(suite.cases))
        try:
            for result in run_cases(suite.cases, workers, scheduler):
                found[place[result.job, result.machine]] = result
                bar.update(task, advance=1, description=f"{result.job} on {result.machine}")
        except SchedulerError as error:
            raise VerbError(str(error), EXIT_FAULT) from None
    return [found[k] for k in sorted(found)]


def told(outcomes: Sequence[Outcome]) -> list[str]:
    """A line for each case, and under it what changed."""
    rows = []
    for outcome in outcomes:
        result = outcome.result
        time_s = dict(result.fields).get("plan.time_s", "")
        state = "same" if outcome.ok else "CHANGED"
        rows.append(f"{state:<8}{result.job} on {result.machine}" + (f" ({float(time_s):.1f} s)" if time_s else ""))
        rows += [f"        {difference.text()}" for difference in outcome.differences[:SHOWN]]
        if len(outcome.differences) > SHOWN:
            rows.append(f"        and {len(outcome.differences) - SHOWN} more")
    bad = sum(not outcome.ok for outcome in outcomes)
    rows.append(f"{len(outcomes)} cases, {bad} changed" if bad else f"{len(outcomes)} cases, all as in the baselines")
    return rows


def _write_overlays(folder: Path, suite: Suite, outcomes: Sequence[Outcome]) -> None:
    from groupstart.regress.baseline import read_baseline
    from groupstart.regress.overlaid import overlaid

    cases = {(case.job, case.machine): case for case in suite.cases}
    for outcome in outcomes:
        result = outcome.result
        baseline = read_baseline(suite.baselines, result.job, result.machine)
        if outcome.ok or baseline is None or result.fault:
            continue
        page = overlaid(cases[result.job, result.machine], baseline, outcome.differences)
        if page is not None:
            path = folder / f"{result.job}-{result.machine}.html"
            with writing(path):
                folder.mkdir(parents=True, exist_ok=True)
                path.write_text(page, encoding="utf-8")
            wrote(path)
