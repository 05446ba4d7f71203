"""The simulated PIC-STEP's homing (data sheet 4.4, 5.1) and protections (4.5)."""

import pytest

from sim.rawhost import i32, steppers
from sim.spec import Switch

item = pytest.mark.item
COUNT = (64000).to_bytes(2, "little")
PINS = {"limit1": 0x01, "limit2": 0x02, "home": 0x08}
NO_LIMITS = [0x04, 1, 200, 50, 0]  # limit stop disabled, 8x


def run(host, goal, *, reverse=None):
    back = goal < 0 if reverse is None else reverse
    host.exchange(1, 0x4, [0x99 if back else 0x89, *i32(goal), *COUNT, 50])


def homing_numbers():
    return [("limit1", "ST-060"), ("limit2", "ST-061"), ("home", "ST-062")]


@pytest.mark.parametrize(
    "pin", [pytest.param(p, marks=item(n, "ST-063", "ST-069", "ST-072")) for p, n in homing_numbers()]
)
@pytest.mark.parametrize(
    "leaving", [pytest.param(False, marks=item("ST-071")), pytest.param(True, marks=item("ST-071"))]
)
def test_capture_on_change(pin, leaving):
    """ST 4.4, 5.1: the position is stored when the selected input changes state, in either direction."""
    switch = Switch(pin, None, 99) if leaving else Switch(pin, 100, None)
    sim, host, (chip,) = steppers(mode=0, switches=(switch,))
    host.exchange(1, 0x6, NO_LIMITS)
    host.exchange(1, 0x9, [PINS[pin]])
    run(host, 500)
    host.wait_ms(2000)
    assert host.home(1) == 100
    assert host.position(1) == 500
    assert not chip.moving
    assert sim.violations == []


@item("ST-063")
@pytest.mark.parametrize("flags", range(1, 8))
def test_any_flagged_condition_triggers_and_no_other(flags):
    """ST 5.1: capture when any of the flagged homing conditions occur."""
    places = {"limit1": 300, "limit2": 200, "home": 100}
    _sim, host, _ = steppers(mode=0, switches=tuple(Switch(p, at, None) for p, at in places.items()))
    host.exchange(1, 0x6, NO_LIMITS)
    mask = sum(bit for k, bit in enumerate(PINS.values()) if flags >> k & 1)
    host.exchange(1, 0x9, [mask])
    run(host, 500)
    host.wait_ms(2000)
    assert host.home(1) == min(at for k, at in enumerate(places.values()) if flags >> k & 1)


@pytest.mark.parametrize(
    ("manner", "distance", "amplifier"),
    [
        pytest.param(0x00, 400, True, marks=item("ST-070")),
        pytest.param(0x04, 0, False, marks=item("ST-064")),
        pytest.param(0x10, 0, True, marks=item("ST-065")),
        pytest.param(0x20, 100, True, marks=item("ST-066")),
    ],
)
def test_stop_on_home(manner, distance, amplifier):
    """ST 4.4: 1) decelerating to a stop, 2) stopping abruptly, 3) turning the motor off altogether; or none of them."""
    sim, host, (chip,) = steppers(mode=0, switches=(Switch("home", 100, None),))
    host.exchange(1, 0x4, [0x04, 2])
    host.exchange(1, 0x9, [0x08 | manner])
    run(host, 500)
    host.wait_ms(2000)
    assert host.home(1) == 100
    over = host.position(1) - 100
    if manner == 0x20:
        assert 0 < over < 400
    else:
        assert over == distance
    assert bool(host.status(1) & 0x04) == amplifier
    assert not chip.moving
    assert sim.violations == []


@item("ST-068", "ST-070", "ST-207")
def test_homing_bit_and_no_motion_by_itself():
    """ST 5.1: home_in_progress is set when the command is issued and lowered when found; no motion."""
    sim, host, (chip,) = steppers(mode=0, switches=(Switch("home", 100, None),))
    host.exchange(1, 0x9, [0x08])
    host.wait_ms(500)
    assert host.status(1) & 0x80
    assert not chip.moving
    run(host, 500)
    host.wait_ms(2000)
    assert not host.status(1) & 0x80
    assert sim.incidents[-1].what == "home captured at 100"


@item("X-74")
def test_change_is_measured_from_arming():
    """Choice: armed on an input that is already HIGH, the capture is when it goes LOW."""
    _sim, host, _ = steppers(mode=0, switches=(Switch("home", 0, 49),))
    host.exchange(1, 0x9, [0x08])
    host.wait_ms(10)
    assert host.status(1) & 0x80
    run(host, 500)
    host.wait_ms(2000)
    assert host.home(1) == 50


@item("ST-067")
def test_two_manners_of_stopping_are_logged():
    """ST 5.1: one and only one of bits 2, 4 or 5; bits 6 and 7 not used."""
    sim, host, _ = steppers()
    host.exchange(1, 0x9, [0x38])
    host.exchange(1, 0x9, [0xC8])
    host.wait_ms(1)
    assert sim.rules() == ["ST-067", "ST-067"]


# -- limits -----------------------------------------------------------------------------------------------------------


@item("ST-080", "ST-081", "ST-083", "ST-003", "X-71")
@pytest.mark.parametrize(("pin", "sign"), [("limit1", 1), ("limit2", -1)])
@pytest.mark.parametrize("mode", ["count", "velocity", "trapezoid"])
def test_limit_stops_and_lets_back_off(pin, sign, mode):
    """ST 4.5: LIMIT1 HIGH inhibits forward motion, LIMIT2 reverse; running into one stops; moving off it is allowed."""
    switch = Switch(pin, 100, None) if sign > 0 else Switch(pin, None, -100)
    sim, host, (chip,) = steppers(mode=0, switches=(switch,))
    back = 0x10 if sign < 0 else 0

    def go(way):
        turn = back if way > 0 else back ^ 0x10
        if mode == "count":
            host.exchange(1, 0x4, [0x88 | turn, *COUNT, 50])
        elif mode == "velocity":
            host.exchange(1, 0x4, [0x86 | turn, 50, 1])
        else:
            host.exchange(1, 0x4, [0x87, *i32(chip.position + way * sign * 500), 50, 1])

    go(1)
    host.wait_ms(1000)
    assert host.position(1) == 100 * sign
    assert not chip.moving
    go(1)
    host.wait_ms(100)
    assert host.position(1) == 100 * sign
    assert sim.incidents[-1].what.startswith("motion inhibited")
    host.exchange(1, 0x7, [0x05])
    go(-1)
    host.wait_ms(1000)
    assert (host.position(1) - 100 * sign) * sign < 0
    assert sim.violations == []


@item("ST-082", "ST-144")
@pytest.mark.parametrize("off", [False, True])
def test_motor_off_at_limit(off):
    """ST 4.5, 5.1 bit 4: optionally the motor will be turned off."""
    _, host, (chip,) = steppers(mode=0, switches=(Switch("limit1", 100, None),))
    host.exchange(1, 0x6, [0x10 if off else 0x00, 1, 200, 50, 0])
    run(host, 500)
    host.wait_ms(1000)
    assert host.position(1) == 100
    assert bool(host.status(1) & 0x04) != off
    assert not chip.moving


@item("ST-084", "ST-142")
def test_limit_stop_can_be_disabled():
    """ST 4.5, 5.1 bit 2."""
    _, host, _ = steppers(mode=0, switches=(Switch("limit1", 100, None),))
    host.exchange(1, 0x6, NO_LIMITS)
    run(host, 500)
    host.wait_ms(1000)
    assert host.position(1) == 500


@item("X-70")
@pytest.mark.parametrize("slowing", [False, True])
def test_limit_acts_abruptly_also_in_a_smooth_stop(slowing):
    """Choice: pulses towards the limit are inhibited at once, whatever the chip is doing."""
    _, host, (chip,) = steppers(mode=0, switches=(Switch("limit1", 3100, None),))
    host.exchange(1, 0x4, [0x86, 100, 40])
    while chip.position < 3000:
        host.wait_ms(0.2)
    if slowing:
        host.exchange(1, 0x7, [0x09])
        assert chip.moving
    host.wait_ms(1000)
    assert host.position(1) == 3100
    assert not chip.moving


@item("ST-010", "ST-085", "ST-143")
@pytest.mark.parametrize(
    ("flags", "stops", "off"), [(0x00, True, False), (0x10, True, True), (0x08, False, False), (0x18, False, False)]
)
def test_estop(flags, stops, off):
    """ST 2.3, 4.5: ESTOP HIGH terminates any motion, optionally motor off; can be disabled with bit 3."""
    _, host, (chip,) = steppers(mode=0)
    host.exchange(1, 0x6, [flags, 1, 200, 50, 0])
    run(host, 5000)
    host.wait_ms(100)
    chip.set_inputs(estop=True)
    assert chip.moving != stops
    assert bool(host.status(1) & 0x04) != off
    run(host, 9000)
    host.wait_ms(50)
    assert chip.moving != stops


@item("ST-008", "ST-086")
def test_power_sense_low_lowers_amp_en_and_ends_motion():
    """ST 2.3, 4.5: AMP_EN is lowered and any motion terminated; it stays low as long as the input does."""
    _, host, (chip,) = steppers(mode=0)
    host.exchange(1, 0x6, [0x1C, 1, 200, 50, 0])
    run(host, 5000)
    host.wait_ms(100)
    chip.set_inputs(power=False)
    assert not chip.moving
    assert not host.status(1) & 0x04
    host.exchange(1, 0x7, [0x01])
    assert not host.status(1) & 0x04
    run(host, 9000)
    host.wait_ms(50)
    assert not chip.moving
    chip.set_inputs(power=True)
    assert not host.status(1) & 0x04
    host.exchange(1, 0x7, [0x01])
    host.wait_ms(1)
    assert host.status(1) & 0x04


@item("ST-087", "ST-088")
@pytest.mark.parametrize(
    ("threshold", "temperature", "trips"),
    [(100, 99, True), (100, 100, False), (255, 254, True), (1, 0, True), (0, 0, False)],
)
def test_thermal_limit(threshold, temperature, trips):
    """ST 4.5: the voltage falls as the motor warms, so a reading below the threshold turns it off; 0 disables."""
    _, host, (chip,) = steppers(mode=0)
    host.exchange(1, 0x6, [0x00, 1, 200, 50, threshold])
    run(host, 50_000)
    host.wait_ms(100)
    assert chip.moving
    chip.set_inputs(temperature=temperature)
    assert chip.moving != trips
    assert bool(host.status(1) & 0x04) != trips
