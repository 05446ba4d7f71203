"""Groups: whatever the change of members, each non-empty group ends with exactly one leader."""

from hypothesis import given
from hypothesis import strategies as st

from planner.stream_regroup import PARKED_GROUP, STREAMING_GROUP, Groups, regroup


def play(modules: dict[int, tuple[int, bool]], commands: list[tuple[int, bytes]]) -> None:
    """What the modules make of Set Address: group byte bit 7 clear flags the leader (section 5.1)."""
    for address, data in commands:
        assert data[0] == address
        modules[address] = (data[1] | 0x80, not data[1] & 0x80)
        for group in (STREAMING_GROUP, PARKED_GROUP):
            assert list(modules.values()).count((group, True)) <= 1, "two leaders at once"


@given(st.integers(1, 6), st.lists(st.sets(st.integers(1, 6)), max_size=12))
def test_one_leader_a_group(count: int, wishes: list[set[int]]) -> None:
    addresses = list(range(1, count + 1))
    groups = Groups.all_parked(addresses)
    modules = {a: (PARKED_GROUP, a == 1) for a in addresses}
    for wish in wishes:
        wanted = wish & set(addresses)
        ranking = sorted(addresses, key=lambda a: (a * 7 + len(wanted)) % 5)
        play(modules, regroup(groups, wanted, ranking))
        for group, members in ((STREAMING_GROUP, wanted), (PARKED_GROUP, set(addresses) - wanted)):
            assert {a for a, (g, _) in modules.items() if g == group} == members
            leaders = [a for a, (g, leads) in modules.items() if g == group and leads]
            assert len(leaders) == (1 if members else 0)
            assert groups.leader[group] == (leaders[0] if leaders else 0)


def test_nothing_is_sent_when_nothing_changes() -> None:
    groups = Groups.all_parked([1, 2, 3])
    assert regroup(groups, set(), [1, 2, 3]) == []
    assert len(regroup(groups, {2, 3}, [2, 3, 1])) == 2
    assert regroup(groups, {2, 3}, [3, 2, 1]) == []
