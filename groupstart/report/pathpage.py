"""What every page shows of a plan: path in two levels of detail, program text, passes of lines, bounds, facts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcode.canon import AXES, ORIGIN, Position
from groupstart.report.blocks import Block, json_block, text_block
from groupstart.report.pathcolumns import FEED, RAPID, REST, PathColumns, Stretches, thinned
from machines.job import Job
from machines.load import MachineFile
from planner.types import F8

FIRST_SAMPLES, MOST_SAMPLES = 40_000, 300_000
"""samples of the first picture, and of the finer one that follows"""
MOST_PASSES = 2_000_000
PLACE_MM, SPEED_MM_S, TIME_S = 2e-4, 1e-3, 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class PageInput:
    """A planned job, ready to draw. ``facts``: rows of name and value for the side of the page.

    zero: place of the program's zero in machine mm, in the order of ``gcode.canon.AXES``.
    """

    job: Job
    machine: MachineFile
    columns: PathColumns
    facts: list[tuple[str, str]]
    zero: Position = ORIGIN


def coarse_and_fine(stretches: Stretches, tolerance_mm: float) -> tuple[Stretches, Stretches | None]:
    """The path for the first picture, and the finer one if that is not the same."""
    if len(stretches) <= 2 * FIRST_SAMPLES:
        return stretches, None
    coarse, tolerance_mm_s = stretches, 0.5
    while len(coarse) > FIRST_SAMPLES:
        tolerance_mm, tolerance_mm_s = 2 * tolerance_mm, 2 * tolerance_mm_s
        coarse = thinned(coarse, tolerance_mm, tolerance_mm_s)
    return coarse, stretches


def path_blocks(source: PageInput, extra: Mapping[str, Any], over_path: OverPath | None = None) -> Iterator[str]:
    """The blocks of the page; ``extra``: further fields of its JSON; ``over_path``: quantities of each stretch."""
    coarse, fine = coarse_and_fine(source.columns.stretches, source.columns.tolerance_mm)
    yield json_block("page", {**page_fields(source, fine or coarse), **extra})
    yield path_block("path0", coarse, over_path).html()
    if fine is not None:
        yield path_block("path1", fine, over_path).html()
    yield passes_block(source.columns).html()
    yield text_block("program-text", source.job.text)


class OverPath:
    """A quantity measured along the time of the plan, to be laid over stretches: the largest within each."""

    def __init__(self, names: tuple[str, ...], t_s: F8, values: F8, units: tuple[float, ...]) -> None:
        order = np.argsort(t_s, kind="stable")
        self.names, self.units = names, units
        self._t_s, self._values = t_s[order], values[order]

    def over(self, stretches: Stretches) -> dict[str, F8]:
        """Each quantity f8[N - 1], 0 where nothing was measured."""
        first = np.searchsorted(self._t_s, stretches.t_s[:-1], side="left")
        last = np.searchsorted(self._t_s, stretches.t_s[1:], side="right")
        found: dict[str, F8] = {}
        for k, name in enumerate(self.names):
            values = np.append(self._values[:, k], 0.0)
            edges = np.empty(2 * len(first), np.int64)
            edges[0::2], edges[1::2] = first, np.maximum(last, first)
            largest = np.maximum.reduceat(values, np.minimum(edges, len(values) - 1))[0::2] if len(first) else values
            found[name] = np.where(last > first, largest, 0.0)
        return found


def path_block(name: str, s: Stretches, over_path: OverPath | None = None) -> Block:
    """The columns of a path."""
    block = Block(name)
    block.add("t", s.t_s, TIME_S)
    block.columns("q", s.q, PLACE_MM)
    block.columns("v", s.v, SPEED_MM_S)
    block.add("feed", s.feed_mm_s, 1e-4)
    block.add("accel", s.accel_mm_s2, 0.1)
    block.add("jerk", s.jerk_mm_s3, 1.0)
    for column in ("line", "tool", "kind", "cause"):
        block.add(column, getattr(s, column))
    if over_path is not None:
        for (column, values), unit in zip(over_path.over(s).items(), over_path.units, strict=True):
            block.add(column, values, unit)
    return block


def passes_block(columns: PathColumns) -> Block:
    """When the program comes to which line; of endless loops every n-th."""
    every = max(1, -(-len(columns.pass_s) // MOST_PASSES))
    block = Block("passes")
    block.add("pass_s", columns.pass_s[::every], TIME_S)
    block.add("pass_line", columns.pass_line[::every])
    return block


def page_fields(source: PageInput, finest: Stretches) -> dict[str, Any]:
    """The JSON that describes a page."""
    columns, config = source.columns, source.machine.config
    axes = columns.axes
    xyz = [axes.index(axis) if axis in axes else -1 for axis in "XYZ"]
    travel = {axis: config.axis[axis].travel for axis in axes}
    low, high = (_place(values, xyz) for values in (columns.low, columns.high))
    zero = [float(source.zero[AXES.index(axis)]) for axis in "XYZ"]
    ends = [[travel[a][side] if (a := "XYZ"[k]) in travel else 0.0 for k in range(3)] for side in (0, 1)]
    return {
        "job": source.job.name.rsplit("/", 1)[-1],
        "subtitle": f"on {config.machine.name}",
        "axes": list(axes),
        "linear": [k for k, axis in enumerate(axes) if axis not in "ABC"],
        "xyz": xyz,
        "duration_s": columns.duration_s,
        "low": low,
        "high": high,
        "floor": min(low[2], 0.0) if low[2] > -50 else low[2],
        "travel": ends,
        "work_zero": zero,
        "causes": list(columns.causes),
        "tools": sorted({int(tool) for tool in np.unique(finest.tool)}),
        "has_jerk": bool(np.any(finest.jerk_mm_s3 > 0)),
        "bounds": [
            {"axis": axis, "least": float(columns.low[k]), "greatest": float(columns.high[k]), "travel": travel[axis]}
            for k, axis in enumerate(axes)
        ],
        "facts": [list(row) for row in source.facts],
    }


def path_facts(columns: PathColumns, text: str) -> list[tuple[str, str]]:
    """What is told of the plan beside the picture."""
    s = columns.stretches
    span, step = np.diff(s.t_s), np.linalg.norm(np.diff(s.q, axis=0), axis=1)
    feeds = np.unique(s.feed_mm_s[s.kind == FEED])
    rows = [
        ("lines", f"{text.count(chr(10)) + (not text.endswith(chr(10))):,}"),
        ("time", f"{columns.duration_s:.3f} s"),
    ]
    for name, kind in (("cutting", FEED), ("rapids", RAPID)):
        mine = s.kind == kind
        rows.append((name, f"{span[mine].sum():.1f} s, {step[mine].sum():,.0f} mm"))
    rows.append(("at rest", f"{span[s.kind == REST].sum():.1f} s"))
    if len(feeds):
        rows.append(("feeds", f"{feeds[0]:.4g} … {feeds[-1]:.4g} mm/s" if len(feeds) > 1 else f"{feeds[0]:.4g} mm/s"))
    rows.append(("drawn", f"{len(s):,} points, within {1e3 * columns.tolerance_mm:.3g} um"))
    return rows


def _place(values: F8, xyz: list[int]) -> list[float]:
    return [float(values[k]) if k >= 0 else 0.0 for k in xyz]
