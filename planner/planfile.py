"""plan.npz: the planned trajectory as arrays that other tools may rely on."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from planner.types import F8, Trajectory

STEP_S = 1e-3
CLOSEST_S = 1e-9
"""junctions nearer than this are one sample."""


def sample_times(trajectory: Trajectory, step_s: float = STEP_S) -> F8:
    """Ascending times f8[N]: every junction and between them at most ``step_s``; the first 0, the last the end."""
    t = np.asarray(trajectory.junctions_s())
    t = t[np.concatenate([[True], np.diff(t) > CLOSEST_S])]
    gap = np.diff(t)
    parts = np.maximum(np.ceil(gap / (step_s * (1 - 1e-7))), 1).astype(np.intp)
    k = np.repeat(np.arange(len(gap)), parts)
    number = np.arange(len(k)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(t[k] + gap[k] * (number / parts[k]), trajectory.duration_s)


def save_plan(path: str | Path, trajectory: Trajectory) -> None:
    """Write t_s f8[N], q f8[N, A], v f8[N, A], line i4[N] and axes to ``path``."""
    t = sample_times(trajectory)
    with Path(path).open("wb") as file:
        np.savez_compressed(
            file,
            t_s=t,
            q=trajectory.q(t),
            v=trajectory.v(t),
            line=trajectory.line(t),
            axes=np.array(trajectory.axes),
        )
