from pathlib import Path

import pytest

from machines.errors import ConfigError, MachineError, MachineMissingError
from machines.load import load_machine, parse_machine, read_machine, shipped_machines

GOOD = """
[machine]
name = "small"
[bus.main]
[axis.X]
chip = "pic-step"
bus = "main"
address = 1
steps_per_unit = "200 * 16 / 5"
max_velocity = 10
max_acceleration = 100
travel = [0, "2 * 50"]
"""


def errors_of(text: str) -> list[ConfigError]:
    with pytest.raises(MachineError) as caught:
        parse_machine(text, "m.toml")
    return list(caught.value.errors)


def edited(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


def test_a_small_file_needs_little_and_arithmetic_is_evaluated() -> None:
    config = parse_machine(GOOD, "m.toml")
    assert config.axis["X"].steps_per_unit == 640
    assert config.axis["X"].travel == (0, 100)
    assert config.bus["main"].port == "sim"
    assert config.bus["main"].baud == 115200
    assert config.machine.path_tolerance == 0.01


def test_the_config_is_frozen() -> None:
    config = parse_machine(GOOD, "m.toml")
    with pytest.raises(ValueError, match="frozen"):
        config.machine.name = "other"  # type: ignore[misc]


def test_every_shipped_machine_loads_under_its_own_name() -> None:
    assert "mill3-step" in shipped_machines()
    for name in shipped_machines():
        assert load_machine(name).machine.name == name


def test_mill3_step_is_as_documented() -> None:
    config = load_machine("mill3-step")
    x, y, z = (config.axis[name] for name in "XYZ")
    assert [axis.steps_per_unit for axis in (x, y, z)] == [200, 200, 200]
    assert [axis.max_velocity for axis in (x, y, z)] == [60, 60, 20]
    assert [axis.max_acceleration for axis in (x, y, z)] == [500, 500, 200]
    assert [axis.max_jerk for axis in (x, y, z)] == [None, None, None]
    for axis, (least, greatest) in {"X": (0, 110), "Y": (0, 110), "Z": (-2, 13)}.items():
        low, high = config.axis[axis].travel
        assert low <= least
        assert high >= greatest
    assert config.machine.path_tolerance == 0.010
    assert (config.sim.host_jitter_ms, config.sim.crystal_ppm, config.sim.start_delay_ms) == (0.2, 100, 0.25)
    assert config.bus["main"].baud == 115200
    switches = config.sim.axis["X"]
    assert any(
        at is not None and abs(at) < 12 * 50 for at in (switches.home_at, switches.limit1_at, switches.limit2_at)
    )


def test_three_mistakes_are_three_errors_with_key_path_and_line() -> None:
    text = edited("max_velocity = 10", "max_velocity = 0").replace("address = 1", 'adress = 1\nstep.speed_mode = "3x"')
    unknown, mode, velocity = errors_of(text)
    assert (unknown.line, unknown.key, unknown.message) == (8, "axis.X.adress", "unknown key")
    assert unknown.hint == "did you mean address?"
    assert (mode.line, mode.key) == (9, "axis.X.step.speed_mode")
    assert "'1x'" in mode.message
    assert (velocity.line, velocity.key) == (11, "axis.X.max_velocity")
    assert "greater than 0" in velocity.message


def test_a_missing_key_is_an_error_at_its_table() -> None:
    [error] = errors_of(edited("address = 1\n", ""))
    assert (error.line, error.key, error.message) == (5, "axis.X.address", "required key is missing")


@pytest.mark.parametrize(
    ("old", "new", "key", "words"),
    [
        ('"200 * 16 / 5"', '"200 * * 5"', "axis.X.steps_per_unit", "not a number"),
        ('"200 * 16 / 5"', "0", "axis.X.steps_per_unit", "zero"),
        ('"200 * 16 / 5"', "true", "axis.X.steps_per_unit", "valid number"),
        ('"200 * 16 / 5"', "inf", "axis.X.steps_per_unit", "finite"),
        ("[0, ", "[200, ", "axis.X", "least, greatest"),
        ('[0, "2 * 50"]', "[1, 2, 3]", "axis.X.travel", "at most 2"),
        ('"pic-step"', '"pic-stepp"', "axis.X.chip", "no chip"),
        ('chip = "pic-step"\n', "", "axis.X.chip", "missing"),
        ('bus = "main"', 'bus = "man"', "axis.X.bus", "no [bus.man]"),
        ("address = 1", "address = 2", "axis.X.address", "no module of bus main has address 1"),
        ("address = 1", 'address = "3 / 2"', "axis.X.address", "whole"),
        ("address = 1", "address = 0", "axis.X.address", "greater than or equal to 1"),
        ("max_velocity = 10", "max_velocity = 100", "axis.X.max_velocity", "64,000 steps/s"),
        ("[axis.X]", "[axis.x]", "axis.x", "letters"),
        ("[bus.main]", "[bus.main]\nbaud = 12345", "bus.main", "115200"),
        ("[bus.main]", "[bus.main]\nwatchdog_ms = 5", "bus.main", "at least 30"),
        ("[bus.main]", "[bus.main]\nhost_jitter_ms = 1e6", "bus.main.host_jitter_ms", "less than or equal to 100"),
        ("[machine]", "[sim]\nhost_jitter_ms = 101\n[machine]", "sim.host_jitter_ms", "less than or equal to 100"),
        ("[machine]", "[sim]\ncrystal_ppm = 1e7\n[machine]", "sim.crystal_ppm", "less than or equal to 2000"),
        ("[machine]", "[sim.axis.X]\ncrystal_ppm = -1e7\n[machine]", "sim.axis.X.crystal_ppm", "or equal to -2000"),
        ('[machine]\nname = "small"', '[machines]\nname = "small"', "machines", "unknown"),
        ('[machine]\nname = "small"', "", "machine", "missing"),
        ("[machine]", '[sim.axis.Q]\nhome_at = 1\n[motor.Y2]\naxis = "Y"\n[machine]', "sim.axis.Q", "no axis or motor"),
    ],
)
def test_a_mistake_is_told_with_its_key(old: str, new: str, key: str, words: str) -> None:
    found = {error.key: error.message for error in errors_of(edited(old, new))}
    assert words in found.get(key, ""), found


@pytest.mark.parametrize(
    ("mode", "velocity", "cure"),
    [("1x", 12, '"2x"'), ("2x", 23, '"4x"'), ("4x", 43, '"8x"')],
)
def test_a_speed_mode_that_does_not_reach_the_axis_s_speed_is_refused(mode: str, velocity: int, cure: str) -> None:
    text = edited("max_velocity = 10", f"max_velocity = {velocity}")
    [error] = errors_of(f'{text}[axis.X.step]\nspeed_mode = "{mode}"\n')
    assert (error.line, error.key) == (14, "axis.X.step.speed_mode")
    assert f"speed mode {mode} gives at most" in error.message
    assert f"{velocity * 640:,} steps/s" in error.message
    assert cure in error.hint
    slower = error.hint.rpartition(" ")[2]
    for good in (text.replace(f"max_velocity = {velocity}", f"max_velocity = {slower}"), text):
        kept = mode if slower in good else cure.strip('"')
        parse_machine(f'{good}[axis.X.step]\nspeed_mode = "{kept}"\n', "m.toml")


def test_the_rate_of_a_further_motor_is_checked_as_well() -> None:
    second = '[motor.X2]\naxis = "X"\nchip = "pic-step"\nbus = "main"\naddress = 2\nsteps_per_unit = {}\n{}'
    [fast] = errors_of(GOOD + second.format(6000, ""))
    assert (fast.key, fast.line) == ("motor.X2.steps_per_unit", 18)
    [slow] = errors_of(GOOD + second.format(1280, 'step.speed_mode = "1x"\n'))
    assert (slow.key, slow.line) == ("motor.X2.step.speed_mode", 19)
    assert "max_velocity of [axis.X] at most 5.67" in slow.hint


def test_two_modules_of_one_address_are_refused_where_the_second_stands() -> None:
    second = GOOD[GOOD.index("[axis.X]") :].replace("[axis.X]", "[axis.Y]")
    [error] = errors_of(GOOD + second)
    assert error.key == "axis.Y.address"
    assert error.line == 16
    assert "already that of axis.X" in error.message


@pytest.mark.parametrize(
    "text", ["", "[machine", "a = ", "x = 1\nx = 2", "\x00", "[axis]\nX = 3", "axis = 3", "bus = []"]
)
def test_a_broken_file_gives_errors_and_never_anything_else(text: str) -> None:
    assert errors_of(text)


def test_a_syntax_error_has_its_line() -> None:
    [error] = errors_of('[machine]\nname = "x\n')
    assert error.line == 2
    assert "not TOML" in error.message


def test_the_text_of_an_error_names_file_line_key_and_cure() -> None:
    [error] = errors_of(edited("max_velocity", "max_velocty") + "max_velocity = 10\n")
    assert error.text() == ("m.toml:10: error: axis.X.max_velocty: unknown key\n    hint: did you mean max_velocity?")


def test_a_machine_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(MachineMissingError, match="did you mean mill3-step"):
        load_machine("mill3-stp")
    with pytest.raises(MachineMissingError, match="No such file"):
        load_machine(str(tmp_path / "none.toml"))
    with pytest.raises(MachineMissingError, match="directory"):
        load_machine(str(tmp_path))
    (tmp_path / "latin.toml").write_bytes(b"# \xe9\n")
    with pytest.raises(MachineMissingError, match="UTF-8"):
        load_machine(str(tmp_path / "latin.toml"))


def test_a_path_is_read_and_kept_as_text(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(GOOD, encoding="utf-8")
    file = read_machine(str(path))
    assert file.origin == str(path)
    assert file.text == GOOD
