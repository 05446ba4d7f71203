"""The simulated PIC-SERVO's homing (data sheet 5.2, Set Homing Mode)."""

import pytest

from sim import servokernel as k
from sim.rawhost import FIRM_GAINS, i32, servos
from sim.spec import ServoPlant, Switch

item = pytest.mark.item


HOMING = [
    pytest.param(0x01, "limit1", marks=item("SV-160")),
    pytest.param(0x02, "limit2", marks=item("SV-160")),
    pytest.param(0x08, "index", marks=item("SV-160")),
]


@pytest.mark.parametrize(("flag", "source"), HOMING)
@pytest.mark.parametrize(
    ("manner", "after"),
    [
        pytest.param(0x00, "moving", marks=item("SV-162")),
        pytest.param(0x04, "off", marks=item("SV-161")),
        pytest.param(0x10, "abrupt", marks=item("SV-161", "SV-163")),
        pytest.param(0x20, "smooth", marks=item("SV-161")),
    ],
)
def test_homing(flag, source, manner, after):
    """SV 5.2: capture on change of Limit1, Limit2, Index; stop in one of three manners (version 3 and higher)."""
    switches = () if source == "index" else (Switch(source, 500, None),)
    plant = ServoPlant(index_at_counts=500)
    sim, host, (chip,) = servos(switches=switches, plant=plant)
    host.exchange(1, 0x4, [0x36, *i32(2 * 65536), *i32(655)])
    host.exchange(1, 0x9, [flag | manner])
    assert host.status(1) & 0x80
    host.exchange(1, 0x5)
    host.wait_ms(150)
    assert host.status(1) & 0x80
    host.wait_ms(400)
    assert not host.status(1) & 0x80
    assert host.home(1) == pytest.approx(501, abs=2)  # 2 counts a tick
    if after == "moving":
        assert chip.n[k.GOAL_VELOCITY] != 0
    elif after == "off":
        assert not chip.n[k.SERVO_ON]
    else:
        assert (chip.n[k.SERVO_ON], chip.n[k.VELOCITY]) == (1, 0)
        over = (int(chip.n[k.COMMAND]) >> 16) - 501
        assert (50 < over < 500) if after == "smooth" else (-1 <= over < 10)
    assert sim.rules() == []


@item("SV-161")
def test_before_version_3_homing_does_not_stop():
    """SV 5.2: with versions 1 & 2 the user must stop the motor explicitly."""
    _, host, (chip,) = servos(switches=(Switch("limit1", 500, None),), version=2)
    host.exchange(1, 0x9, [0x11])
    host.exchange(1, 0x4, [0xB6, *i32(2 * 65536), *i32(655)])
    host.wait_ms(800)
    assert host.home(1) == pytest.approx(501, abs=2)
    assert chip.n[k.VELOCITY] == 2 * 65536


@item("SV-160")
def test_homing_on_position_error():
    """SV 4.3, 5.2 bit 6: running the motor up against a stop."""
    plant = ServoPlant(stop_high_counts=800.5)
    _, host, (chip,) = servos(gains=(*FIRM_GAINS[:6], 200, 1, 0), plant=plant)
    host.exchange(1, 0x9, [0x40])
    host.exchange(1, 0x4, [0xB6, *i32(65536), *i32(655)])
    host.wait_ms(1500)
    assert host.home(1) == 800
    assert not chip.n[k.SERVO_ON]
    assert not host.status(1) & 0x80


@item("SV-160")
def test_homing_on_current_limiting():
    """SV 5.2 bit 7: capture when current limiting occurs, here against a stop, and hold there."""
    plant = ServoPlant(stop_high_counts=800.5)
    _, host, (chip,) = servos(gains=(*FIRM_GAINS[:5], 101, 4000, 1, 0), plant=plant)
    host.exchange(1, 0x9, [0x90])
    host.exchange(1, 0x4, [0xB6, *i32(65536), *i32(655)])
    host.wait_ms(1500)
    assert host.home(1) == 800
    assert chip.n[k.SERVO_ON]
    assert chip.n[k.VELOCITY] == 0


@item("SV-161")
def test_two_manners_of_stopping_at_home_are_logged():
    """SV 5.2: one and only one of bits 2, 4 or 5."""
    sim, host, _ = servos()
    host.exchange(1, 0x9, [0x31])
    assert sim.rules() == ["SV-161"]
