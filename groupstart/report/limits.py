"""``--fail-over contour_um=20,late_slices=0``: what a run may show at most, for scripts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from machines.verdict import Verdict

Read = Callable[[Verdict], float | None]
FIELDS: dict[str, Read] = {
    "contour_um": lambda v: None if v.contour_um is None else v.contour_um.max,
    "contour_um_p999": lambda v: None if v.contour_um is None else v.contour_um.p999,
    "contour_steps": lambda v: None if v.contour_steps is None else v.contour_steps.max,
    "motor_contour_um": lambda v: None if v.motor_contour_um is None else v.motor_contour_um.max,
    "program_um": lambda v: v.program_um,
    "lag_ms": lambda v: None if v.lag_ms is None else v.lag_ms[0],
    "lag_axis_ms": lambda v: None if v.lags is None else max(lag.max_ms for lag in v.lags.motors.values()),
    "shaft_um": lambda v: None if v.shafts is None else max(v.shafts.off_um.values(), default=None),
    "shaft_program_um": lambda v: v.shaft_program_um,
    "shaft_lag_ms": lambda v: None if v.shaft_lags is None else v.shaft_lags.max_ms,
    "end_error_steps": lambda v: float(max((abs(n) for n in v.end_error_steps.values()), default=0)),
    "late_slices": lambda v: float(v.late_slices),
    "violations": lambda v: float(sum(v.violations.values())),
    "utilisation": lambda v: v.bus.utilisation,
    "time_percent": lambda v: (
        None if v.sim_time_s is None or not v.plan_time_s else 100 * abs(v.sim_time_s / v.plan_time_s - 1)
    ),
    "plan_time_s": lambda v: v.plan_time_s,
}
"""Names that may stand before the equals sign, and where the verdict has them."""


def parse_limits(text: str) -> dict[str, float]:
    """The limits of an option's text. Raises ValueError in words for the user."""
    found: dict[str, float] = {}
    for part in filter(None, (item.strip() for item in text.split(","))):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or name not in FIELDS:
            raise ValueError(f"{part!r}: give NAME=NUMBER with a name out of {', '.join(FIELDS)}")
        try:
            found[name] = float(value)
        except ValueError:
            raise ValueError(f"{part!r}: {value!r} is not a number") from None
    return found


def broken_limits(verdict: Verdict, limits: Mapping[str, float]) -> tuple[str, ...]:
    """A reason in words for every limit that a verdict is over; what is not known breaks no limit."""
    found = []
    for name, most in limits.items():
        value = FIELDS[name](verdict)
        if value is not None and value > most:
            found.append(f"{name} {value:.4g} is over {most:g}")
    return tuple(found)


def field_values(verdict: Verdict) -> dict[str, Any]:
    """Every field by name, None where it is not known."""
    return {name: read(verdict) for name, read in FIELDS.items()}
