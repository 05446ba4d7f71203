"""Table 4 of the PIC-STEP data sheet, cell by cell, and what follows from it."""

from __future__ import annotations

import pytest

from nmc.chips.table4 import TABLE_4, Cell, Mode, Refusal
from nmc.errors import LocalFault
from nmc.picstep import PicStep

item = pytest.mark.item


# -- Table 4 -----------------------------------------------------------------------------------------------------------

CELLS = {  # (goal, start): position, speed, acceleration, count as printed: V must, o may, x must not
    ("TRAPEZOID", "STOPPED"): "Voox",
    ("VELOCITY", "STOPPED"): "xoox",
    ("VELOCITY", "TRAPEZOID"): "xooV",
    ("VELOCITY", "VELOCITY"): "xoox",
    ("VELOCITY", "UNPROFILED_STOP"): "xoox",
    ("VELOCITY", "UNPROFILED"): "xoox",
    ("UNPROFILED_STOP", "STOPPED"): "VxxV",
    ("UNPROFILED_STOP", "TRAPEZOID"): "xxxV",
    ("UNPROFILED_STOP", "UNPROFILED_STOP"): "xxxV",
    ("UNPROFILED", "STOPPED"): "xxxV",
    ("UNPROFILED", "VELOCITY"): "xxxV",
    ("UNPROFILED", "UNPROFILED"): "xxxV",
}
NUMBERS = ("ST-171", "ST-176", "ST-177", "ST-178", "ST-179", "ST-180")
NUMBERS += ("ST-181", "ST-182", "ST-184", "ST-186", "ST-188", "ST-190")


@item(*NUMBERS)
@pytest.mark.parametrize(("goal", "start"), CELLS)
def test_cells_with_loads(goal: str, start: str) -> None:
    """ST 5.1, Table 4: what must, may and must not be loaded."""
    cell = TABLE_4[Mode[goal], Mode[start]]
    assert isinstance(cell, Cell)
    for bit, sign in enumerate(CELLS[goal, start]):
        assert (cell.must >> bit & 1, cell.may >> bit & 1) == {"V": (1, 0), "o": (0, 1), "x": (0, 0)}[sign]


@item("ST-170", "ST-172", "ST-173", "ST-174", "ST-175", "ST-183", "ST-185", "ST-187", "ST-189")
def test_cells_without_loads() -> None:
    """ST 5.1, Table 4: stopping only by Stop Motor (4 cells), eight transitions never, one dash."""
    words = [cell.words for cell in TABLE_4.values() if isinstance(cell, Refusal)]
    assert len(words) + len(CELLS) == 25
    assert (words.count("use Stop Motor"), words.count("not allowed"), words.count("already stopped")) == (4, 8, 1)
    never = {(goal.name, start.name) for (goal, start), cell in TABLE_4.items() if cell == Refusal("not allowed")}
    assert never == {("TRAPEZOID", start) for start in ("TRAPEZOID", "VELOCITY", "UNPROFILED_STOP", "UNPROFILED")} | {
        ("UNPROFILED_STOP", "VELOCITY"),
        ("UNPROFILED_STOP", "UNPROFILED"),
        ("UNPROFILED", "TRAPEZOID"),
        ("UNPROFILED", "UNPROFILED_STOP"),
    }


@item("ST-191", "ST-192", "ST-132")
def test_the_stop_position_stands_while_running(step: PicStep, rig) -> None:
    """Derived from Table 4: it can only be given from Stopped; a count alone keeps it, but from Stopped has none."""
    step.load_trajectory(position=500, timer_count=64000, start_now=True)
    before = rig.count()
    with pytest.raises(LocalFault, match="Table 4"):
        step.load_trajectory(position=900, timer_count=64000)
    assert rig.count() == before
    step.load_trajectory(timer_count=64500, start_now=True)
    step.wait_until_stopped(5_000_000_000)
    assert step.position() == 500
    with pytest.raises(LocalFault, match="for ever"):
        step.load_trajectory(timer_count=64000)


@item("X-20")
def test_the_misprinted_cell_is_never_used(step: PicStep, rig) -> None:
    """Table 4 prints a count for Velocity Profile from Trapezoid; loading a count is what selects unprofiled modes."""
    step.load_trajectory(position=5000, speed=20, acceleration_time=5, start_now=True)
    with pytest.raises(LocalFault, match="Table 4"):
        step.load_trajectory(speed=30, timer_count=64000)
    with pytest.raises(LocalFault, match="Table 4"):
        step.load_trajectory(speed=30)


@item("ST-130", "ST-131", "ST-133", "X-47", "X-48")
def test_only_fresh_loads_are_started(step: PicStep, rig) -> None:
    """ST 5.1: Start Motion executes the most recent load; the driver starts none twice and none it has not seen."""
    with pytest.raises(LocalFault, match="old load"):
        step.start_motion()
    step.load_trajectory(position=100, speed=20, acceleration_time=5)
    with pytest.raises(LocalFault, match="no speed"):
        step.load_trajectory(position=50)  # it would overwrite the load whose speed it counts on
    step.load_trajectory(position=50, speed=20, acceleration_time=5)
    step.start_motion()
    step.wait_until_stopped(2_000_000_000)
    assert step.position() == 50
    with pytest.raises(LocalFault, match="old load"):
        step.start_motion()
    assert rig.simulation.violations == []
