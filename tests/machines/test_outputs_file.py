"""Spindle, coolant and outputs in a machine file: every mistake with its key path."""

import pytest

from machines.errors import ConfigError, MachineError
from machines.load import parse_machine, read_machine
from machines.outputs import STEP_OUTPUTS, panel_of, switched_pins
from nmc.chips import picio, picservo, picstep
from nmc.codec import decode

TEXT = read_machine("mill3-spindle").text
SPINDLE = TEXT[TEXT.index("[spindle]") : TEXT.index("[coolant]")]
PINS = """[spindle]
drive = "output"
max_rpm = 4000
ramp_time = 0.5
on = { module = "io", pin = "bit4" }
reverse = { module = "io", pin = "bit5" }
speed = { module = "io", pin = "pwm2" }
"""


def edited(*pairs: tuple[str, str]) -> str:
    text = TEXT
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def errors_of(text: str) -> list[ConfigError]:
    with pytest.raises(MachineError) as caught:
        parse_machine(text, "m.toml")
    return list(caught.value.errors)


MISTAKES = [
    pytest.param([("drive = \"velocity\"", "drive = \"belt\"")], "spindle.drive", "should be", id="no such drive"),
    pytest.param([('counts_per_rev = "4 * 100"', "")], "spindle.counts_per_rev", "missing", id="no encoder"),
    pytest.param([("max_rpm = 4000", "max_rpm = 80000")], "spindle.counts_per_rev", "533,333 counts/s", id="too fast"),
    pytest.param([("min_rpm = 100", "min_rpm = 4000")], "spindle.min_rpm", "not below", id="empty range"),
    pytest.param([("settle_time = 0.3", "settle_time = 0.01")], "spindle.settle_time", "0.1 s", id="no time to read"),
    pytest.param([("min_rpm = 100", "pwm_at_max = 200")], "spindle.pwm_at_max", "no such key", id="key of another"),
    pytest.param([("min_rpm = 100", "at_speed = 0.9")], "spindle.at_speed", "0.5", id="any speed"),
    pytest.param([("address = 4", "address = 3")], "spindle.address", "already that of axis.Z", id="address taken"),
    pytest.param([("bus = \"main\"\naddress = 4", "bus = \"other\"\naddress = 4")], "spindle.bus", "no [bus.other]",
                 id="no such bus"),
    pytest.param([('flood = { module = "Z"', 'flood = { module = "Q"')], "coolant.flood.module", "no module Q",
                 id="no such module"),
    pytest.param([('pin = "out1"', 'pin = "out6"')], "coolant.flood.pin", "no pin out6", id="no such pin"),
    pytest.param([('pin = "out2"', 'pin = "out1"')], "coolant.mist.pin", "already coolant.flood", id="pin taken"),
    pytest.param([('pin = "bit0"', 'pin = "pwm2"')], "output.0.pin", "no pin pwm2", id="a value is no switch"),
    pytest.param([('pin = "pwm1"', 'pin = "bit3"')], "analog.0.pin", "no pin bit3", id="a switch has no value"),
    pytest.param([("[output.1]", "[output.first]")], "output.first", "has a number", id="no number"),
    pytest.param([("[output.1]", "[output.01]")], "output.01", "has a number", id="number with a zero"),
    pytest.param([('on_stop = "keep"', 'on_stop = "maybe"')], "output.0.on_stop", "should be", id="maybe"),
    pytest.param([("[module.io]", "[module.spindle]")], "module.spindle", "is the name of", id="name taken"),
    pytest.param([('{ module = "Z", pin = "out1" }', '{ module = "spindle", pin = "pwm" }')], "coolant.flood.pin",
                 "no pin pwm", id="the spindle's own pwm"),
    pytest.param([(SPINDLE, PINS), ("address = 5", "address = 4"), ('on = { module = "io", pin = "bit4" }\n', "")],
                 "spindle.on", "missing", id="nothing to switch"),
    pytest.param([(SPINDLE, PINS.replace('module = "io", pin = "bit5"', 'module = "Z", pin = "out4"')),
                  ('chip = "pic-io"\nbus = "main"\naddress = 5', 'chip = "pic-io"\nbus = "second"\naddress = 1'),
                  ("[axis.X]", "[bus.second]\n[axis.X]")],
                 "spindle.on.module", "several buses", id="pins on several buses"),
]  # fmt: skip


@pytest.mark.parametrize(("pairs", "key", "words"), MISTAKES)
def test_every_mistake_has_its_key(pairs: list[tuple[str, str]], key: str, words: str) -> None:
    found = errors_of(edited(*pairs))
    assert [(error.key, words in error.message) for error in found if error.key == key] == [(key, True)], found
    assert all(error.line for error in found)


def test_a_limit_pin_that_is_an_output_is_no_home_switch() -> None:
    text = read_machine("mill3-mixed").text + '\n[coolant]\nflood = { module = "X", pin = "limit2" }\n'
    assert [(error.key, error.message) for error in errors_of(text)] == [
        ("axis.X.home.switch", "limit2 of X is the output coolant.flood")
    ]


def test_machines_without_these_tables_have_nothing_to_say() -> None:
    panel = panel_of(read_machine("mill3-step").config)
    assert list(panel.start()) == []
    assert list(panel.off(stopping=True)) == []


def test_the_pins_go_off_first_of_the_spindle_then_of_the_coolant() -> None:
    config = parse_machine(edited((SPINDLE, PINS), ("address = 5", "address = 4")), "m.toml")
    assert list(switched_pins(config)) == [
        "spindle on", "spindle reverse", "flood", "mist", "output 0", "output 1",
    ]  # fmt: skip


def test_a_word_keeps_the_pins_that_are_not_meant() -> None:
    panel = panel_of(parse_machine(TEXT, "m.toml"))
    start = [(exchange.address, exchange.command, exchange.data) for exchange in panel.start()]
    # PIC-STEP data sheet, section 5.1, Set Outputs; OUT5 (bit 4) stays HIGH as after power-up; mist is active low
    assert start[0] == (3, 0x8, bytes([STEP_OUTPUTS | 0b10]))
    flood = panel.switch("flood", True)
    assert decode(picstep.FACTS, flood.command, flood.data).values["outputs"] == 0b10011
    mist = panel.switch("mist", True)
    assert decode(picstep.FACTS, mist.command, mist.data).values["outputs"] == 0b10001
    panel.switch("output 1", True)
    vacuum = panel.switch("output 0", True)
    assert decode(picio.FACTS, vacuum.command, vacuum.data).values["outputs"] == 0b11
    assert panel.levels == {"flood": 1, "mist": 1, "output 0": 1, "output 1": 1, "analog 0": 0}


def test_a_stop_keeps_what_it_must_keep_and_the_end_of_a_program_keeps_outputs() -> None:
    panel = panel_of(parse_machine(TEXT, "m.toml"))
    list(panel.start())
    for name in ("flood", "output 0", "output 1"):
        panel.switch(name, True)
    panel.set("analog 0", 77)
    list(panel.off(stopping=False))
    assert panel.levels == {"flood": 0, "mist": 0, "output 0": 1, "output 1": 1, "analog 0": 77}
    list(panel.off(stopping=True))
    assert panel.levels == {"flood": 0, "mist": 0, "output 0": 1, "output 1": 0, "analog 0": 0}


def test_limit_pins_of_a_servo_become_outputs() -> None:
    text = read_machine("mill3-mixed").text + '\n[coolant]\nmist = { module = "Y", pin = "limit2" }\n'
    panel = panel_of(parse_machine(text, "m.toml"))
    [off] = panel.start()
    on = panel.switch("mist", True)
    decoded = [decode(picservo.FACTS, each.command, each.data).values for each in (off, on)]
    assert [each["limit2_output"] for each in decoded] == [0, 1]
    assert all((each["limit1_is_input"], each["limit2_is_input"]) == (1, 0) for each in decoded)
