"""Lag in the verdict: along the path, of each motor along its own axis, and in each line; never mixed with shape."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from sim.compare import Contour


@dataclass(frozen=True, slots=True)
class MotorLag:
    """How late one motor was along its own axis, ms without sign, and the line in which it was so most."""

    max_ms: float
    rms_ms: float
    worst_line: int


@dataclass(frozen=True, slots=True)
class LagUse:
    """Lag of commands or of shafts, ms without sign.

    max_ms, rms_ms: along the path. motors: by name. lines: by number the greatest lag along the path, then that of each
    motor in the order of ``motors``.
    """

    max_ms: float
    rms_ms: float
    motors: dict[str, MotorLag]
    lines: dict[int, tuple[float, ...]]

    @property
    def worst_line(self) -> int:
        """The line in which the pins were latest along the path; 0 if nothing moved."""
        return max(self.lines, key=lambda line: self.lines[line][0], default=0)

    @property
    def worst_motor(self) -> str:
        """The motor that was latest along its own axis."""
        return max(self.motors, key=lambda name: self.motors[name].max_ms)


def lag_use(contour: Contour) -> LagUse:
    """What a comparison found of lag."""
    lags = contour.lags
    motors = {}
    for m, name in enumerate(lags.motors):
        line = int(lags.lines[np.argmax(lags.motor_ms[:, m])]) if len(lags.lines) else 0
        motors[name] = MotorLag(float(lags.max_ms[m]), float(lags.rms_ms[m]), line)
    rows = np.column_stack([lags.path_ms, lags.motor_ms]).tolist()
    lines = {line: tuple(row) for line, row in zip(lags.lines.tolist(), rows, strict=True)}
    return LagUse(contour.lag_ms_max, contour.lag_ms_rms, motors, lines)


def lag_fields(use: LagUse | None, prefix: str) -> Iterator[tuple[str, Any]]:
    """Fields of the verdict: by motor, and the worst line."""
    if use is None:
        return
    axes = {
        name: {"max": lag.max_ms, "rms": lag.rms_ms, "worst_line": lag.worst_line} for name, lag in use.motors.items()
    }
    yield f"{prefix}lag_axis_ms", axes
    worst = use.worst_line
    yield f"{prefix}lag_worst_line", {"line": worst, "ms": use.lines[worst][0] if use.lines else 0.0}


def by_line(use: LagUse) -> dict[int, dict[str, float]]:
    """For reports: line to the greatest lag along the ``path`` and of each motor in it, ms."""
    names = ("path", *use.motors)
    return {line: {name: round(ms, 3) for name, ms in zip(names, row, strict=True)} for line, row in use.lines.items()}
