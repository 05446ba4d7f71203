"""The simulated PIC-STEP's status, inputs, outputs and currents (data sheet 2.3, 4.5, 4.6, 5.2)."""

import pytest

from sim.rawhost import steppers
from sim.rawstep import load_count, load_profile
from sim.spec import Switch

item = pytest.mark.item


@item("ST-200", "ST-204", "ST-205", "ST-206", "X-69")
@pytest.mark.parametrize(
    ("mode", "expected"),
    [("velocity", 0x01 | 0x20), ("trapezoid", 0x01 | 0x40), ("no stop", 0x01 | 0x10), ("with stop", 0x01 | 0x10)],
)
def test_mode_bits(mode, expected):
    """ST 5.2: 0 moving, 4 at commanded speed, 5 velocity profile mode, 6 trapezoidal profile mode. X-69."""
    _, host, _ = steppers(mode=0)
    mask = 0x01 | 0x10 | 0x20 | 0x40
    assert host.status(1) & mask == 0
    if mode == "velocity":
        load_profile(host, speed=250, acceleration=20)
    elif mode == "trapezoid":
        load_profile(host, speed=250, acceleration=4, position=50_000)
    else:
        load_count(host, 65000, position=5000 if mode == "with stop" else None)
    host.wait_ms(100)
    assert host.status(1) & mask == expected
    if mode in ("velocity", "trapezoid"):
        host.wait_ms(300 if mode == "trapezoid" else 1300)
        assert host.status(1) & mask == expected | 0x10
    host.wait_ms(3000)
    if mode in ("trapezoid", "with stop"):
        assert host.status(1) & mask == 0


@item("ST-201")
def test_communications_error_bit():
    """ST 5.2 bit 1."""
    _, host, _ = steppers()
    host.link.write(b"\xaa\x01\x0e\x00")
    assert host.listen()[0] & 0x02
    assert not host.status(1) & 0x02


@item("ST-203", "ST-008")
def test_power_sense_bit():
    """ST 5.2 bit 3: the power sense input signal is HIGH."""
    _, host, (chip,) = steppers()
    assert host.status(1) & 0x08
    chip.set_inputs(power=False)
    assert not host.status(1) & 0x08


@item(
    "ST-003",
    "ST-004",
    "ST-010",
    "ST-011",
    "ST-103",
    "ST-208",
    "ST-209",
    "ST-210",
    "ST-211",
    "ST-212",
    "ST-213",
    "ST-214",
    "X-13",
)
@pytest.mark.parametrize(
    ("pin", "bit"), [("estop", 0), ("in1", 1), ("in2", 2), ("limit1", 3), ("limit2", 4), ("home", 5)]
)
def test_inputs_byte(pin, bit):
    """ST 5.2: E-stop, IN1, IN2, LIMIT1, LIMIT2, HOME_SW are bits 0-5; 6 and 7 are undefined: masked."""
    _, host, (chip,) = steppers()
    assert host.items(1, 0x08, 1)[0] & 0x3F == 0
    chip.set_inputs(**{pin: True})
    assert host.items(1, 0x08, 1)[0] & 0x3F == 1 << bit
    chip.set_inputs(**{pin: False})
    assert host.items(1, 0x08, 1)[0] & 0x3F == 0


@item("ST-002", "ST-089", "N-075")
def test_temperature_is_readable_at_any_time():
    """ST 2.3, 4.5: TEMP_SENS analog input, 0..5 V as 0..255, readable also in motion."""
    _, host, (chip,) = steppers()
    load_count(host, 65000)
    for value in (0, 1, 128, 255):
        chip.set_inputs(temperature=value)
        assert host.items(1, 0x02, 1)[0] == value


@item("X-06")
def test_reply_shows_the_state_before_execution():
    """Choice from ST 3.1: the status packet is sent and the command is then executed."""
    _, host, (chip,) = steppers(start_delay_max_ns=0, reply_delay_max_ns=500_000)
    before = host.exchange(1, 0x4, [0x88, *(65000).to_bytes(2, "little"), 10])
    assert not before[0] & 0x01
    assert chip.moving
    assert host.exchange(1, 0x7, [0x05])[0] & 0x01


@item("ST-007", "ST-090", "ST-091", "ST-092")
def test_running_and_holding_current():
    """ST 4.6: running limit when a motion starts, holding limit about 0.25 s after the stop; duty 0..255."""
    _, host, (chip,) = steppers()
    host.exchange(1, 0x6, [3, 1, 211, 37, 0])
    host.wait_ms(300)
    assert chip.current_duty == 37
    load_count(host, 65000, position=20)
    host.wait_ms(2)
    assert chip.current_duty == 211
    while chip.moving:
        host.wait_ms(0.1)
    host.wait_ms(248)
    assert chip.current_duty == 211
    host.wait_ms(3)
    assert chip.current_duty == 37


@item("X-66")
def test_without_amplifier_pulses_move_nothing():
    """Choice: pulses and counter run, the mechanics do not move."""
    switch = Switch("limit1", 10, None)
    sim, host, (chip,) = steppers(switches=(switch,))
    host.exchange(1, 0x7, [0x00])
    load_count(host, 65000, position=100)
    host.wait_ms(1000)
    assert (chip.position, chip.mechanical_steps) == (100, 0)
    assert sim.rules() == ["X-66"]
