"""Who takes part in the coming group Start: one change a slice, foreseen one slice before.

A change of group costs Set Addresses, up to two where a leader goes, in which no axis gets a count. So an axis leaves
slices before it ends, not when it must, and it joins when nobody leaves; outside it is led by counts of its own, which
cost the bus the same. The slice that pays for a change knows of it when its periods are chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

from planner.stream_axis import SLOW_PERIOD_NS, StepAxis
from planner.stream_regroup import Groups, regroup

LEAVE_SLICES = 3
"""An axis that may end within so many slices leaves, if nobody else leaves now."""
JOIN_SLICES = 6
"""An axis joins only if it surely runs on for so many."""
BRISK_PERIOD_NS = SLOW_PERIOD_NS * 3 // 4
"""What was slow joins only when it is clearly not any more."""


@dataclass(frozen=True, slots=True)
class Change:
    """The group of a coming Start by address, and how many Set Addresses make it."""

    wanted: frozenset[int]
    commands: int


def ranking(axes: Iterable[StepAxis]) -> list[int]:
    """Addresses in order of preference as a leader: who runs longest leaves last."""
    return [axis.motor.address for axis in sorted(axes, key=lambda axis: -axis.twin.surely_moving_until_ns())]


def next_change(
    axes: Sequence[StepAxis], groups: Groups, slice_ns: int, latest: Callable[[int], int], now_ns: int
) -> Change:
    """The group of the Start after the coming one.

    slice_ns: how long a slice likely takes; latest: when a command sent at an instant is executed at the latest.
    """
    inside = [axis for axis in axes if axis.in_stream and axis.moving]
    outside = [axis for axis in axes if not axis.in_stream and axis.moving]
    wanted = {axis.motor.address for axis in inside}
    gone_ns = latest(now_ns + LEAVE_SLICES * slice_ns)
    leavers = [axis for axis in inside if axis.slow or not axis.surely_moving_at(gone_ns)]
    stay_ns = latest(now_ns + JOIN_SLICES * slice_ns)
    recruits = [
        axis for axis in outside if axis.twin.nominal.period_ns < BRISK_PERIOD_NS and axis.surely_moving_at(stay_ns)
    ]
    if leavers:
        wanted.discard(min(leavers, key=lambda axis: axis.twin.surely_moving_until_ns()).motor.address)
    elif recruits:
        wanted.add(max(recruits, key=lambda axis: axis.twin.surely_moving_until_ns()).motor.address)
    return Change(frozenset(wanted), cost(groups, wanted, axes))


def cost(groups: Groups, wanted: Iterable[int], axes: Iterable[StepAxis]) -> int:
    """How many Set Addresses make ``wanted`` the streaming group."""
    trial = replace(groups, streaming=set(groups.streaming), parked=set(groups.parked), leader=dict(groups.leader))
    return len(regroup(trial, wanted, ranking(axes)))
