"""What is asked of the shafts of PIC-SERVOs: how far from their planned places they may be, and where they must end.

Commands are judged to the step. Behind them a shaft follows, late and a little beside: that is the loop's doing and
differs from machine to machine, so its bound is wide. It is there to find the axis that does not follow at all. It is
taken along each axis, at equal times: a shaft that is stuck where the path passed a moment ago is on the path still.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from machines.schema import MachineConfig
from machines.wiring import servo_tables
from sim.compare import Reference
from sim.trace import Trace

FOLLOWS_WITHIN_S = 0.010
"""A shaft that follows is never further off than its axis goes in this time at its greatest velocity."""
UM_PER_UNIT = 1000.0


@dataclass(frozen=True, slots=True)
class ShaftUse:
    """Shafts of a run against the plan, by motor.

    end_counts: where each came to rest beside its place. stands_within: how many counts that may be. off_um: how far
    each was from where the plan had it at that instant, at most; empty on a port, which does not tell. limit_um: how
    far that may be.
    """

    end_counts: dict[str, int]
    stands_within: int
    off_um: dict[str, float]
    limit_um: dict[str, float]


def shaft_limits_um(config: MachineConfig) -> dict[str, float]:
    """``shaft_um`` of ``[verify]`` for every servo; without it, what its axis goes in ``FOLLOWS_WITHIN_S``.

    No more than its position error limit, at which its chip lets go.
    """
    given = config.verify.shaft_um
    found = {}
    for name, (axis, table) in servo_tables(config).items():
        goes = config.axis[axis].max_velocity * FOLLOWS_WITHIN_S
        holds = table.servo.position_error_limit / abs(table.counts_per_unit)
        found[name] = UM_PER_UNIT * min(goes, holds) if given is None else given
    return found


def shafts_off_um(trace: Trace, config: MachineConfig, reference: Reference) -> dict[str, float]:
    """By servo, the greatest distance of its shaft from where the plan had it at that instant, after t = 0."""
    found = {}
    for name, (axis, table) in servo_tables(config).items():
        mine = (trace.servo_axis == trace.axes.index(name)) & (trace.servo_ns >= trace.plan_start_ns)
        time_s = (trace.servo_ns[mine] - trace.plan_start_ns) * 1e-9
        planned = np.interp(time_s, reference.t_s, reference.q[:, reference.axes.index(axis)])
        off = np.abs(trace.servo_position[mine] / table.counts_per_unit - planned)
        found[name] = UM_PER_UNIT * float(off.max(initial=0.0))
    return found


def reasons_of_shafts(use: ShaftUse) -> list[str]:
    """Every reason of the shafts to call a run bad, in words."""
    found = [
        f"the shaft of {name} ends {off:+d} counts from its place, more than {use.stands_within}"
        for name, off in use.end_counts.items()
        if abs(off) > use.stands_within
    ]
    for name, off_um in use.off_um.items():
        if off_um > use.limit_um[name]:
            found.append(f"the shaft of {name} was {off_um:.0f} um from its place, more than {use.limit_um[name]:g}")
    return found


def words_of_shafts(use: ShaftUse) -> str:
    """What was judged of the shafts, for a run that is good."""
    most = max(map(abs, use.end_counts.values()), default=0)
    ends = f"every shaft ended within {most} count{'' if most == 1 else 's'} of its place"
    return f"{ends} and was at most {max(use.off_um.values()):.0f} um from it before" if use.off_um else ends


def end_counts(positions: Mapping[str, int], wanted: Mapping[str, int]) -> dict[str, int]:
    """How far each shaft stands from where the plan ends, counts by motor."""
    return {name: position - wanted[name] for name, position in positions.items()}
