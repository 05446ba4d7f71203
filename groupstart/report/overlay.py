"""Two motions over each other as one page: the first in colours of the distance, the second as a white line.

It is the page of a verify run with another second motion: not the pins, but the plan of the other program or machine.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from groupstart.report.compose import compose
from groupstart.report.measured import Measured, WorstPlace
from groupstart.report.pathcolumns import PathColumns
from groupstart.report.pathpage import OverPath, PageInput, path_blocks, path_facts
from groupstart.report.verifypage import error_block, histograms, sim_block
from machines.job import Job
from machines.load import MachineFile


@dataclass(frozen=True, slots=True, eq=False)
class OverlayInput:
    """What the page shows. columns: of the first motion; other: the second, measured against the first.

    differences: one a line, none if both are the same; rows: name and value for the side.
    """

    job: Job
    machine: MachineFile
    columns: PathColumns
    other: Measured
    worst: Sequence[WorstPlace]
    differences: Sequence[str]
    rows: Sequence[tuple[str, str]]
    subtitle: str


def overlay_page(source: OverlayInput) -> str:
    """The page as HTML."""
    page = PageInput(source.job, source.machine, source.columns, path_facts(source.columns, source.job.text))
    return compose(f"{source.job.name}: compared – groupstart", _blocks(source, page))


def _blocks(source: OverlayInput, page: PageInput) -> Iterator[str]:
    m = source.other
    extra: dict[str, Any] = {
        "report": True,
        "overlay": True,
        "first_tab": "error",
        "subtitle": source.subtitle,
        "ok": not source.differences,
        "reasons": list(source.differences)[:60],
        "verdict_rows": [list(row) for row in source.rows],
        "violations": [],
        "digests": [],
        "seed": 0,
        "worst": [asdict(place) for place in source.worst],
        "shifts": [],
        "zmap": None,
        "bus": None,
        "servos": [],
        "rates": [],
        **histograms(m),
    }
    values = np.column_stack([m.error_um, np.abs(m.lag_ms)])
    yield from path_blocks(page, extra, OverPath(("error", "lag"), m.nearest_s, values, (1e-3, 1e-3)))
    yield sim_block(m).html()
    yield error_block(m, source.columns.duration_s).html()
