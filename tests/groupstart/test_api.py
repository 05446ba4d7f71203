from pathlib import Path

import pytest

import groupstart
from groupstart import ProgramRefusedError, check, plan, verify

SQUARE = "G21 G90\nG1 X5 F600\nG1 Y5\nX0\nY0\nM2\n"


def test_a_program_may_be_text_or_a_path(tmp_path: Path) -> None:
    path = tmp_path / "square.nc"
    path.write_text(SQUARE)
    assert check(SQUARE) == ()
    assert check(path) == check(str(path)) == ()
    assert plan(path).plan.trajectory.duration_s == plan(SQUARE).plan.trajectory.duration_s


def test_what_is_refused_comes_as_diagnostics() -> None:
    bad = "G1 X1\nG999\nM2\n"
    assert [item.line for item in check(bad)] == [1, 2]
    with pytest.raises(ProgramRefusedError) as caught:
        plan(bad)
    assert [item.line for item in caught.value.diagnostics] == [1, 2]
    assert "<program>:2:1: error" in str(caught.value)
    assert [item.code for item in check("G21 G90\nG0 X500\nM2\n", "mill3-step")] == ["TR001"]


def test_an_offset_moves_the_work(tmp_path: Path) -> None:
    shifted = plan("G21 G90\nG0 X1 Y2 Z3\nM2\n", work_offset=(10, 20))
    end = shifted.plan.trajectory.q(shifted.plan.trajectory.junctions_s()[-1:])[0]
    assert end == pytest.approx([11, 22, 3])


def test_verify_gives_verdict_and_trace() -> None:
    result = verify(SQUARE, "mill3-step", seed=9)
    assert result.verdict is not None
    assert result.verdict.ok
    assert result.trace is not None
    assert result.trace.run_count.sum() == 4000
    assert result.violations == ()


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_thing"):
        _ = groupstart.no_such_thing


def test_verify_is_held_and_slowed_by_a_script() -> None:
    from machines.control import Script

    result = verify("G21 G90 F900\nG1 X20\nM2\n", control=Script([(0.4, "hold"), (0.9, "resume"), (1.0, "feed 50")]))
    assert result.verdict is not None
    assert result.verdict.ok
    [hold] = result.verdict.holds
    assert hold.announced_mm > 0
    assert result.plan.trajectory.duration_s > 2.0
