"""Ranges, step timer, homing and status of a PIC-STEP as the driver knows them, by the PIC-STEP data sheet."""

from __future__ import annotations

import pytest

from nmc.chips import picstep
from nmc.chips.picstep import COUNT_MAX, COUNT_MIN, SPEED_MODES
from nmc.chips.table4 import Mode
from nmc.codec import decode_status
from nmc.errors import LocalFault, RemoteFault
from nmc.picstep import PicStep
from nmc.program import Exchange

item = pytest.mark.item


# -- ranges and the step timer -----------------------------------------------------------------------------------------


@item("ST-020", "ST-035")
def test_the_fastest_count_is_50000_steps_a_second() -> None:
    """ST 1.0: up to 50,000 steps/second; the least and greatest rates of the four modes follow from the counts."""
    rates = {name: (mode.rate_min_hz, mode.rate_max_hz) for name, mode in SPEED_MODES.items()}
    assert rates["8x"][1] == pytest.approx(50_000)
    expected = {"1x": (9.537, 7267), "2x": (19.07, 14205), "4x": (38.14, 27174), "8x": (76.28, 50000)}
    for name, (least, greatest) in expected.items():
        assert rates[name] == (pytest.approx(least, rel=1e-3), pytest.approx(greatest, rel=1e-3))


@item("ST-022")
def test_the_four_modes_of_motion(step: PicStep, rig) -> None:
    """ST 1.0: profiled velocity, unprofiled velocity, trapezoidal position, unprofiled position."""
    tracker = rig.bus.guard.modules[1]
    ways = {
        Mode.VELOCITY: {"speed": 20, "acceleration_time": 5},
        Mode.UNPROFILED: {"timer_count": 60000, "endless": True},
        Mode.TRAPEZOID: {"position": 3000, "speed": 20, "acceleration_time": 5},
        Mode.UNPROFILED_STOP: {"position": 9000, "timer_count": 60000},
    }
    for mode, load in ways.items():
        step.load_trajectory(start_now=True, **load)
        assert tracker.mode is mode
        step.stop_motor("abruptly")
    assert rig.simulation.violations == []


@item("ST-023", "ST-121", "ST-122")
@pytest.mark.parametrize("bad", [{"speed": 0}, {"speed": 251}, {"acceleration_time": 0}, {"acceleration_time": 256}])
def test_profile_ranges(step: PicStep, rig, bad: dict[str, int]) -> None:
    """ST 4.2, 5.1: speed 1 to 250, acceleration 1 to 255."""
    before = rig.count()
    with pytest.raises(LocalFault, match="outside"):
        step.load_trajectory(**bad)
    assert rig.count() == before
    for speed, acceleration_time in ((1, 1), (250, 255)):
        step.load_trajectory(speed=speed, acceleration_time=acceleration_time)


@item("ST-024", "ST-040")
def test_lowest_profiled_rates() -> None:
    """ST 4.2, table 3: resolution 25, 50, 100, 200 steps/s; 6250 to 50000 at speed 250."""
    assert [mode.rate_step_hz for mode in SPEED_MODES.values()] == [25, 50, 100, 200]
    assert [mode.rate_step_hz * 250 for mode in SPEED_MODES.values()] == [6_250, 12_500, 25_000, 50_000]
    assert all(mode.rate_min_hz < mode.rate_step_hz for mode in SPEED_MODES.values()), "even lower in unprofiled modes"


@item("ST-031", "ST-032", "ST-033")
@pytest.mark.parametrize(
    ("name", "clock_hz", "extra"), [("1x", 625e3, 2), ("2x", 1.25e6, 4), ("4x", 2.5e6, 8), ("8x", 5e6, 16)]
)
@pytest.mark.parametrize("rate", [100, 333, 1000, 5000])
def test_count_formula(name: str, clock_hz: float, extra: int, rate: int) -> None:
    """ST 4.1, table 2: count = 65536 - clock / S + {2, 4, 8, 16}; the period that it gives is 1 / S."""
    mode = SPEED_MODES[name]
    count = round(65_536 - clock_hz / rate + extra)
    assert mode.clock_hz == clock_hz
    assert 1e9 / mode.period_ns(count) == pytest.approx(rate, rel=rate / clock_hz)


@item("ST-034")
@pytest.mark.parametrize("count", [0, COUNT_MAX + 1, 65_535])
def test_count_range(step: PicStep, rig, count: int) -> None:
    """ST 4.1: the maximum allowable initial timer count is 65,452, and the minimum is 1."""
    assert (COUNT_MIN, COUNT_MAX) == (1, 65_452)
    before = rig.count()
    with pytest.raises(LocalFault, match="outside"):
        step.load_trajectory(position=5, timer_count=count)
    assert rig.count() == before


@item("ST-036")
def test_check_values_of_the_count() -> None:
    """Derived from table 2: 8x 50,000/s is 65452; 1x 25/s is 40538; 1x 6250/s is 65438."""
    assert SPEED_MODES["8x"].profile_count(250) == 65_452
    assert SPEED_MODES["1x"].profile_count(1) == 40_538
    assert SPEED_MODES["1x"].profile_count(250) == 65_438


@item("ST-039", "ST-129", "X-63", "X-64")
def test_a_reversal_needs_stop_motor(step: PicStep, rig) -> None:
    """ST 4.1 and 4.2, notes: a Stop Motor command must first be issued before a speed in the opposite direction."""
    step.load_trajectory(position=40, timer_count=64000, start_now=True)
    with pytest.raises(LocalFault, match="direction"):
        step.load_trajectory(timer_count=64000, reverse=True)
    step.wait_until_stopped(1_000_000_000)
    with pytest.raises(LocalFault, match="Stop Motor first"):
        step.load_trajectory(position=0, timer_count=64000, reverse=True)
    step.stop_motor("abruptly")
    step.load_trajectory(position=0, timer_count=64000, reverse=True, start_now=True)
    step.wait_until_stopped(1_000_000_000)
    assert step.position() == 0
    assert rig.simulation.violations == []


# -- homing ------------------------------------------------------------------------------------------------------------


@item("ST-060", "ST-061", "ST-062", "ST-063", "ST-064", "ST-065", "ST-066")
@pytest.mark.parametrize(
    ("switches", "stop", "byte"),
    [
        (("limit1",), "none", 0x01),
        (("limit2",), "motor_off", 0x06),
        (("home_switch",), "abruptly", 0x18),
        (("limit1", "limit2", "home_switch"), "smoothly", 0x2B),
    ],
)
def test_homing_bytes(rig, switches: tuple[str, ...], stop: str, byte: int) -> None:
    """ST 5.1, Set Homing Mode: 0x19 and the control byte."""
    rig.step.set_homing_mode(*switches, stop=stop)  # type: ignore[arg-type]
    assert rig.last() == bytes([0x19, byte])


@item("ST-067")
@pytest.mark.parametrize("byte", [0x14, 0x24, 0x30, 0x34, 0x40, 0x80])
def test_one_manner_of_stop_at_home(rig, byte: int) -> None:
    """ST 5.1: one (and only one) of bits 2, 4 or 5; bits 6 and 7 clear."""
    before = rig.count()
    with pytest.raises(LocalFault):
        rig.bus.exchange(Exchange(1, 9, bytes([byte | 1])))
    assert rig.count() == before


@item("ST-068", "ST-069", "ST-070", "ST-071", "ST-072")
def test_home_is_searched_and_read(homed_rig) -> None:
    """ST 4.4: arm, move, watch the homing bit, read the home register."""
    step = homed_rig.ready()
    step.set_homing_mode("home_switch", stop="abruptly")
    assert "moving" not in step.no_operation().flags
    assert "homing_in_progress" in step.no_operation().flags
    found = step.find_home("home_switch", speed=10, acceleration_time=5, reverse=False, timeout_ns=3_000_000_000)
    assert found.home_position == 150


# -- status ------------------------------------------------------------------------------------------------------------


@item("ST-200", "ST-201", "ST-202", "ST-203", "ST-204", "ST-205", "ST-206", "ST-207")
def test_status_bits_in_words() -> None:
    """ST 5.2: the eight bits of the status byte."""
    names = [
        "moving",
        "communications_error",
        "amplifier_enabled",
        "power_sense",
        "at_commanded_speed",
        "velocity_profile_mode",
        "trapezoidal_profile_mode",
        "homing_in_progress",
    ]
    for bit, name in enumerate(names):
        assert decode_status(picstep.FACTS, 1 << bit, 0, b"").flags == {name}


@item("ST-208", "ST-209", "ST-210", "ST-211", "ST-212", "ST-213", "ST-214", "X-13")
def test_input_bits_in_words() -> None:
    """ST 5.2: E-stop, IN1, IN2, LIMIT1, LIMIT2, HOME_SW; bits 6 and 7 are undefined and left out."""
    for bit, name in enumerate(["estop", "in1", "in2", "limit1", "limit2", "home_switch"]):
        values = decode_status(picstep.FACTS, 0, 0x08, bytes([1 << bit])).values
        assert [key for key, value in values.items() if "." in key and value] == [f"inputs.{name}"]
    assert sum("." in key for key in decode_status(picstep.FACTS, 0, 0x08, b"\xc0").values) == 6


@item("ST-008", "ST-086")
def test_lost_power_is_a_fault(step: PicStep, rig) -> None:
    """ST 4.5: a LOW power sense input ends any motion; the armed driver says so at the next answer."""
    rig.bus.arm_faults(1, low=picstep.STATUS_POWER)
    step.no_operation()
    fault = rig.bus.guard.modules[1].judge(0x04)
    assert isinstance(fault, RemoteFault)
    assert "power_sense is clear" in str(fault)
