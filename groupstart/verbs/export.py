"""``groupstart export``: a plan, a trace or a run folder in the formats of other tools."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from groupstart.exits import EXIT_FAULT, EXIT_REFUSED, VerbError
from groupstart.files import writing, wrote
from groupstart.inputs import open_machine

if TYPE_CHECKING:
    from collections.abc import Callable

    from groupstart.report.vcd import Signal
    from sim.trace import Trace

FORMATS = (".csv", ".parquet", ".vcd", ".perfetto-trace", ".svg", ".png")
TABLES = ("plan", "steps", "servos", "bus")
PLOTS = ("speed", "position", "velocity", "rate", "servo")


@click.command(name="export")
@click.argument("source", type=click.Path())
@click.option(
    "-o", "--output", required=True, type=click.Path(), help=f"File; its ending is one of {' '.join(FORMATS)}."
)
@click.option("--table", type=click.Choice(TABLES), help="Of CSV and Parquet: what of it; plan or steps by default.")
@click.option("--plot", type=click.Choice(PLOTS), default="speed", show_default=True, help="Of SVG and PNG: what.")
def command(source: str, output: str, table: str | None, plot: str) -> None:
    """Write SOURCE (a run folder, plan.npz or trace.npz) as tables, waveforms, a bus timeline or a plot.

    .vcd: step and direction pins. .perfetto-trace: every packet of the buses, for ui.perfetto.dev.
    """
    target = Path(output)
    ending = target.suffix.lower()
    if ending not in FORMATS:
        raise VerbError(f"{output}: the ending must be one of {', '.join(FORMATS)}", EXIT_FAULT)
    if ending in (".csv", ".parquet"):
        _write_table(Path(source), target, table)
    elif ending == ".vcd":
        from groupstart.report.vcd import step_signals, vcd_lines

        signals = _signals(Path(source), step_signals)
        with writing(target), target.open("w", encoding="ascii", newline="\n") as file:
            file.writelines(line + "\n" for line in vcd_lines(signals))
    elif ending == ".perfetto-trace":
        _write_perfetto(_trace(Path(source)), target)
    else:
        _write_plot(Path(source), target, plot)
    wrote(output)


def _signals(source: Path, of_steppers: Callable[[Trace], list[Signal]]) -> list[Signal]:
    """Pins of the steppers; of a run folder, whose machine is known, also the PWM of the servos."""
    from groupstart.report.vcd import pwm_signals

    trace = _trace(source)
    machine = source / "machine.toml"
    servos = pwm_signals(open_machine(str(machine)).config, trace) if machine.is_file() else []
    return of_steppers(trace) + servos


def _trace(source: Path) -> Trace:
    from sim.trace import load

    path = source / "trace.npz" if source.is_dir() else source
    try:
        return load(path)
    except OSError as error:
        raise VerbError(f"{path}: {error.strerror or error}", EXIT_FAULT) from None
    except (KeyError, ValueError, zipfile.BadZipFile):
        raise VerbError(f"{path}: not a trace", EXIT_REFUSED) from None


def _plan(source: Path) -> dict[str, Any]:
    import numpy as np

    path = source / "plan.npz" if source.is_dir() else source
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in ("t_s", "q", "v", "line", "axes")}
    except OSError as error:
        raise VerbError(f"{path}: {error.strerror or error}", EXIT_FAULT) from None
    except (KeyError, ValueError, zipfile.BadZipFile):
        raise VerbError(f"{path}: not a plan", EXIT_REFUSED) from None


def _is_trace(source: Path) -> bool:
    """Whether a file holds a trace; a folder holds both and is taken for its plan."""
    if source.is_dir() or not zipfile.is_zipfile(source):
        return False
    with zipfile.ZipFile(source) as file:
        return "run_first_ns.npy" in file.namelist()


def _write_table(source: Path, target: Path, wanted: str | None) -> None:
    from groupstart.report.tables import MissingExtraError, plan_table, trace_tables, write_csv, write_parquet

    chosen = wanted or ("steps" if _is_trace(source) else "plan")
    table = plan_table(_plan(source)) if chosen == "plan" else trace_tables(_trace(source))[chosen]
    try:
        with writing(target):
            (write_csv if target.suffix.lower() == ".csv" else write_parquet)(target, table)
    except MissingExtraError as error:
        raise VerbError(str(error), EXIT_FAULT) from None


def _write_perfetto(trace: Trace, target: Path) -> None:
    from groupstart.report.busslices import bus_slices, rate_samples
    from groupstart.report.perfetto import perfetto_trace

    tracks, slices = bus_slices(trace)
    counters, samples = rate_samples(trace, first=len(tracks) + 1)
    with writing(target), target.open("wb") as file:
        file.writelines(perfetto_trace(tracks, slices, counters, samples))


def _write_plot(source: Path, target: Path, plot: str) -> None:
    from groupstart.report.plotfile import plot_plan, plot_trace

    if plot in ("rate", "servo"):
        trace = _trace(source)
        with writing(target):
            plot_trace(target, trace, plot)
    else:
        plan = _plan(source)
        with writing(target):
            plot_plan(target, plan, plot)
