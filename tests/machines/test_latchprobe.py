"""What a PIC-STEP does where its data sheet is silent, measured on the twin from what the chip reports alone."""

from dataclasses import replace
from itertools import count
from pathlib import Path

import pytest

from groupstart import verify
from machines.commission import Asker, StoppedError, UndecidedError, at_work
from machines.latchprobe import LatchFinding, LatchProbe, Seen, judge
from machines.load import parse_machine, read_machine
from machines.profiles import choose_profile
from machines.schema import MachineConfig
from machines.session import SessionError
from machines.silences import Silences, before_parameters
from machines.staircase import Reading, Sighting, Trial, Window, fits, predicted, step_windows
from machines.wiring import bus_timing
from nmc.picstep import PicStep
from sim.build import Simulation

MS = 1_000_000


def machine(**sim: object) -> MachineConfig:
    """mill3-step: crystals within 100 ppm, a host up to 0.2 ms late; or with other ``[sim]`` values."""
    text = read_machine("mill3-step").text
    head, tail = text.split("[sim]\n")
    told = {"seed": 1, "host_jitter_ms": 0.2, "crystal_ppm": 100, "start_delay_ms": 0.25, "count_latch": '"rollover"'}
    lines = "".join(f"{key} = {value}\n" for key, value in (told | sim).items())
    return parse_machine(f"{head}[sim]\n{lines}\n[sim.axis.X]{tail.split('[sim.axis.X]')[1]}", "m.toml")


def probe(config: MachineConfig, seed: int | None = None, address: int = 1) -> LatchFinding:
    with at_work(config, seed=seed) as connection:
        chip = PicStep(connection.buses[0], address)
        chip.set_parameters("1x", running_current=160)
        found = LatchProbe(chip, bus_timing(config, 0, True), Asker(chip.bus)).measure()
        assert chip.position() == 0
        assert connection.simulation is not None
        assert connection.simulation.violations == []
    return found


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("latch", ["rollover", "immediate"])
def test_the_two_readings_are_told_apart(latch: str, seed: int) -> None:
    found = probe(machine(count_latch=f'"{latch}"'), seed, address=1 + seed % 3)
    assert (found.count_latch, found.first_step) == (latch, "period")
    assert found.decided
    assert abs(found.delay_ms - 0.125) < 4 * found.delay_error_ms < 0.5
    assert found.delay_least_ms <= 0.25


@pytest.mark.parametrize("first", ["period", "immediate"])
@pytest.mark.parametrize("latch", ["rollover", "immediate"])
@pytest.mark.parametrize("jitter_ms", [0, 2, 16])
def test_a_slow_host_sees_less_sharply_and_the_same(jitter_ms: float, latch: str, first: str) -> None:
    options = {"host_jitter_ms": jitter_ms, "count_latch": f'"{latch}"', "first_step": f'"{first}"'}
    with at_work(machine(**options), seed=4) as connection:
        chip = PicStep(connection.buses[0], 2)
        chip.set_parameters("1x", running_current=160)
        found = LatchProbe(chip, bus_timing(connection.config, 0, True), Asker(chip.bus)).measure()
    assert (found.count_latch, found.first_step) == (latch, first)


@pytest.mark.parametrize("seed", range(4))
def test_the_delay_of_a_step_that_comes_at_once_is_not_told_more_sharply_than_it_is_seen(seed: int) -> None:
    found = probe(machine(first_step='"immediate"'), seed)
    assert found.first_step == "immediate"
    assert abs(found.delay_ms - 0.125) < 2 * found.delay_error_ms
    assert found.delay_least_ms <= 0.25


def test_the_start_delay_is_measured() -> None:
    delays = {}
    for most in (0.0, 0.5):
        found = [probe(machine(start_delay_ms=most, host_jitter_ms=0), seed) for seed in range(3)]
        delays[most] = sum(one.delay_ms for one in found) / len(found)
    assert delays[0.0] == pytest.approx(0.0, abs=0.1)
    assert delays[0.5] == pytest.approx(0.25, abs=0.1)


def seen(trial: Trial, reading: Reading) -> Seen:
    """A trial as a chip of this reading shows it."""
    start, load = Window(0, MS), Window(25 * MS, 26 * MS) if trial.new_ns else None
    steps = predicted(reading, trial, start, load)
    assert steps is not None
    return Seen(trial, start, start, load, tuple(steps), False)


PERIOD, AT_ONCE = Reading("rollover", "period"), Reading("immediate", "period")
START, LOAD = Trial(2, 30 * MS), Trial(5, 100 * MS, 20 * MS)


def test_what_does_not_agree_is_not_decided() -> None:
    starts = [seen(START, PERIOD)] * 8
    assert judge(starts, [seen(LOAD, PERIOD)] * 8).count_latch == "rollover"
    assert judge(starts, [seen(LOAD, AT_ONCE)] * 8).count_latch == "immediate"
    assert judge(starts, [seen(LOAD, PERIOD)] * 7 + [seen(LOAD, AT_ONCE)]).count_latch == "unknown"
    late = seen(LOAD, PERIOD)
    third = replace(late, steps=tuple(Window(w.first_ns + 100 * MS, w.last_ns + 100 * MS) for w in late.steps))
    assert judge(starts, [seen(LOAD, PERIOD)] * 7 + [third]).count_latch == "unknown"
    blurred = replace(late, steps=tuple(Window(0, 300 * MS) for _ in late.steps))
    assert judge(starts, [seen(LOAD, PERIOD)] * 6 + [blurred] * 2).count_latch == "rollover"
    assert judge(starts, [seen(LOAD, PERIOD)] * 5 + [blurred] * 3).count_latch == "unknown"


def test_the_first_step_must_agree_as_well() -> None:
    loads = [seen(LOAD, PERIOD)] * 8
    mixed = judge([seen(START, PERIOD)] * 4 + [seen(START, Reading("rollover", "immediate"))] * 4, loads)
    assert mixed.first_step == "unknown"
    assert not mixed.decided


def test_steps_lie_between_two_sightings() -> None:
    windows = [Window(0, 1), Window(10, 11), Window(20, 21), Window(30, 31)]
    sightings = [Sighting(w, n, True) for w, n in zip(windows, (0, 1, 1, 3), strict=True)]
    assert step_windows(sightings) == [Window(0, 11), Window(20, 31), Window(20, 31)]


def test_a_load_on_top_of_a_roll_over_tells_nothing() -> None:
    assert predicted(PERIOD, LOAD, Window(0, MS), Window(100 * MS, 101 * MS)) is None
    [first, second, *_] = predicted(AT_ONCE, LOAD, Window(0, 0), Window(25 * MS, 25 * MS)) or []
    assert (round(first.middle_ns), round(second.middle_ns)) == (45 * MS, 65 * MS)
    assert not fits([first], [first, second])


def test_a_limit_switch_leaves_it_undecided_and_the_motor_stands() -> None:
    text = read_machine("mill3-step").text.replace("limit1_at = 118", "limit1_at = 0.015")
    with pytest.raises(UndecidedError, match="limit switch"):
        probe(parse_machine(text, "m.toml"))


def test_a_stop_request_stops_the_motor_first() -> None:
    asked = count()
    config = machine()
    kept: list[Simulation] = []

    def begin() -> None:
        with at_work(config) as connection:
            assert connection.simulation is not None
            kept.append(connection.simulation)
            chip = PicStep(connection.buses[0], 1)
            chip.set_parameters("1x")
            asker = Asker(chip.bus, lambda: next(asked) == 200)
            LatchProbe(chip, bus_timing(config, 0, True), asker).measure()

    with pytest.raises(StoppedError):
        begin()
    [simulation] = kept
    assert not any(stepper.moving for stepper in simulation.steppers().values())
    pulses = simulation.trace().run_count.sum()
    simulation.world.run_until(simulation.world.now_ns + 1_000 * MS)
    assert simulation.trace().run_count.sum() == pulses > 0


def test_a_lost_motor_power_is_a_fault_in_words() -> None:
    def begin() -> None:
        with at_work(machine()) as connection:
            assert connection.simulation is not None
            chip = PicStep(connection.buses[0], 1)
            chip.set_parameters("1x")
            connection.simulation.steppers()["X"].set_inputs(power=False)
            LatchProbe(chip, bus_timing(machine(), 0, True), Asker(chip.bus)).measure()

    with pytest.raises(SessionError, match="power"):
        begin()


def test_the_questions_that_the_guard_forbids() -> None:
    with at_work(machine(), seed=2) as connection:
        chip = PicStep(connection.buses[0], 2)
        chip.set_parameters("1x", running_current=160)
        answers = Silences(chip, connection).ask_all(amplifier_off=True)
        assert [answer.rule for answer in answers] == ["X-63", "X-64", "X-64", "X-65", "X-66"]
        assert all(answer.as_assumed for answer in answers)
        assert "ran away" in answers[0].answer
        assert chip.position() == 0
        assert connection.simulation is not None
        stepper = connection.simulation.steppers()["Y"]
        assert stepper.mechanical_steps == 0
        assert stepper.amp_enabled
        assert set(connection.simulation.rules()) == {"X-63", "X-64", "X-65", "X-66"}


def test_motion_before_parameters_is_tried_on_a_bus_that_is_left_reset() -> None:
    config = machine()
    with at_work(config) as connection:
        answer = before_parameters(config, connection.buses[0], "main", 3)
        assert (answer.rule, answer.answer) == ("X-66", "the load is ignored")
        assert connection.simulation is not None
        assert {module.address for module in connection.simulation.modules.values()} == {0}


def test_only_what_was_measured_on_the_module_counts_on_a_port() -> None:
    text = read_machine("mill3-step").text.replace(
        'chip = "pic-step"\n', 'chip = "pic-step"\ncount_latch = "rollover"\n'
    )
    assert choose_profile(parse_machine(text, "m"), "auto", simulated=False) == "adaptive"
    probed = '[axis.Y.probed]\nmeasured_on = "twin, seed 1"\nversion = 1\n\n[sim]\n'
    on_twin = parse_machine(text.replace("[sim]\n", probed), "m")
    assert choose_profile(on_twin, "auto", simulated=False) == "group"
    on_port = parse_machine(text.replace("[sim]\n", probed.replace("twin, seed 1", "/dev/ttyUSB0")), "m")
    assert choose_profile(on_port, "auto", simulated=False) == "adaptive"
    at_once = parse_machine(text.replace("[axis.Y]\n", '[axis.Y]\nfirst_step = "immediate"\n'), "m")
    assert choose_profile(at_once, "auto", simulated=False) == "exact"
    other = parse_machine(text.replace('"rollover"\n', '"immediate"\n', 1), "m")
    assert choose_profile(other, "auto", simulated=False) == "exact"
    assert choose_profile(read_machine("mill3-step").config, "auto", simulated=False) == "group"


@pytest.mark.parametrize("other", [{"count_latch": '"immediate"'}, {"first_step": '"immediate"'}])
def test_auto_streams_safely_to_chips_of_the_other_reading(other: dict[str, str], tmp_path: Path) -> None:
    config = machine(**other)
    assert choose_profile(config, "auto", simulated=True) == "exact"
    path = tmp_path / "other.toml"
    [(key, value)] = other.items()
    text = read_machine("mill3-step").text.replace('count_latch = "rollover" #', "#")
    path.write_text(text.replace("[sim]\n", f"[sim]\n{key} = {value}\n"))
    program = "G21 G90\nG1 X3 Y2 F300\nG3 X3 Y2 I1 J0\nG1 X8 Y0 F1200\nG1 X0 Y0\nM2\n"
    for seed in (1, 2, 3):
        result = verify(program, str(path), seed=seed)
        assert result.verdict is not None
        assert result.verdict.reasons == ()
