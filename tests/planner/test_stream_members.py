"""Changes of the streaming group: one a slice, foreseen, and never a leader more or less than one."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from stream_rig import Conditions, random_path, said

from nmc.program import Evidence
from planner.stream_axis import LOAD_POSITION, LOAD_TRAJECTORY, MOVING, START_NOW
from planner.stream_base import SET_ADDRESS, START_MOTION
from planner.stream_regroup import PARKED_GROUP, STREAMING_GROUP


def changes_a_slice(told: list[Evidence]) -> list[tuple[int, int, int]]:
    """How many left and joined, by how many Set Addresses, between two Starts of a group that is never empty."""
    members: set[int] = set()
    slices: list[tuple[int, int, int]] = []
    before: set[int] = set()
    commands = 0
    departs = False
    for evidence in told:
        exchange = evidence.exchange
        if exchange.command == LOAD_TRAJECTORY:
            departs = departs or exchange.data[0] & (LOAD_POSITION | START_NOW) == LOAD_POSITION
        elif exchange.command == SET_ADDRESS:
            commands += 1
            stays = exchange.data[1] | 0x80 == STREAMING_GROUP
            members = members | {exchange.data[0]} if stays else members - {exchange.data[0]}
            departs = departs or not members
        elif exchange.command == START_MOTION:
            if not departs:
                slices.append((len(before - members), len(members - before), commands))
            before, commands, departs = set(members), 0, False
    return slices


@pytest.mark.parametrize("jitter_ms", [0.0, 0.2, 2.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_slice_pays_for_one_change(jitter_ms: float, seed: int) -> None:
    slices = changes_a_slice(said(random_path(seed, 40.0, duration_s=4.0), Conditions(jitter_ms, seed=seed), "group"))
    changes = [slice_ for slice_ in slices if slice_[2]]
    assert {left + joined for left, joined, _ in changes} == {1}
    assert {commands for _, _, commands in changes} <= {1, 2}
    assert 10 < len(changes) < 0.4 * len(slices)


@pytest.mark.parametrize("seed", range(3))
def test_each_group_that_a_start_meets_has_one_leader(seed: int) -> None:
    told = said(random_path(seed, 30.0, duration_s=2.0), Conditions(0.2, seed=seed), "group")
    group_of: dict[int, int] = {}
    leads: dict[int, bool] = {}
    starts = 0
    for evidence in told:
        exchange = evidence.exchange
        if exchange.command == SET_ADDRESS:
            group_of[exchange.data[0]] = exchange.data[1] | 0x80
            leads[exchange.data[0]] = not exchange.data[1] & 0x80
        elif exchange.command == START_MOTION:
            starts += 1
            members = [a for a, group in group_of.items() if group == STREAMING_GROUP]
            assert sum(leads[a] for a in members) == 1
            parked = [a for a, group in group_of.items() if group == PARKED_GROUP]
            assert sum(leads[a] for a in parked) <= 1
    assert starts > 50


def test_an_axis_leaves_before_it_must() -> None:
    # steps that are left when it leaves: it ends on counts of its own, not on one that was meant for a slice
    told = said(random_path(1, 40.0, duration_s=4.0), Conditions(0.2, seed=1), "group")
    left = [
        evidence.status
        for evidence in told
        if evidence.exchange.command == SET_ADDRESS and evidence.exchange.data[1] == PARKED_GROUP
    ]
    assert len(left) > 5
    assert all(status is not None and status & MOVING for status in left[3:])
