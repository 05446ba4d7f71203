"""Arcs in a plane that is no plane of the machine (G18, G19 under a rotation of XY) as control points of a parabola
chain."""

from __future__ import annotations

import numpy as np

from gcode.canon import TiltedArc
from planner.arcs import PLANE_AXES
from planner.errors import PlanError
from planner.nurbs import chain_of
from planner.types import F8

STEP_RAD = 0.02
"""spacing of the points: the chain leaves a circle of radius r by about r step^4 / 400."""


def control_points(item: TiltedArc, begin: F8, end: F8, axes: tuple[str, ...]) -> F8:
    """Control points f8[n, A] behind ``begin`` f8[A], the last one ``end`` f8[A]. Raises PlanError."""
    missing = next((a for a in "XYZ" if a not in axes), None)
    if missing:
        raise PlanError(item.line, missing, f"an arc moves axis {missing}, but the machine has none")
    xyz = [axes.index(a) for a in "XYZ"]
    turn = np.radians(item.rotation_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1.0]])
    p0, p1 = begin[xyz] @ rotation, end[xyz] @ rotation
    center = np.array(item.center[:3]) @ rotation
    i, j = ("XYZ".index(a) for a in PLANE_AXES[item.plane])
    r0, r1 = (float(np.hypot(p[i] - center[i], p[j] - center[j])) for p in (p0, p1))
    if abs(r1 - r0) > 0.05 or min(r0, r1) < 1e-6:
        raise PlanError(item.line, "", f"arc centre at {r0:.4f} mm from the start and {r1:.4f} mm from the end")
    angle0 = float(np.arctan2(p0[j] - center[j], p0[i] - center[i]))
    sign = float(np.sign(item.turns))
    forward = sign * (float(np.arctan2(p1[j] - center[j], p1[i] - center[i])) - angle0) % (2 * np.pi)
    if forward < 1e-9:
        forward = 2 * np.pi
    sweep = forward + 2 * np.pi * (abs(item.turns) - 1)
    share = np.linspace(0.0, 1.0, max(int(np.ceil(sweep / STEP_RAD)), 8) + 1)
    out = begin + (end - begin) * share[:, None]
    local = p0 + (p1 - p0) * share[:, None]
    angle, radius = angle0 + sign * sweep * share, r0 + (r1 - r0) * share
    local[:, i], local[:, j] = center[i] + radius * np.cos(angle), center[j] + radius * np.sin(angle)
    out[:, xyz] = local @ rotation.T
    out[0], out[-1] = begin, end
    return chain_of(out)[1:]
