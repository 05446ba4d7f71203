"""One plot as a file, PNG or SVG, from a plan or a trace; matplotlib is imported only here."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from groupstart.report.rates import emitted_rate
from planner.types import F8
from sim.trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PIXELS = 2400
COLOURS = ("#0a7fd0", "#e8862b", "#d23c3c", "#8a55d6", "#0d9c63")


def plot_plan(path: Path, arrays: Mapping[str, npt.NDArray[Any]], what: str) -> None:
    """``speed``, ``position`` or ``velocity`` over time, of the arrays of a plan.npz."""
    axes = [str(axis) for axis in arrays["axes"]]
    t, values = arrays["t_s"], arrays["q" if what == "position" else "v"]
    if what == "speed":
        linear = [k for k, axis in enumerate(axes) if axis not in "ABC"]
        series = {"speed": (t, np.linalg.norm(values[:, linear], axis=1))}
    else:
        series = {axis: (t, values[:, k]) for k, axis in enumerate(axes)}
    _draw(path, series, f"{what}, {'mm' if what == 'position' else 'mm/s'}")


def plot_trace(path: Path, trace: Trace, what: str) -> None:
    """``rate`` of the steppers or following error of the ``servo`` axes over time, of a trace."""
    series = {}
    for k, name in enumerate(trace.axes):
        if what == "rate" and np.any(trace.run_axis == k):
            series[name] = emitted_rate(trace, name)
        elif what == "servo" and np.any(trace.servo_axis == k):
            mine = trace.servo_axis == k
            error = trace.servo_command[mine].astype(np.float64) - trace.servo_position[mine]
            series[name] = ((trace.servo_ns[mine] - trace.plan_start_ns) * 1e-9, error)
    _draw(path, series, "step rate, steps/s" if what == "rate" else "following error, counts", stepped=what == "rate")


def _draw(path: Path, series: Mapping[str, tuple[F8, F8]], label: str, stepped: bool = False) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.6), dpi=140, facecolor="white", layout="constrained")
    ax: Axes = figure.add_subplot()
    for (name, (t, values)), colour in zip(series.items(), COLOURS * 4, strict=False):
        t, values = extremes(t, values)
        ax.plot(t, values, lw=0.9, color=colour, label=name, drawstyle="steps-post" if stepped else "default")
    ax.set_xlabel("time, s")
    ax.set_ylabel(label)
    ax.grid(color="#e6e8eb", lw=0.6)
    if len(series) > 1:
        ax.legend(loc="upper right", frameon=False, ncol=len(series))
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    figure.savefig(path, format=path.suffix.removeprefix(".").lower())


def extremes(t: F8, values: F8, pixels: int = PIXELS) -> tuple[F8, F8]:
    """Of long series the least and greatest value in each of ``pixels`` stretches, in the order in which they come."""
    if len(t) <= 4 * pixels:
        return t, values
    first = np.linspace(0, len(t), pixels + 1).astype(int)[:-1]
    stop = np.append(first[1:], len(t))
    keep = {int(pick) for a, b in zip(first, stop, strict=True)
            for pick in (a + np.argmin(values[a:b]), a + np.argmax(values[a:b]))}  # fmt: skip
    index = np.array(sorted(keep | {0, len(t) - 1}))
    return t[index], values[index]
