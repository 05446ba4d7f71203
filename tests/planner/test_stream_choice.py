"""Which period an axis is given where it is in doubt which roll-over takes it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from stream_rig import line

from nmc.budget import BusTiming, Window
from planner.motors import StepMotor
from planner.quantize import period_of_count_ns
from planner.steptrain import StepTrain
from planner.stream_axis import BETTER_STEPS, Load, StepAxis

PERIOD_NS = 3_000_000
HORIZON_NS = 6_000_000
UNSURE_NS = 250_000


def departed() -> StepAxis:
    """An axis that was begun with steps 3 ms apart, somewhere within 0.2 ms, on a path that speeds up to 0.5 ms."""
    train = StepTrain(line((20.0,), 10.0), StepMotor("X", "X", 0, 1, 200.0, 2))
    axis = StepAxis(train, BusTiming.at(115200), 0)
    leg = axis.next_leg()
    assert leg is not None
    first_ns = leg.instants_ns[0]
    begun = Window(first_ns - PERIOD_NS - 100_000, first_ns - PERIOD_NS + 100_000, first_ns - PERIOD_NS - 100_000)
    axis.executed(Load(PERIOD_NS, leg), begun)
    return axis


def period_of(data: bytes) -> int:
    return period_of_count_ns(int.from_bytes(data[1:3], "little"), 2)


def mended(axis: StepAxis, execute_ns: int, period_ns: int) -> float:
    next_ns, _ = axis.twin.nominal.ahead(execute_ns)
    target_ns = max(execute_ns + HORIZON_NS, next_ns + min(PERIOD_NS, period_ns))
    wanted = axis._planned_to_go(target_ns)
    return axis.twin.belief.mends_steps(execute_ns, 2 * UNSURE_NS, target_ns, wanted, period_ns)


def test_all_possible_chips_decide_where_a_roll_over_may_take_the_count_or_not() -> None:
    """The nominal chip rolls over just before the count comes; a good part of the others do so after it."""
    axis = departed()
    roll_ns, _ = axis.twin.nominal.ahead(axis.twin.nominal.next_ns + 1)
    execute_ns = roll_ns + 50_000
    nominal_ns = period_of(axis.count_load(execute_ns, execute_ns + HORIZON_NS, start_now=True)[0])
    chosen_ns = period_of(axis.best_load(execute_ns, HORIZON_NS, UNSURE_NS)[0])
    worth = mended(axis, execute_ns, chosen_ns)
    assert worth > mended(axis, execute_ns, nominal_ns) + BETTER_STEPS
    assert axis.urgency_steps(execute_ns, HORIZON_NS, UNSURE_NS) == pytest.approx(worth, abs=0.02)


def test_the_nominal_chip_decides_in_the_middle_between_two_roll_overs() -> None:
    axis = departed()
    execute_ns = axis.twin.nominal.next_ns + PERIOD_NS // 2
    nominal, _ = axis.count_load(execute_ns, execute_ns + HORIZON_NS, start_now=True)
    assert axis.best_load(execute_ns, HORIZON_NS, UNSURE_NS)[0] == nominal


def test_no_roll_over_comes_before_the_first_of_a_single_step() -> None:
    """A leg of one step has no gaps: nothing but its own instant can be aimed at."""
    train = StepTrain(line((0.005,), 0.1), StepMotor("X", "X", 0, 1, 200.0, 2))
    axis = StepAxis(train, BusTiming.at(115200), 0)
    leg = axis.next_leg()
    assert leg is not None
    assert len(leg) == 1
    begun_ns = leg.instants_ns[0] - PERIOD_NS
    axis.executed(Load(PERIOD_NS, leg), Window(begun_ns, begun_ns + 200_000, begun_ns))
    data, _ = axis.best_load(begun_ns + 10_000, HORIZON_NS, UNSURE_NS)
    assert abs(period_of(data) - PERIOD_NS) < 1_000
