"""G5, G5.1, G5.2: rational B-splines to control points of a chain of parabolas.

The picture: points P_k lie on the curve, nearly equally spaced in length. A chain of parabolas with full legs over
control points V_k passes the vertex at (V_(k-1) + 6 V_k + V_(k+1)) / 8; with V_k = P_k - (P_(k-1) - 2 P_k + P_(k+1))
/ 8 it follows the curve with an error of fourth order in the spacing. Source: L. Piegl, W. Tiller, "The NURBS Book",
chapters 2 and 4 (knots, rational curves); LinuxCNC's G5.2 for the clamped uniform knot vector.
"""

from __future__ import annotations

import numpy as np

from gcode.canon import Nurbs
from planner.errors import PlanError
from planner.types import F8

CHORD_MM = 1e-4
"""largest error of the chain; the first spacing is one whose chords leave the curve by 20 times this."""
TURN_RAD = 0.1
"""and so that neighbouring chords turn by at most this."""
FEWEST, MOST = 8, 20_000


def knots_of(points: int, order: int) -> F8:
    """Clamped uniform knot vector f8[points + order]."""
    inner = np.arange(1, points - order + 1, dtype=np.float64)
    return np.concatenate([np.zeros(order), inner, np.full(order, points - order + 1.0)])


def evaluate(control: F8, order: int, u: F8) -> F8:
    """Points f8[len(u), 2] of the curve of ``control`` f8[n, 3] (x, y, weight) at parameters in [0, n - order + 1]."""
    n = len(control)
    knots = knots_of(n, order)
    span = np.clip(np.searchsorted(knots, u, side="right") - 1, order - 1, n - 1)
    homogeneous = np.column_stack([control[:, :2] * control[:, 2:], control[:, 2]])
    d = homogeneous[span[:, None] + np.arange(-order + 1, 1)[None, :]]
    for r in range(1, order):  # de Boor
        for j in range(order - 1, r - 1, -1):
            left = knots[span + j - order + 1]
            right = knots[span + j + 1 - r]
            alpha = ((u - left) / (right - left))[:, None]
            d[:, j] = (1 - alpha) * d[:, j - 1] + alpha * d[:, j]
    out = d[:, order - 1]
    return np.asarray(out[:, :2] / out[:, 2:])


def polyline(spline: Nurbs, start: tuple[float, float]) -> F8:
    """Control points f8[n, 2] of the parabola chain, without the start, ending on the spline's end. Raises
    PlanError."""
    control = np.array(spline.points, dtype=np.float64)
    if len(control) < spline.order or spline.order < 2:
        raise PlanError(spline.line, "", f"a spline of order {spline.order} needs at least as many control points")
    if (control[:, 2] <= 0).any():
        raise PlanError(spline.line, "", "spline weights must be positive")
    if np.hypot(*(control[0, :2] - start)) > 1e-3:
        raise PlanError(spline.line, "", "a spline must begin at the current position")
    if spline.order == 2:
        return np.asarray(control[1:, :2])
    fine = np.linspace(0.0, len(control) - spline.order + 1.0, 64 * len(control) + 1)
    p = evaluate(control, spline.order, fine)
    chord = np.diff(p, axis=0)
    length = np.hypot(chord[:, 0], chord[:, 1])
    s = np.concatenate([[0.0], np.cumsum(length)])
    if s[-1] < 1e-6:
        return p[-1:]
    turn = np.abs(np.arctan2(_cross(chord[:-1], chord[1:]), (chord[:-1] * chord[1:]).sum(axis=1)))
    curvature = turn / np.maximum((length[:-1] + length[1:]) / 2, 1e-12)
    tight = float(np.percentile(curvature, 98)) + 1e-12
    spacing = min(np.sqrt(160 * CHORD_MM / tight), TURN_RAD / tight, s[-1] / FEWEST)
    n = int(min(np.ceil(s[-1] / spacing), MOST))
    while True:
        u = np.interp(np.linspace(0.0, s[-1], n + 1), s, fine)
        chain = chain_of(evaluate(control, spline.order, u))
        middle = np.interp((np.arange(n) + 0.5) * (s[-1] / n), s, fine)
        if n >= MOST or _error(chain, evaluate(control, spline.order, middle)) <= CHORD_MM:
            return chain[1:]
        n = min(2 * n, MOST)


def chain_of(on_curve: F8) -> F8:
    """Control points whose parabolas pass near ``on_curve`` f8[n + 1, 2]."""
    out = on_curve.copy()
    out[1:-1] -= (on_curve[:-2] - 2 * on_curve[1:-1] + on_curve[2:]) / 8
    return out


def _error(chain: F8, on_curve: F8) -> float:
    """Largest distance across the path of the joints of two parabolas from the curve at the same length, but the
    ends."""
    edge = np.diff(chain, axis=0)
    off = (chain[:-1] + chain[1:]) / 2 - on_curve
    across = np.abs(_cross(edge, off)) / np.maximum(np.hypot(edge[:, 0], edge[:, 1]), 1e-12)
    return float(across[1:-1].max(initial=0.0))


def _cross(a: F8, b: F8) -> F8:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
