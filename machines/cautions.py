"""What a verdict warns of: a bus too slow for its plan or for the one made for it, axes off the path, late slices."""

from __future__ import annotations

from machines.busload import Load
from machines.verdict import Verdict

LATE_MANY = 20
LATE_PER_S = 1.0
"""So many late slices, and more a second than this, are told in words."""


def cautions(verdict: Verdict, load: Load | None, allowed_steps: float) -> tuple[str, ...]:
    """Warnings in words.

    load: what was estimated of the buses. On the twin the measured contour knows better; on a port what the host
    believed is all that is known, and more than ``allowed_steps`` of it is told.
    """
    found = []
    contour = verdict.contour_steps
    known_good = contour is not None and contour.max <= allowed_steps
    if load is not None and not known_good:
        found.append(load.words())
    if load is None and verdict.bus_notes and contour is not None and not known_good:
        found.append(
            "the bus could follow even less than was estimated: lower accelerations in the machine file would do"
        )
    host = verdict.host
    strain = host.strain_steps if host is not None else None
    if contour is None and host is not None and strain is not None and strain > allowed_steps:
        found.append(
            f"the axes were off the path by about {strain:.0f} steps or counts, by what the host knows "
            f"(contour_steps allows {allowed_steps:g}); slowed to {host.least_speed_percent:.0f} %"
        )
    late, time_s = verdict.late_slices, max(verdict.plan_time_s, 1e-9)
    if late >= LATE_MANY and late / time_s > LATE_PER_S and not known_good:
        cost = "is in the contour error" if verdict.contour_steps is not None else "was not measured"
        many = f"{late} slices began late, {late / time_s:.0f} a second"
        found.append(f"{many}: what they need had not been said in time; what that cost {cost}")
    return tuple(found)
