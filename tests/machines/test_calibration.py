"""Crystals measured on the twin: the truth lies within the bounds, and a stream that knows them runs as well."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groupstart import verify
from machines.calibrating import calibrate_motor, run_steps, with_crystals
from machines.calibration import Crystal, Row, crystal_of, period_bounds
from machines.commission import UndecidedError, at_work, never
from machines.crystals import DRIFT_PPM, calibrated
from machines.load import parse_machine, read_machine
from planner.motors import ServoMotor, StepMotor


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(("motor", "jitter_ms", "within"), [("Z", 0.2, 15), ("X", 0.2, 3), ("Z", 2, 30), ("X", 2, 12)])
def test_the_truth_lies_within_the_bounds(motor: str, jitter_ms: float, within: float, seed: int) -> None:
    text = read_machine("mill3-mixed").text.replace("host_jitter_ms = 0.2", f"host_jitter_ms = {jitter_ms}")
    with at_work(parse_machine(text, "m"), seed=seed) as connection:
        found = calibrate_motor(connection, motor, seconds=10, stop_requested=never)
        assert connection.simulation is not None
        true_ppm = connection.simulation.modules[motor].ppb / 1000
        assert connection.simulation.violations == []
    assert abs(found.ppm - true_ppm) <= found.within_ppm < within


@given(
    period=st.integers(400_000, 9_000_000),
    first=st.integers(0, 10**9),
    numbers=st.lists(st.integers(1, 5_000), min_size=2, max_size=40, unique=True),
    before=st.lists(st.integers(0, 300_000), min_size=40, max_size=40),
    after=st.lists(st.integers(0, 300_000), min_size=40, max_size=40),
)
def test_bounds_hold_the_period_and_are_those_of_the_extreme_lines(
    period: int, first: int, numbers: list[int], before: list[int], after: list[int]
) -> None:
    number = np.array(sorted(numbers))
    at = first + number * period
    row = Row(number, at - np.array(before[: len(at)]), at + np.array(after[: len(at)]))
    least, most = period_bounds(row)
    assert least - 1e-6 <= period <= most + 1e-6
    for extreme in (least, most):  # a line of this period still passes through every window, a steeper one does not
        begins = row.first_ns - number * extreme
        ends = row.last_ns - number * extreme
        assert begins.max() <= ends.min() + 1e-3


def test_events_that_are_not_evenly_spaced_are_undecided() -> None:
    number = np.arange(1, 100)
    at = number * 1_000_000
    at[50:] += 500_000
    with pytest.raises(UndecidedError, match="evenly"):
        crystal_of([Row(number, at - 1000, at + 1000)], 1_000_000)
    with pytest.raises(UndecidedError, match="crystal"):
        crystal_of([Row(number, number * 1_010_000 - 1000, number * 1_010_000 + 1000)], 1_000_000)


def test_a_run_goes_where_there_is_room() -> None:
    config = read_machine("mill3-step").config
    assert run_steps(config, "X", 10) == 2000
    assert run_steps(config, "X", 10, position=110 * 200) == -2000
    near = parse_machine(read_machine("mill3-step").text.replace("travel = [-20, 40]", "travel = [-0.1, 0.1]"), "m")
    with pytest.raises(UndecidedError, match="travel"):
        run_steps(near, "Z", 10)
    gantry = read_machine("gantry4-step").config
    pair = next(motor.axis for motor in gantry.motor.values())
    with pytest.raises(UndecidedError, match="rack"):
        run_steps(gantry, pair, 10)


def test_a_record_counts_where_it_was_made() -> None:
    text = read_machine("mill3-mixed").text
    plain = parse_machine(text, "m")
    found = [("X", Crystal(-72.9, 1.5, 9)), ("Z", Crystal(41.25, 6.2, 9))]
    config = parse_machine(with_crystals(text, plain, found, "twin, seed 1", "2026-01-01"), "m")
    x, y, z = calibrated(config, "twin, seed 1")
    assert isinstance(x, ServoMotor)
    assert isinstance(y, ServoMotor)
    assert isinstance(z, StepMotor)
    assert (x.crystal_fast_ppb, y.crystal_fast_ppb) == (-72_900, None)
    assert (z.crystal_fast_ppb, z.crystal_ppm) == (41_250, 12)
    assert z.crystal_ppm >= 6.2 + DRIFT_PPM
    for elsewhere in ("twin, seed 2", "/dev/ttyUSB0"):
        assert calibrated(config, elsewhere) == calibrated(plain, elsewhere)
    on_port = parse_machine(with_crystals(text, plain, found, "/dev/ttyUSB0", "2026-01-01"), "m")
    assert calibrated(on_port, "/dev/ttyUSB7") == calibrated(config, "twin, seed 1")
    assert calibrated(on_port, "twin, seed 1") == calibrated(plain, "")


def test_a_calibrated_machine_runs_as_well(tmp_path_factory: pytest.TempPathFactory) -> None:
    text = read_machine("mill3-step").text
    config = parse_machine(text, "m")
    with at_work(config) as connection:
        found = [(motor, calibrate_motor(connection, motor, seconds=10, stop_requested=never)) for motor in "XYZ"]
        place = connection.place
    path = tmp_path_factory.mktemp("m") / "known.toml"
    path.write_text(with_crystals(text, config, found, place, "2026-01-01"))
    program = "G21 G90 G64 P0.01\nG1 X20 Y20 F1200\nG3 X20 Y20 I10 J0 Z4\nG1 X0 Y0 Z0\nM2\n"
    for machine in (str(path), "mill3-step"):
        result = verify(program, machine)
        assert result.verdict is not None
        assert result.verdict.ok
        assert set(result.verdict.end_error_steps.values()) == {0}
