"""The verdict's figures against cases that can be reckoned by hand."""

import numpy as np
import pytest

from sim.compare import Reference, compare, compare_pins
from sim.compare_kernel import distances, greatest_distance
from sim.pulses import Pins, ServoTrack, StepRuns, pins, pulses


def runs_of(*rows: tuple[int, int, float, int, int], motors: int = 2) -> StepRuns:
    """Rows (axis, first_ns, period_ns, count, direction)."""
    axis, first, period, count, direction = (np.array(column) for column in zip(*rows, strict=True))
    return StepRuns(
        axis.astype("u1"),
        first.astype("i8"),
        period.astype("f8"),
        count.astype("i4"),
        direction.astype("i1"),
        np.zeros(motors, "i8"),
    )


def straight(seconds: float = 1.0, x_mm: float = 10.0, y_mm: float = 0.0) -> Reference:
    t = np.linspace(0.0, seconds, 1001)
    q = np.outer(t / seconds, (x_mm, y_mm))
    return Reference(("X", "Y"), t, q, np.arange(1001, dtype="i4"))


STEPS = np.array([100.0, 100.0])


def judged(reference: Reference, runs: StepRuns, start_ns: int = 0):  # type: ignore[no-untyped-def]
    return compare(reference, runs, ("X", "Y"), ("X", "Y"), STEPS, start_ns)


def test_pulses_of_several_motors_come_in_order_of_time() -> None:
    out = pulses(runs_of((0, 0, 100.0, 3, 1), (1, 50, 100.0, 2, -1)))
    assert out.time_ns.tolist() == [0, 50, 100, 150, 200]
    assert out.position_steps.tolist() == [[1, 0], [1, -1], [2, -1], [2, -2], [3, -2]]


def test_perfect_stepping_along_an_axis_has_no_contour_error() -> None:
    verdict = judged(straight(), runs_of((0, 500_000, 1e6, 1000, 1)))
    assert verdict.contour_steps.max == pytest.approx(0.0, abs=1e-9)
    assert verdict.end_error_steps == {"X": 0, "Y": 0}
    assert verdict.sim_time_s == pytest.approx(1.0, abs=2e-3)


def test_late_pins_are_lag_and_not_shape() -> None:
    verdict = judged(straight(), runs_of((0, 30_500_000, 1e6, 1000, 1)))
    assert verdict.contour_steps.max == pytest.approx(0.0, abs=1e-9)
    assert verdict.lag_ms_max == pytest.approx(30.5, abs=6.0)
    assert verdict.sim_time_s == pytest.approx(1.03, abs=2e-3)


def test_pins_beside_the_path_are_shape_in_um_and_steps_and_named_by_line() -> None:
    verdict = judged(straight(), runs_of((0, 500_000, 1e6, 1000, 1), (1, 400_200_000, 1e6, 3, 1)))
    assert verdict.contour_steps.max == pytest.approx(3.0)
    assert verdict.contour_um.max == pytest.approx(30.0)
    assert verdict.end_error_steps == {"X": 0, "Y": 3}
    assert 400 <= verdict.worst_line <= 1000


def test_a_path_that_comes_back_is_compared_with_its_own_stretch() -> None:
    t = np.linspace(0.0, 2.0, 2001)
    q = np.stack((10.0 - np.abs(10.0 * t - 10.0), np.where(t > 1.0, 0.5 * (t - 1.0), 0.0)), axis=1)
    reference = Reference(("X", "Y"), t, q, np.zeros(2001, "i4"))
    out = runs_of((0, 500_000, 1e6, 1000, 1), (0, 1_000_500_000, 1e6, 1000, -1))
    assert judged(reference, out).contour_steps.max == pytest.approx(50.0, rel=0.02)  # Y never moved


def test_program_error_is_taken_from_the_programmed_polyline() -> None:
    reference = straight()
    reference = Reference(
        reference.axes, reference.t_s, reference.q, reference.line, np.array([[0.0, 0.2], [10.0, 0.2]])
    )
    verdict = judged(reference, runs_of((0, 500_000, 1e6, 1000, 1)))
    assert verdict.program_um == pytest.approx(200.0)


def test_a_plan_that_skips_a_stretch_of_the_program_is_found_again() -> None:
    reference = straight()
    detour = np.array([[0.0, 0.0], [0.0, 40.0], [-30.0, 40.0], [0.0, 0.0], [10.0, 0.0]])
    reference = Reference(reference.axes, reference.t_s, reference.q, reference.line, detour)
    verdict = judged(reference, runs_of((0, 500_000, 1e6, 1000, 1)))
    assert verdict.program_um == pytest.approx(0.0, abs=0.1)


def test_no_pulse_at_all_is_told_by_the_end_error() -> None:
    nothing = StepRuns(*(np.zeros(0, d) for d in ("u1", "i8", "f8", "i4", "i1")), np.zeros(2, "i8"))
    assert judged(straight(), nothing).end_error_steps == {"X": -1000, "Y": 0}


def test_one_axis_that_is_late_is_told_apart_from_the_other() -> None:
    """Ideal pulses are half a step short of each place: at 0.5 ms, 1.5 ms, ...; Y has all of them 5 ms later."""
    lags = judged(straight(y_mm=10.0), runs_of((0, 500_000, 1e6, 1000, 1), (1, 5_500_000, 1e6, 1000, 1))).lags
    assert lags.motors == ("X", "Y")
    assert lags.max_ms == pytest.approx([0.0, 5.0], abs=1e-6)
    assert lags.rms_ms == pytest.approx([0.0, 5.0], abs=1e-6)


def test_an_axis_that_is_early_lags_as_much() -> None:
    lags = judged(straight(), runs_of((0, 3_500_000, 1e6, 997, 1))).lags  # the fourth pulse is in place
    assert lags.max_ms[0] == pytest.approx(3.0, abs=1e-6)
    early = judged(straight(), runs_of((0, 500_000, 0.9e6, 1000, 1))).lags
    assert early.max_ms[0] == pytest.approx(99.9, abs=1e-3)  # the last pulse comes at 899.6 ms for 999.5 ms


def test_pins_that_are_late_in_one_line_are_late_in_no_other() -> None:
    reference = straight()
    line = np.where(reference.t_s < 0.5, 7, 30).astype("i4")
    line[reference.t_s >= 0.8] = 9  # lines need not come in order
    reference = Reference(reference.axes, reference.t_s, reference.q, line)
    out = runs_of((0, 500_000, 1e6, 500, 1), (0, 505_500_000, 1e6, 500, 1))
    lags = judged(reference, out).lags
    assert lags.lines.tolist() == [7, 9, 30]
    assert lags.motor_ms[:, 0] == pytest.approx([0.0, 5.0, 5.0], abs=1e-6)
    assert lags.motor_ms[:, 1] == pytest.approx([0.0, 0.0, 0.0])
    assert lags.path_ms == pytest.approx([0.5, 4.5, 4.5], abs=1e-6)  # on the new place, not half a step short of it
    only = judged(reference, runs_of((0, 500_000, 1e6, 800, 1), (0, 805_500_000, 1e6, 200, 1))).lags
    assert only.motor_ms[:, 0] == pytest.approx([0.0, 5.0, 0.0], abs=1e-6)


def test_what_no_lag_explains_is_shape_and_not_lag() -> None:
    """X overshoots by three steps and comes back: the plan passes those places at no time."""
    t = np.linspace(0.0, 2.0, 2001)
    q = np.stack((10.0 - np.abs(10.0 * t - 10.0), np.zeros(2001)), axis=1)
    reference = Reference(("X", "Y"), t, q, np.zeros(2001, "i4"))
    there_and_back = ((0, 500_000, 1e6, 1000, 1), (0, 1_000_500_000, 1e6, 1000, -1))
    assert judged(reference, runs_of(*there_and_back)).lags.max_ms[0] == pytest.approx(0.0, abs=1e-6)
    over = runs_of(
        (0, 500_000, 1e6, 1000, 1),
        (0, 1_000_100_000, 1e5, 3, 1),
        (0, 1_000_450_000, 1e4, 3, -1),
        there_and_back[1],
        (1, 400_200_000, 1e6, 3, 1),
    )
    verdict = judged(reference, over)
    assert verdict.contour_steps.max > 2.9
    assert verdict.lags.max_ms == pytest.approx([0.0, 0.0], abs=1e-6)  # Y is three steps aside where it does not move


def test_the_shaft_of_one_servo_that_is_late_is_told_apart_from_the_other() -> None:
    nothing = StepRuns(*(np.zeros(0, d) for d in ("u1", "i8", "f8", "i4", "i1")), np.zeros(2, "i8"))
    ticks = np.arange(0, 1900) * 512_000
    tracks = [ServoTrack(m, ticks, np.clip(ticks * 1e-9 - late, 0.0, 1.0) * 1000.0) for m, late in ((0, 0.005), (1, 0))]
    lags = compare_pins(straight(y_mm=10.0), pins(nothing, tracks), ("X", "Y"), ("X", "Y"), STEPS, 0).lags
    assert lags.max_ms == pytest.approx([5.0, 0.0], abs=0.01)
    assert lags.rms_ms == pytest.approx([5.0, 0.0], abs=0.02)


def test_a_motor_that_turns_the_other_way_lags_alike() -> None:
    out = pins(runs_of((0, 5_500_000, 1e6, 1000, -1), (1, 500_000, 1e6, 1000, 1)))
    scale = np.array([-100.0, 100.0])
    lags = compare_pins(straight(y_mm=10.0), out, ("X", "Y"), ("X", "Y"), scale, 0).lags
    assert lags.max_ms == pytest.approx([5.0, 0.0], abs=1e-6)


def test_servo_samples_are_straight_between_ticks_and_judged_from_the_plans_start() -> None:
    nothing = StepRuns(*(np.zeros(0, d) for d in ("u1", "i8", "f8", "i4", "i1")), np.zeros(2, "i8"))
    ticks = np.arange(-10, 2400) * 512_000
    track = ServoTrack(0, ticks, np.where(ticks < 0, 77.0, np.clip(ticks * 1e-9, 0.0, 1.0) * 1000.0))
    out = pins(nothing, [track])
    assert isinstance(out, Pins)
    verdict = compare_pins(straight(), out, ("X", "Y"), ("X", "Y"), STEPS, 0)
    assert verdict.contour_steps.max == pytest.approx(0.0, abs=1e-9)
    assert verdict.end_error_steps == {"X": 0, "Y": 0}


def test_pins_beside_a_path_whose_own_box_rounds_away_are_still_found() -> None:
    """The distance to a knot past a segment's end and that to its box differ in the last bit, either way."""
    rng = np.random.default_rng(11)
    t = np.arange(40.0)
    for _ in range(200):
        knots = np.cumsum(rng.uniform(0.0, 1.0, (6, 3)), axis=0)
        pins = knots[-1] + rng.uniform(0.0, 2.0, (40, 3))  # all of them past the end
        first, last = np.zeros(40, np.int64), np.full(40, 5, np.int64)
        found, _ = distances(t, pins, first, last, t[:6], knots)
        edge = np.diff(knots, axis=0)
        along = np.sum((pins[:, None] - knots[None, :-1]) * edge, axis=2) / np.sum(edge * edge, axis=1)
        nearest = knots[None, :-1] + np.clip(along, 0.0, 1.0)[:, :, None] * edge
        wanted = np.linalg.norm(pins[:, None] - nearest, axis=2).min(axis=1)
        assert np.allclose(found, wanted, rtol=1e-12, atol=1e-12)


def test_the_greatest_distance_is_the_greatest_of_all_distances() -> None:
    rng = np.random.default_rng(7)
    for _ in range(100):
        knots = np.cumsum(rng.normal(0.0, 1.0, (300, 2)), axis=0)
        at = np.linspace(0.0, 298.9, 900)
        pins = knots[at.astype(int)] + rng.normal(0.0, rng.uniform(0.0, 3.0), (900, 2))
        first = np.maximum(at.astype(np.int64) - 20, 0)
        last = np.minimum(at.astype(np.int64) + 20, 299)
        every, _ = distances(at, pins, first, last, np.arange(300.0), knots)
        assert greatest_distance(at, pins, first, last, np.arange(300.0), knots) == every.max()
