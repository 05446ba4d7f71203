"""The simulated PIC-STEP's velocity and trapezoidal profiles (data sheet 4.2, 4.3).

Figures are the data sheet's own, or follow from them by the arithmetic shown.
"""

import numpy as np
import pytest

from sim.rawhost import steppers
from sim.rawstep import MODES, count_for, gaps_ns, load_count, load_profile
from sim.steptimer import speed_period

item = pytest.mark.item
four = pytest.mark.parametrize("bits", MODES)


@item("ST-023", "ST-040", "ST-141")
@four
@pytest.mark.parametrize("speed", [1, 7, 100, 250])
def test_profiled_rates(bits, speed):
    """ST 4.2, Table 3: rate = speed x {25, 50, 100, 200}; 250 gives 6250, 12500, 25000, 50000. X-67: within 0.46 %."""
    sim, host, (chip,) = steppers(mode=bits)
    load_profile(host, speed=speed, acceleration=1)
    host.wait_ms(500)
    chip.synchronise()
    assert chip.timer.at_speed
    rate = speed * 25 * MODES[bits][0]
    assert 1e9 / gaps_ns(sim)[-1] == pytest.approx(rate, rel=0.0047)


@item("X-67")
def test_rounding_of_profiled_speeds():
    """Choice: nearest whole count; 34 of the 250 speeds share one with another, the error is at most 0.46 %."""
    periods = [speed_period(speed) for speed in range(1, 251)]
    assert 250 - len(set(periods)) == 34
    errors = [abs(25000 / p / s - 1) for s, p in enumerate(periods, start=1)]
    assert max(errors) == pytest.approx(0.0046, abs=0.0001)


@item("ST-041", "ST-042", "ST-043", "ST-113")
def test_ramp_from_25_to_125_takes_100_ms():
    """ST 4.2: from speed 25 to 125 with acceleration value 4 (= 1 ms) takes 100 ms, one speed a step."""
    _sim, host, (chip,) = steppers(mode=0)
    load_profile(host, speed=25, acceleration=1)
    host.wait_ms(20)
    load_profile(host, speed=125, acceleration=4)
    seen = []
    while chip.timer.speed < 125:
        chip.synchronise()
        seen.append((host.link.now_ns(), chip.timer.speed))
        host.wait_ms(0.05)
    speeds = np.array([s for _, s in seen])
    times = np.array([t for t, _ in seen])
    assert set(np.diff(speeds)) <= {0, 1}
    starts = times[np.flatnonzero(np.diff(speeds)) + 1]
    assert np.diff(starts) == pytest.approx(1e6, abs=1.01e5)
    assert times[-1] - times[speeds == 25][-1] == pytest.approx(99e6, abs=0.2e6)


@item("ST-043")
@pytest.mark.parametrize(("bits", "value", "acceleration"), [(0, 1, 800_000), (0, 255, 3137), (3, 255, 392)])
def test_acceleration_figures(bits, value, acceleration):
    """Derived from ST 4.2: {25, 50, 100, 200} / (0.25 ms x a): 8x a=1 800 000, 8x a=255 3137, 1x a=255 392 steps/s2."""
    _sim, host, (chip,) = steppers(mode=bits)
    load_profile(host, speed=250, acceleration=value)
    host.wait_ms(1)
    chip.synchronise()
    t0, s0 = chip.clock.ns_of(chip.timer.stage_begin), chip.timer.speed
    host.wait_ms(20 if value == 1 else 5000)
    chip.synchronise()
    t1, s1 = chip.clock.ns_of(chip.timer.stage_begin), chip.timer.speed
    assert (s1 - s0) * 25 * MODES[bits][0] / ((t1 - t0) * 1e-9) == pytest.approx(acceleration, rel=1e-3)


@item("ST-041", "ST-124", "ST-133")
def test_velocity_mode_goes_up_and_down_to_the_goal_speed():
    """ST 4.2: the speed is incremented or decremented until the goal; acceleration keeps its value if not loaded."""
    sim, host, (chip,) = steppers(mode=1)
    load_profile(host, speed=200, acceleration=2)
    host.wait_ms(250)
    chip.synchronise()
    assert chip.timer.speed == 200
    load_profile(host, speed=50)
    host.wait_ms(40)
    chip.synchronise()
    assert 50 < chip.timer.speed < 200
    host.wait_ms(60)
    chip.synchronise()
    assert chip.timer.speed == 50
    assert sim.rules() == []


@item("ST-126")
@pytest.mark.parametrize("kind", ["velocity", "trapezoid"])
def test_goal_speed_below_the_minimum_is_replaced(kind):
    """ST 5.1: if the goal speed is less than the minimum profile speed, the minimum profile speed will be used."""
    sim, host, _ = steppers(mode=2, least_speed=40)
    load_profile(host, speed=5, acceleration=1, position=300 if kind == "trapezoid" else None)
    host.wait_ms(100)
    assert gaps_ns(sim) == pytest.approx(1e9 / (40 * 50), rel=1e-3)


@item("ST-127")
def test_nearest_speed_is_the_start_of_the_ramp():
    """ST 5.1: entering velocity mode from an unprofiled mode ramps from the nearest integer speed value."""
    sim, host, (chip,) = steppers(mode=0)
    load_count(host, count_for(20_000, 0), speed=100)
    host.wait_ms(20)
    load_profile(host, speed=120, acceleration=40)
    host.wait_ms(3)
    chip.synchronise()
    assert chip.timer.speed == 100
    host.wait_ms(10)
    chip.synchronise()
    assert chip.timer.speed == 101
    assert sim.rules() == []


@item("ST-039", "ST-129")
@pytest.mark.parametrize("kind", ["count", "velocity"])
def test_reversal_needs_a_stop(kind):
    """ST 4.1, 4.2, 5.1: to change the direction Stop Motor must first be issued; X-60."""
    sim, host, (chip,) = steppers()

    def go(reverse):
        if kind == "count":
            load_count(host, 65000, reverse=reverse)
        else:
            load_profile(host, speed=100, acceleration=1, reverse=reverse)

    go(False)
    host.wait_ms(100)
    go(True)
    host.wait_ms(100)
    assert sim.rules() == ["ST-129"]
    assert chip.timer.direction == 1
    host.exchange(1, 0x7, [0x05])
    go(True)
    host.wait_ms(100)
    assert chip.timer.direction == -1
    assert sim.rules() == ["ST-129"]


@item("ST-050", "ST-051", "ST-123", "ST-124", "ST-125")
@four
@pytest.mark.parametrize("goal", [1, 2, 3, 37, -500, 8000])
def test_trapezoid_ends_on_its_goal(bits, goal):
    """ST 4.3: accelerate, slew at the running speed, decelerate to a stop at the commanded goal position."""
    sim, host, (chip,) = steppers(mode=bits)
    load_profile(host, speed=120, acceleration=3, position=goal)
    host.wait_ms(10_000)
    assert host.position(1) == goal
    assert not chip.moving
    assert len(sim.trace().pulses_ns("M1")) == abs(goal)
    assert sim.rules() == []


@item("ST-050", "ST-051")
@pytest.mark.parametrize("goal", [900, 40_000])
def test_trapezoid_is_symmetric_and_reaches_its_speed(goal):
    """ST 4.3: deceleration occurs at the same rate as the acceleration; a short move is a triangle."""
    sim, host, _ = steppers(mode=0, least_speed=10)
    load_profile(host, speed=150, acceleration=1, position=goal)
    host.wait_ms(5000)
    pulses = sim.trace().pulses_ns("M1")
    gaps = np.diff(pulses)
    top = 1e9 / gaps.min()
    if goal == 40_000:
        assert top == pytest.approx(30_000, rel=0.005)
    else:
        assert 4_000 < top < 29_000
    up, down = pulses[: len(pulses) // 2], pulses[len(pulses) // 2 :]
    assert up[-1] - up[0] == pytest.approx(down[-1] - down[0], rel=0.03)


@item("ST-155", "ST-154")
def test_after_a_smooth_stop_the_trapezoid_needs_its_speed():
    """ST 5.1 Stop Motor: it will have set the goal velocity to zero, so a new one has to be loaded."""
    sim, host, (chip,) = steppers(mode=0, least_speed=20)
    load_profile(host, speed=200, acceleration=1)
    host.wait_ms(100)
    host.exchange(1, 0x7, [0x09])
    host.wait_ms(100)
    assert not chip.moving
    there = host.position(1)
    load_profile(host, position=there + 2000)
    host.wait_ms(100)
    assert gaps_ns(sim)[-1] == pytest.approx(1e9 / 4000, rel=1e-3)  # the least speed, 20 x 200
    assert sim.rules() == ["ST-155"]


@item("X-68")
def test_profiles_begin_at_the_minimum_speed():
    """Choice: least profile speed at once, then one more every acceleration time."""
    sim, host, _ = steppers(mode=0, least_speed=100)
    load_profile(host, speed=103, acceleration=200)
    host.wait_ms(300)
    rates = 1e9 / gaps_ns(sim)
    assert rates[0] == pytest.approx(20_000, rel=1e-3)
    levels = sorted(set(np.round(rates, -1)))
    assert len(levels) == 4
