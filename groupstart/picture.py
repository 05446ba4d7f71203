"""Pictures of a path: PNG or SVG by matplotlib, which is imported only when one is drawn.

The planned path is coloured by speed, rapids are thin and grey; of a run the pins are drawn over it, and beside it
stand height and contour error over time.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

F8 = npt.NDArray[np.float64]

RAPID_GREY = "#9aa3ad"
PIN_COLOUR = "#111111"
INK = "#24292f"
MOST_POINTS = 200_000


@dataclass(frozen=True, slots=True, eq=False)
class PathData:
    """A planned path to draw: t_s f8[N], q f8[N, A] in mm, v f8[N, A], rapid bool[N]."""

    axes: tuple[str, ...]
    t_s: F8
    q: F8
    v: F8
    rapid: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class PinData:
    """Where the motors stood after each pulse: t_s f8[K] of the plan's time, q f8[K, A] in mm."""

    t_s: F8
    q: F8


def draw(path: Path, title: str, planned: PathData, pins: PinData | None = None) -> None:
    """Write the picture to ``path``; its ending (.png, .svg) names the format. Raises OSError where the disk does."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 6.6), dpi=140, facecolor="white", layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(2.05, 1))
    plan_view, side_view = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    speed_plot, last_plot = figure.add_subplot(grid[1, 1]), figure.add_subplot(grid[2, 1])
    _plan_view(figure, plan_view, planned, pins)
    _side_view(side_view, planned, pins)
    _speed_plot(speed_plot, planned)
    _last_plot(last_plot, planned, pins)
    figure.suptitle(title, fontsize=12, color=INK)
    figure.savefig(path, format=path.suffix.removeprefix(".").lower() or "png")


def _columns(axes: tuple[str, ...]) -> tuple[int, int]:
    """The two axes of the plan view: X and Y, or the first two there are."""
    first = axes.index("X") if "X" in axes else 0
    second = axes.index("Y") if "Y" in axes else min(1, len(axes) - 1)
    return first, second


def _thin(count: int) -> slice:
    return slice(None, None, max(1, -(-count // MOST_POINTS)))


def _plan_view(figure: Figure, ax: Axes, planned: PathData, pins: PinData | None) -> None:
    from matplotlib.collections import LineCollection

    first, second = _columns(planned.axes)
    keep = _thin(len(planned.t_s))
    points = planned.q[keep][:, [first, second]]
    speed = np.linalg.norm(planned.v[keep], axis=1)
    rapid = planned.rapid[keep]
    edges = np.stack((points[:-1], points[1:]), axis=1)
    moved = np.any(edges[:, 0] != edges[:, 1], axis=1)
    feeds = LineCollection(list(edges[moved & ~rapid[1:]]), cmap="viridis", linewidths=2.2, zorder=2)
    feeds.set_array(0.5 * (speed[:-1] + speed[1:])[moved & ~rapid[1:]])
    jumps = LineCollection(list(edges[moved & rapid[1:]]), colors=RAPID_GREY, linewidths=0.7, zorder=1)
    ax.add_collection(jumps)
    ax.add_collection(feeds)
    if pins is not None and len(pins.t_s):
        some = _thin(len(pins.t_s))
        ax.plot(pins.q[some, first], pins.q[some, second], color=PIN_COLOUR, lw=0.35, zorder=3, label="simulated pins")
        ax.legend(loc="lower right", fontsize=8, frameon=False)
    ax.set_aspect("equal")
    ax.autoscale()
    ax.margins(0.04)
    _labels(ax, f"{planned.axes[first]} mm", f"{planned.axes[second]} mm")
    bar = figure.colorbar(feeds, ax=ax, shrink=0.6, pad=0.01)
    bar.set_label("planned speed, mm/s", fontsize=8)
    bar.ax.tick_params(labelsize=8)


def _side_view(ax: Axes, planned: PathData, pins: PinData | None) -> None:
    column = planned.axes.index("Z") if "Z" in planned.axes else len(planned.axes) - 1
    keep = _thin(len(planned.t_s))
    ax.plot(planned.t_s[keep], planned.q[keep, column], color="#2a788e", lw=1.4)
    if pins is not None and len(pins.t_s):
        some = _thin(len(pins.t_s))
        ax.plot(pins.t_s[some], pins.q[some, column], color=PIN_COLOUR, lw=0.5)
    _labels(ax, "", f"{planned.axes[column]} mm")


def _speed_plot(ax: Axes, planned: PathData) -> None:
    keep = _thin(len(planned.t_s))
    for number, axis in enumerate(planned.axes[:3]):
        ax.plot(planned.t_s[keep], planned.v[keep, number], lw=0.7, label=axis)
    ax.legend(loc="upper right", fontsize=7, frameon=False, ncol=3)
    _labels(ax, "", "velocity, mm/s")


def _last_plot(ax: Axes, planned: PathData, pins: PinData | None) -> None:
    """Of a run, how far each pulse is from where its axes should be at that instant; else the path's speed."""
    if pins is None or not len(pins.t_s):
        keep = _thin(len(planned.t_s))
        ax.plot(planned.t_s[keep], np.linalg.norm(planned.v[keep], axis=1), color="#2a788e", lw=0.8)
        _labels(ax, "time, s", "speed, mm/s")
        return
    error = np.zeros(len(pins.t_s))
    for column in range(len(planned.axes)):
        error += (pins.q[:, column] - np.interp(pins.t_s, planned.t_s, planned.q[:, column])) ** 2
    t_s, worst = _envelope(pins.t_s, 1e3 * np.sqrt(error))
    ax.fill_between(t_s, worst, color="#c44e52", alpha=0.8, lw=0, step="mid")
    ax.set_ylim(bottom=0)
    _labels(ax, "time, s", "distance behind, um")


def _envelope(t_s: F8, values: F8, bins: int = 600) -> tuple[F8, F8]:
    """Greatest value in each of ``bins`` equal stretches of time."""
    edges = np.linspace(t_s[0], t_s[-1] + 1e-9, bins + 1)
    index = np.clip(np.searchsorted(edges, t_s, side="right") - 1, 0, bins - 1)
    worst = np.zeros(bins)
    np.maximum.at(worst, index, values)
    return 0.5 * (edges[:-1] + edges[1:]), worst


def _labels(ax: Any, x: str, y: str) -> None:
    ax.set_xlabel(x, fontsize=8)
    ax.set_ylabel(y, fontsize=8)
    ax.tick_params(labelsize=8)
    ax.grid(color="#e6e8eb", lw=0.6, zorder=0)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
