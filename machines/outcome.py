"""How a run ended, and what it has cost on the buses."""

from __future__ import annotations

from dataclasses import dataclass, field

from machines.outputs_events import Switched
from machines.ratecontrol import HoldRecord


@dataclass(slots=True)
class StreamStatistics:
    """What a run has cost on the buses.

    host_delay_p99_ms, host_delay_max_ms: what host and module have added to the bytes of an exchange. late_exchanges:
    exchanges that left late. least_speed: smallest share of the programmed speed that the bus could carry. unheeded:
    why the motion was not slowed although it should have been. strain_steps: how far from the path, at most, the
    host believed the axes to be when it looked (``machines.strain``), steps or counts; None if it did not.
    """

    packets: int = 0
    bytes: int = 0
    busy_ns: int = 0
    loads: int = 0
    late_slices: int = 0
    slice_ms: float = 0.0
    host_delay_p99_ms: float = 0.0
    host_delay_max_ms: float = 0.0
    late_exchanges: int = 0
    least_speed: float = 1.0
    strain_steps: float | None = None
    unheeded: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended. ``plan_start_ns``: link time of t = 0.

    ``begins_at``, ``positions``: counters of the motors before and after, as read back from their chips. ``holds``:
    every hold, announced and measured. ``retimed``: holds or overrides have changed the times of the trajectory.
    ``commanded``, ``shafts``: by PIC-SERVO, where it was told to stand last, and where its shaft came to rest; counts.
    """

    finished: bool
    plan_start_ns: int
    end_ns: int
    line: int
    positions: dict[str, int]
    begins_at: dict[str, int] = field(default_factory=dict)
    statistics: StreamStatistics = field(default_factory=StreamStatistics)
    holds: tuple[HoldRecord, ...] = ()
    retimed: bool = False
    commanded: dict[str, int] = field(default_factory=dict)
    shafts: dict[str, int] = field(default_factory=dict)
    switched: tuple[Switched, ...] = ()
    """What was said to spindle, coolant and outputs."""
