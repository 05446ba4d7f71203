"""Gains of a PIC-SERVO by the procedure of its data sheet, on the twin: better than before, the same every time."""

from itertools import count

import numpy as np
import pytest

from groupstart import verify
from machines.commission import Asker, StoppedError, UndecidedError, at_work
from machines.gains import gains_of
from machines.load import parse_machine, read_machine
from machines.schema import MachineConfig
from machines.servobench import Response, ServoBench, Watched
from machines.tuning import Tuned
from machines.tuning_axis import tune_motor, with_gains
from machines.wiring import servo_tables
from nmc.picservo import PicServo

GOOD = "kp = 220\nkd = 2640\nki = 150\nintegration_limit = 4000\n"
POOR = "kp = 60\nkd = 700\nki = 0\nintegration_limit = 0\n"
CIRCLE = "G21 G90 G64 P0.01\nG1 X20 Y20 F1200\nG3 X20 Y20 I10 J0\nG1 X10 Y10\nM2\n"


def poor_text() -> str:
    """mill3-servo with gains for X and Y that hold and no more."""
    return read_machine("mill3-servo").text.replace(GOOD, POOR, 2)


def tune(config: MachineConfig, motor: str, seed: int = 3) -> Tuned:
    with at_work(config, seed=seed) as connection:
        tuned = tune_motor(connection, motor, step=40, room=400)
        servo = PicServo(connection.buses[0], servo_tables(config)[motor][1].address)
        assert abs(servo.position()) <= 3  # it ends where it began
        assert connection.simulation is not None
        assert connection.simulation.violations == []
    return tuned


@pytest.fixture(scope="module")
def tuned_text() -> str:
    """The machine after both poor axes have been tuned."""
    text = poor_text()
    config = parse_machine(text, "m")
    for motor in "XY":
        text = with_gains(text, config, motor, tune(config, motor).gains)
    return text


def test_the_step_is_answered_better_than_before() -> None:
    tuned = tune(parse_machine(poor_text(), "m"), "X")
    assert all(one.rise_ms > 200 for one in tuned.before)  # it did not come there
    assert all(one.rise_ms < 15 and one.overshoot <= 4 and one.steady_error <= 3 for one in tuned.after)
    stages = [attempt.stage for attempt in tuned.attempts]
    assert stages == sorted(stages, key=["Kd", "Kp", "Ki", "IL"].index)
    assert not [attempt for attempt in tuned.attempts if attempt.stage == "Kd"][-1].good  # it has hummed
    again = tune(parse_machine(poor_text(), "m"), "X")
    assert (again.gains, again.attempts) == (tuned.gains, tuned.attempts)


def test_a_hanging_axis_is_tuned_too() -> None:
    tuned = tune(parse_machine(read_machine("mill3-servo").text, "m"), "Z")
    assert tuned.gains.integral_gain > 0
    assert max(one.steady_error for one in tuned.after) <= max(one.steady_error for one in tuned.before)
    assert max(one.rise_ms for one in tuned.after) < max(one.rise_ms for one in tuned.before)


def test_the_shaft_follows_a_circle_better(tuned_text: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("machines")
    errors = []
    for number, text in enumerate((poor_text(), tuned_text)):
        path = folder / f"{number}.toml"
        path.write_text(text)
        verdict = verify(CIRCLE, str(path)).verdict
        assert verdict is not None
        assert verdict.motor_contour_um is not None
        errors.append(verdict.motor_contour_um)
    assert errors[1].rms < 0.5 * errors[0].rms
    assert errors[1].max < 0.7 * errors[0].max


def test_a_stop_request_leaves_the_axis_held_by_its_own_gains() -> None:
    config = parse_machine(read_machine("mill3-servo").text, "m")
    asked = count()
    seen = []

    def begin() -> None:
        with at_work(config) as connection:
            seen.append(connection.simulation)
            tune_motor(connection, "X", step=40, room=400, stop_requested=lambda: next(asked) == 3000)

    with pytest.raises(StoppedError):
        begin()
    servo = seen[0].modules["X"]
    assert servo.position == pytest.approx(0, abs=60)
    stood = servo.position
    seen[0].world.run_until(seen[0].world.now_ns + 1_000_000_000)
    assert abs(servo.position - stood) <= 2


def test_a_trial_ends_at_the_edge_of_its_room() -> None:
    config = parse_machine(read_machine("mill3-servo").text, "m")
    table = servo_tables(config)["Z"][1]
    with at_work(config) as connection:
        chip = PicServo(connection.buses[0], table.address)
        bench = ServoBench(chip, gains_of(table), 60, Asker(chip.bus))
        limp = gains_of(parse_machine(read_machine("mill3-servo").text.replace("kp = 220", "kp = 0"), "m").axis["Z"])
        fallen = bench.creep(limp, -0.5, 3_000)
        assert not fallen.whole
        assert abs(fallen.position[-1]) < 200
        assert abs(chip.position()) <= 8  # and it was brought back


def test_a_motor_that_does_not_turn_is_undecided() -> None:
    text = read_machine("mill3-servo").text.replace(GOOD, POOR)
    stuck = text.replace("[sim.axis.X.plant]\n", "[sim.axis.X.plant]\ncoulomb_nm = 3\n")
    with pytest.raises(UndecidedError, match="free"):
        tune(parse_machine(stuck, "m"), "X")


def test_figures_of_a_step() -> None:
    time = np.arange(0.0, 100.0, 1.0)
    position = np.where(time < 10, time * 4, np.where(time < 20, 45.0, 41.0))
    step = Response(40, time, position, True)
    assert (step.overshoot, step.rise_ms, step.settle_ms, step.steady_error) == (4.0, 9.0, 20.0, 1.0)
    sagging = Response(40, time, np.full(100, 50.0), True)
    assert (sagging.overshoot, sagging.settle_ms) == (0.0, float("inf"))
    assert Response(40, time, np.zeros(100), True).rise_ms == float("inf")
    assert Watched(time[:6], np.array([0.0, 1, 1, 0, 0, 1]), False, False).reversals() == 2
