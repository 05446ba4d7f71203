"""The verdict of a run: planned against simulated, in the fields that ``verify --json`` prints.

On the simulated machine everything is known; on a port only what the chips tell (end positions, bus and late slices).
What is not known is None, and is left out of the judgement.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from machines.lags import LagUse, lag_fields
from machines.ratecontrol import HoldRecord
from machines.schema import VerifyTable
from machines.shafts import ShaftUse, reasons_of_shafts


@dataclass(frozen=True, slots=True)
class Spread:
    """Largest value, 99.9 % quantile and root mean square."""

    max: float
    p999: float
    rms: float


@dataclass(frozen=True, slots=True)
class BusUse:
    """Packets sent, bytes both ways, share of the run in which an exchange was under way.

    ``slice_ms``: mean time between two loads of one motor.
    """

    packets: int
    bytes: int
    utilisation: float
    slice_ms: float


@dataclass(frozen=True, slots=True)
class HostUse:
    """What was measured of the host while it ran.

    delay_p99_ms, delay_max_ms: what host and module added to the bytes of an exchange. late_exchanges: exchanges that
    left late. least_speed_percent: below 100 the motion was slowed for host or bus. unheeded: why it could not be.
    strain_steps: how far from the path, at most, the host believed the axes to be when it looked, steps or counts; None
    if it did not.
    """

    delay_p99_ms: float
    delay_max_ms: float
    late_exchanges: int
    least_speed_percent: float
    unheeded: str = ""
    strain_steps: float | None = None


@dataclass(frozen=True, slots=True)
class OutputUse:
    """Spindle, coolant and outputs: how many pins were switched, and how far that was from the planned instants, ms.

    On the twin as the pins changed; on a port as the commands left.
    """

    changes: int
    off_ms_max: float
    off_ms_rms: float


@dataclass(frozen=True, slots=True)
class Peak:
    """Greatest velocity, acceleration and jerk that an axis was asked for (mm/s, mm/s2, mm/s3; deg on rotary axes)."""

    velocity: float
    acceleration: float
    jerk: float | None


@dataclass(frozen=True, slots=True)
class Verdict:
    """All that is known of a finished run. Times s, lengths um or steps as named; None: not known on this machine."""

    ok: bool
    machine: str
    axes: tuple[str, ...]
    plan_time_s: float
    sim_time_s: float | None
    contour_um: Spread | None
    contour_steps: Spread | None
    motor_contour_um: Spread | None
    program_um: float | None
    lag_ms: tuple[float, float] | None
    end_error_steps: dict[str, int]
    worst_line: int | None
    late_slices: int
    violations: dict[str, int]
    bus: BusUse
    peak: dict[str, Peak]
    limits: dict[str, Peak]
    reasons: tuple[str, ...] = field(default=())
    holds: tuple[HoldRecord, ...] = ()
    host: HostUse | None = None
    outputs: OutputUse | None = None
    profiles: dict[str, str] = field(default_factory=dict)
    """How each bus was fed, by its name."""
    profile_notes: tuple[str, ...] = ()
    """Why these, where that is not plain."""
    bus_notes: tuple[str, ...] = ()
    """What was changed in the plan for a bus that is too slow for it."""
    warnings: tuple[str, ...] = ()
    """What is no reason against the run, but should be known."""
    shafts: ShaftUse | None = None
    lags: LagUse | None = None
    shaft_lags: LagUse | None = None
    shaft_program_um: float | None = None

    def as_json(self) -> dict[str, Any]:
        """The fields as ``verify --json`` prints them."""
        data = asdict(replace(self, lags=None, shaft_lags=None))  # of a long program, a great many lines
        data["axes"] = list(self.axes)
        data["reasons"] = list(self.reasons)
        data["profile_notes"] = list(self.profile_notes)
        data["bus_notes"] = list(self.bus_notes)
        data["warnings"] = list(self.warnings)
        if self.motor_contour_um is None:
            del data["motor_contour_um"]  # steppers have no shaft of their own
        data["holds"] = list(data["holds"])
        if self.outputs is None:
            del data["outputs"]  # it has none
        for name in ("shafts", "lags", "shaft_lags", "shaft_program_um"):
            del data[name]
        if self.shafts is not None:
            data["shaft_end_counts"] = dict(self.shafts.end_counts)
            data["shaft_off_um"] = dict(self.shafts.off_um)
            data["shaft_limit_um"] = dict(self.shafts.limit_um)
        data["program_um"] = None if self.program_um is None else {"max": self.program_um}
        data["lag_ms"] = None if self.lag_ms is None else {"max": self.lag_ms[0], "rms": self.lag_ms[1]}
        data |= lag_fields(self.lags, "")
        if self.shaft_lags is not None:
            data["shaft_lag_ms"] = {"max": self.shaft_lags.max_ms, "rms": self.shaft_lags.rms_ms}
        data |= lag_fields(self.shaft_lags, "shaft_")
        if self.shaft_program_um is not None:
            data["shaft_program_um"] = {"max": self.shaft_program_um}
        return data


def reasons_against(
    rule: VerifyTable,
    *,
    plan_time_s: float,
    sim_time_s: float | None,
    contour_steps: Spread | None,
    end_error_steps: Mapping[str, int],
    violations: Mapping[str, int],
    unheeded: str = "",
    shafts: ShaftUse | None = None,
) -> tuple[str, ...]:
    """Every reason to call a run bad, in words; none: the run is good."""
    found: list[str] = []
    for axis, error in end_error_steps.items():
        if abs(error) > rule.end_error_steps:
            found.append(f"{axis} ends {error:+d} steps off")
    if contour_steps is not None and contour_steps.max > rule.contour_steps:
        found.append(f"contour error {contour_steps.max:.2f} steps, more than {rule.contour_steps:g}")
    if shafts is not None:
        found += reasons_of_shafts(shafts)
    if sim_time_s is not None and plan_time_s > 0:
        percent = 100 * abs(sim_time_s - plan_time_s) / plan_time_s
        if percent > rule.time_percent and abs(sim_time_s - plan_time_s) > rule.time_slack_s:
            found.append(f"simulated time differs by {percent:.2f} % from the planned one")
    for name, count in violations.items():
        found.append(f"{count} violation{'s' if count > 1 else ''} of {name}")
    if unheeded:
        found.append(f"the host was slower than assumed and the motion was not slowed: {unheeded}")
    return tuple(found)
