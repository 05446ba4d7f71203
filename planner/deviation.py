"""Deviation of the path from the program, by cause."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.polygon import Polygon


@dataclass(frozen=True, slots=True)
class Deviation:
    """Largest deviation in mm by cause: merged moves, blended corners, arcs by parabolas, jerk filter; and their sum.

    measured_mm: largest distance of the sampled trajectory from the program, or of a programmed vertex from the
    trajectory; None where it was not asked for.
    """

    merge_mm: float = 0.0
    blend_mm: float = 0.0
    chord_mm: float = 0.0
    filter_mm: float = 0.0
    measured_mm: float | None = None

    @property
    def sum_mm(self) -> float:
        """All causes together, as if all were largest at one place."""
        return self.merge_mm + self.blend_mm + self.chord_mm + self.filter_mm

    def worst(self, other: Deviation) -> Deviation:
        """The larger of both, cause by cause."""
        return Deviation(
            max(self.merge_mm, other.merge_mm),
            max(self.blend_mm, other.blend_mm),
            max(self.chord_mm, other.chord_mm),
            max(self.filter_mm, other.filter_mm),
        )


def deviation_of(polygon: Polygon, vertices: slice) -> Deviation:
    """What blends and arcs use of the tolerance at the ``vertices``.

    A parabola of leg l and half turn phi inside a circle of radius l / tan(phi) leaves it by l phi^3 / 8.
    """
    miss, inner = polygon.miss_mm[vertices], polygon.inner[vertices]
    half = polygon.turn[vertices][inner] / 2
    chord = polygon.leg[vertices][inner] * half**3 / 8
    return Deviation(blend_mm=float(miss.max(initial=0.0)), chord_mm=float(np.max(chord, initial=0.0)))
