"""What is left of the stock: a height map of the planned cut and of the one that the simulated pins would make.

The tool is a flat end; its diameter comes from the tool table where the program's tool is in it. The difference of
the two maps is what the error does to the part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from groupstart.report.measured import Measured
from planner.types import F8

CELLS = 360
DEFAULT_DIAMETER_MM = 3.0
FLAT_UM, WALL_UM = 0.05, 60.0


@dataclass(frozen=True, slots=True, eq=False)
class HeightMap:
    """planned, simulated f8[rows, columns] in mm, rows along +Y; cell_mm, low: corner of the map; top_mm: the stock."""

    planned: F8
    simulated: F8
    low: tuple[float, float]
    cell_mm: float
    top_mm: float
    diameter_mm: float

    @property
    def difference_um(self) -> F8:
        """Simulated over planned: above 0 material was left, below 0 too much was cut."""
        return np.asarray(1e3 * (self.simulated - self.planned))

    @property
    def left_mm3(self) -> float:
        """Volume that the simulated cut leaves standing."""
        return float(np.maximum(self.simulated - self.planned, 0.0).sum() * self.cell_mm**2)

    @property
    def excess_mm3(self) -> float:
        """Volume that it cuts away beyond the plan."""
        return float(np.maximum(self.planned - self.simulated, 0.0).sum() * self.cell_mm**2)

    @property
    def typical_um(self) -> float:
        """Nine of ten floors that differ do by at most this; walls, where whole depths differ, do not count."""
        off = np.abs(self.difference_um)
        floors = off[(off > FLAT_UM) & (off < WALL_UM)]
        return float(np.quantile(floors, 0.9)) if len(floors) else 0.0


def height_maps(
    m: Measured, planned_q: F8, cutting: F8, diameter_mm: float, surface_mm: float = 0.0
) -> HeightMap | None:
    """Both maps, or None if nothing is cut: no X, Y, Z, or no feed goes down.

    planned_q f8[N, A]: the planned path; cutting f8[C, A]: places of it that lie on feeds, for the size of the map.
    surface_mm: top of the stock, if the program goes above and below it (its own Z zero is a good guess).
    """
    if not set("XYZ") <= set(m.axes) or not len(cutting):
        return None
    columns = [m.axes.index(axis) for axis in "XYZ"]
    reach = cutting[:, columns]
    radius = diameter_mm / 2
    low, high = reach.min(axis=0) - radius, reach.max(axis=0) + radius
    lowest, highest = float(reach[:, 2].min()), float(planned_q[:, columns[2]].max())
    if lowest >= highest - 1e-6:
        return None
    top = surface_mm if lowest < surface_mm <= highest else highest
    cell = float(max(high[0] - low[0], high[1] - low[1]) / CELLS)
    shape = (max(int(np.ceil((high[1] - low[1]) / cell)), 1), max(int(np.ceil((high[0] - low[0]) / cell)), 1))
    found = []
    for path in (planned_q, m.q):
        found.append(_cut(np.full(shape, top), path[:, columns], (low[0], low[1]), cell, radius))
    return HeightMap(found[0], found[1], (float(low[0]), float(low[1])), cell, top, diameter_mm)


def _cut(height: F8, path: F8, low: tuple[float, float], cell: float, radius: float) -> F8:
    from groupstart.report.zmap_kernel import cut

    cut(height, np.ascontiguousarray(path), float(low[0]), float(low[1]), cell, radius)
    return height
