"""The servo twin against the profile of the PIC-SERVO data sheet, sections 4.3 and 4.4, tick by tick."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nmc.servo_twin import Profiler, TickClock

VELOCITY = st.integers(-(2**24), 2**24)


@given(st.integers(-(2**40), 2**40), VELOCITY, VELOCITY, st.integers(0, 2**18), st.integers(0, 80))
def test_closed_form_is_the_tick_by_tick_profile(p: int, v: int, goal: int, a: int, ticks: int) -> None:
    twin = Profiler(p, v, goal, a).after(ticks)
    for _ in range(ticks):
        if v < goal:
            v = min(v + a, goal)
        elif v > goal:
            v = max(v - a, goal)
        p += v
    assert (twin.position, twin.velocity) == (p, v)


@given(st.floats(-100, 100), st.lists(st.integers(2, 40), min_size=12, max_size=60))
def test_clock_locks_onto_the_ticks(ppm: float, gaps: list[int]) -> None:
    clock, period_ns, at = TickClock(), 512_000 * (1 + ppm * 1e-6), 0
    for gap in gaps:
        at += gap
        clock.observe(round(1e9 + at * period_ns))
    seen = clock.observe(round(1e9 + (at + 5) * period_ns))
    assert clock.end_ns(seen) == pytest.approx(1e9 + (at + 5) * period_ns, abs=2_000)
    assert clock.next_after(1e9 + (at + 9.5) * period_ns) == seen + 5
