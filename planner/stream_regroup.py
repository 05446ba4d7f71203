"""Who is in which group: the streaming group that Start Motion is sent to, and the parked one.

Each non-empty group has exactly one leader whenever a group command is sent, so that every group Start and every
safety stop is answered by one module (PIC-STEP data sheet, section 3.3).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

STREAMING_GROUP = 0x81
PARKED_GROUP = 0x82
LEADER_MASK = 0x7F
"""Bit 7 of the group byte clear makes a leader (section 5.1, Set Address)."""


@dataclass(slots=True)
class Groups:
    """Present membership by module address; ``leader`` per group, 0 if it is empty."""

    streaming: set[int] = field(default_factory=set)
    parked: set[int] = field(default_factory=set)
    leader: dict[int, int] = field(default_factory=lambda: {STREAMING_GROUP: 0, PARKED_GROUP: 0})

    @classmethod
    def all_parked(cls, addresses: Sequence[int]) -> Groups:
        """Every module parked, the first one leading."""
        groups = cls(parked=set(addresses))
        groups.leader[PARKED_GROUP] = addresses[0] if addresses else 0
        return groups


def set_address_data(address: int, group: int, leads: bool) -> bytes:
    """Data bytes of Set Address: individual address and group byte."""
    return bytes((address, group & LEADER_MASK if leads else group))


def regroup(groups: Groups, wanted: Iterable[int], ranking: Sequence[int]) -> list[tuple[int, bytes]]:
    """Set Address commands that make ``wanted`` the streaming group; ``groups`` is updated.

    ranking: addresses in order of preference as a leader. Returns (address, data) in sending order: the old leader of
    a group goes before the new one is named, so there are never two.
    """
    wanted = set(wanted)
    commands: list[tuple[int, bytes]] = []
    stay, leave, join = groups.streaming & wanted, groups.streaming - wanted, wanted - groups.streaming
    parked_after = (groups.parked - join) | leave

    def lead(group: int, candidates: set[int], moved: set[int]) -> int:
        present = groups.leader[group]
        if present in candidates and present not in moved:
            return present
        return next((a for a in ranking if a in candidates), 0)

    stream_leader = lead(STREAMING_GROUP, stay or join, join)
    parked_leader = lead(PARKED_GROUP, (groups.parked - join) or leave, leave)
    parked_was = groups.leader[PARKED_GROUP]
    for address in sorted(leave):
        commands.append((address, set_address_data(address, PARKED_GROUP, address == parked_leader and not parked_was)))
    if stream_leader in stay and stream_leader != groups.leader[STREAMING_GROUP]:
        commands.append((stream_leader, set_address_data(stream_leader, STREAMING_GROUP, True)))
    for address in sorted(join):
        commands.append((address, set_address_data(address, STREAMING_GROUP, address == stream_leader)))
    if parked_leader and parked_leader != parked_was and not (parked_leader in leave and not parked_was):
        commands.append((parked_leader, set_address_data(parked_leader, PARKED_GROUP, True)))
    groups.streaming, groups.parked = wanted, parked_after
    groups.leader = {STREAMING_GROUP: stream_leader, PARKED_GROUP: parked_leader}
    return commands
