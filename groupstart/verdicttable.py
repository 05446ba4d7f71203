"""The verdict for people: one table, then GO or NO-GO with the reasons."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Console
from rich.table import Table

from machines.shafts import ShaftUse, words_of_shafts
from machines.verdict import Spread, Verdict


def print_verdict(verdict: Verdict) -> None:
    """Print the verdict table on stdout."""
    console = Console(highlight=False, soft_wrap=True)
    table = Table(title=f"verdict: {verdict.machine}", title_justify="left", show_header=False)
    table.add_column("what", no_wrap=True)
    table.add_column("value")
    for what, value in verdict_rows(verdict):
        table.add_row(what, value)
    console.print(table)
    for warning in verdict.warnings:
        console.print(f"warning: {warning}", style="yellow")
    if verdict.ok:
        console.print(f"GO: {words_of_go(verdict)}", style="bold green")
    else:
        console.print("NO-GO: " + "; ".join(verdict.reasons), style="bold red")


def words_of_go(verdict: Verdict) -> str:
    """What was judged and found good: no more than is known on this machine."""
    what = "axis" if verdict.shafts is None else "command"
    most = max((abs(steps) for steps in verdict.end_error_steps.values()), default=0)
    ended = f"every {what} ended " + (f"within {most} steps of its place" if most else "on its step")
    words = [ended]
    if verdict.contour_steps is not None:
        words = [f"within {verdict.contour_steps.max:.2f} steps of the plan, and {ended}"]
    if verdict.shafts is not None:
        words.append(words_of_shafts(verdict.shafts))
    if verdict.contour_steps is None:
        words.append("how near the path was between is not known on a port")
    return "; ".join(words)


def verdict_rows(verdict: Verdict) -> list[tuple[str, str]]:
    """Name and value of each row; what is not known on this machine is left out."""
    rows = [("planned time", f"{verdict.plan_time_s:.3f} s")]
    rows += [("", words) for words in verdict.bus_notes]
    if verdict.sim_time_s is not None:
        percent = 100 * (verdict.sim_time_s / verdict.plan_time_s - 1) if verdict.plan_time_s else 0.0
        rows.append(("simulated time", f"{verdict.sim_time_s:.3f} s ({percent:+.3f} %)"))
    if verdict.contour_steps is not None and verdict.contour_um is not None:
        rows.append(("contour error", f"{_spread(verdict.contour_steps)} steps, worst in line {verdict.worst_line}"))
        rows.append(("", f"{_spread(verdict.contour_um)} um"))
    if verdict.motor_contour_um is not None:
        rows.append(("shafts from the plan", f"{_spread(verdict.motor_contour_um)} um"))
    if verdict.program_um is not None:
        shafts = verdict.shaft_program_um
        words = f"at most {verdict.program_um:.1f} um" + ("" if shafts is None else f", shafts at most {shafts:.1f} um")
        rows.append(("from the programmed path", words))
    if verdict.lag_ms is not None:
        rows.append(("lag along the path", f"at most {verdict.lag_ms[0]:.1f} ms, rms {verdict.lag_ms[1]:.2f} ms"))
    rows += _lag_rows(verdict)
    rows.append(("end error", f"{_by_motor(verdict.end_error_steps)} steps"))
    if verdict.shafts is not None:
        rows += _shaft_rows(verdict.shafts)
    use = verdict.bus
    rows.append(
        (
            "bus use",
            f"{100 * use.utilisation:.0f} %, {use.packets} packets, {use.bytes} bytes, slice {use.slice_ms:.1f} ms, "
            f"{verdict.late_slices} late",
        )
    )
    fed = "  ".join(f"{bus}: {profile}" for bus, profile in verdict.profiles.items())
    if fed:
        rows.append(("profile", fed))
    if verdict.outputs is not None:
        off = verdict.outputs
        words = f"{off.changes} changes, at most {off.off_ms_max:.2f} ms off, rms {off.off_ms_rms:.2f} ms"
        rows.append(("spindle and outputs", words))
    rows += _host_rows(verdict)
    if verdict.sim_time_s is None:
        return rows  # what went against the data sheets only the twin can tell
    names = ", ".join(f"{name}: {count}" for name, count in verdict.violations.items())
    rows.append(("violations of the data sheets", names or "none"))
    return rows


def _lag_rows(verdict: Verdict) -> list[tuple[str, str]]:
    """The axis and the line that are latest; all of them are in the report."""
    rows = []
    for what, use in (("lag, worst axis and line", verdict.lags), ("lag of the shafts", verdict.shaft_lags)):
        if use is None or not use.lines:
            continue
        axis, line = use.worst_motor, use.worst_line
        found = use.motors[axis]
        words = f"{axis} at most {found.max_ms:.1f} ms, rms {found.rms_ms:.2f} ms; "
        words += f"{use.lines[line][0]:.1f} ms in line {line}"
        path = f"at most {use.max_ms:.1f} ms, rms {use.rms_ms:.2f} ms; " if use is verdict.shaft_lags else ""
        rows.append((what, path + words))
    return rows


def _shaft_rows(use: ShaftUse) -> list[tuple[str, str]]:
    rows = [("shafts at rest", f"{_by_motor(use.end_counts)} counts from their places")]
    if use.off_um:
        most = "  ".join(f"{name} {off_um:.0f}" for name, off_um in use.off_um.items())
        rows.insert(0, ("shafts at equal times", f"at most {most} um from their places"))
    return rows


def _by_motor(errors: Mapping[str, int]) -> str:
    return "  ".join(f"{name} {off:+d}" if off else f"{name} 0" for name, off in errors.items())


def _host_rows(verdict: Verdict) -> list[tuple[str, str]]:
    """What the host did, where it is of interest, and every hold."""
    rows, host = [], verdict.host
    if host is not None and (verdict.sim_time_s is None or host.least_speed_percent < 100 or host.late_exchanges):
        words = (
            f"99 % within {host.delay_p99_ms:.2f} ms, at most {host.delay_max_ms:.2f} ms, {host.late_exchanges} late"
        )
        if host.least_speed_percent < 100:
            words += f"; slowed to {host.least_speed_percent:.0f} % at the least"
        if verdict.contour_steps is None and host.strain_steps is not None:
            words += f"; about {host.strain_steps:.1f} steps or counts off the path, by what the host knows"
        rows.append(("host delays", words))
    for hold in verdict.holds:
        words = f"line {hold.line}: rest in {hold.announced_s:.3f} s and {hold.announced_mm:.3f} mm announced"
        if hold.measured_s is not None and hold.off_mm is not None:
            words += f"; stood {hold.off_mm:.3f} mm from there, known after {hold.measured_s:.3f} s"
        rows.append(("hold", words))
    return rows


def _spread(spread: Spread) -> str:
    return f"max {spread.max:.2f}, 99.9 % {spread.p999:.2f}, rms {spread.rms:.2f}"
