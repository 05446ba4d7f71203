"""The simulated PIC-STEP against its data sheet: pins, timer, profiles, commands, status.

Figures are the data sheet's own, or follow from them by the arithmetic shown.
"""

import numpy as np
import pytest

from sim.rawhost import i32, machine, steppers
from sim.spec import StepModule, Switch
from sim.steptimer import speed_period

item = pytest.mark.item
MODES = {3: (1, 625_000), 2: (2, 1_250_000), 1: (4, 2_500_000), 0: (8, 5_000_000)}  # mode bits: multiple, clock in Hz
four = pytest.mark.parametrize("bits", MODES)


def count_for(rate, bits):
    """Section 4.1, Table 2: 65,536 - clock / S + {2, 4, 8, 16}."""
    multiple, clock = MODES[bits]
    return round(65536 - clock / rate + 2 * multiple)


def load_count(host, count, *, reverse=False, position=None, speed=10, start=True, address=1):
    control = 0x08 | (0x10 if reverse else 0) | (0x80 if start else 0)
    data = b"" if position is None else i32(position)
    control |= 0x01 if position is not None else 0
    host.exchange(address, 0x4, [control, *data, *count.to_bytes(2, "little"), speed])


def profile(host, *, speed=None, acceleration=None, position=None, reverse=False, start=True):
    control = (0x10 if reverse else 0) | (0x80 if start else 0)
    data = b""
    for bit, value in ((1, position), (2, speed), (4, acceleration)):
        if value is not None:
            control |= bit
            data += i32(value) if bit == 1 else bytes([value])
    host.exchange(1, 0x4, [control, *data])


def gaps_ns(sim, name="M1"):
    return np.diff(sim.trace().pulses_ns(name))


def rules(sim):
    return [v.rule for v in sim.violations]


# -- ranges and step timer --------------------------------------------------------------------------------------------


@item("ST-020", "ST-030", "ST-031", "ST-032", "ST-033", "ST-035", "ST-036")
@pytest.mark.parametrize(
    ("bits", "count", "rate"),
    [
        (0, 65452, 50_000),
        (3, 40538, 25),
        (3, 65438, 6250),
        (3, 1, 9.537),
        (3, 65452, 7267),
        (2, 1, 19.07),
        (2, 65452, 14205),
        (1, 1, 38.14),
        (1, 65452, 27174),
        (0, 1, 76.28),
    ],
)
def test_count_gives_rate(bits, count, rate):
    """ST 4.1, Table 2: S = clock / (65536 - count + {2,4,8,16}), clocks 625 kHz, 1.25, 2.5 and 5 MHz; 1..65452."""
    sim, host, _ = steppers(mode=bits)
    load_count(host, count)
    host.wait_ms(4e3 / rate)
    gaps = gaps_ns(sim)
    assert len(gaps) >= 2
    assert 1e9 / gaps == pytest.approx(rate, rel=3e-4)
    assert rules(sim) == []


@item("ST-006", "ST-030")
def test_pulses_leave_room_for_their_width():
    """ST 2.3: STEP is a rising pulse of 4.8 us; even at the greatest rate one ends long before the next begins."""
    sim, host, _ = steppers(mode=0)
    load_count(host, 65452)
    host.wait_ms(5)
    assert gaps_ns(sim).min() > 4 * 4800


@item("ST-034", "X-73")
@pytest.mark.parametrize(("count", "taken"), [(0, 1), (65453, 65452), (65535, 65452), (1, 1), (65452, 65452)])
def test_counts_outside_the_range_are_brought_into_it(count, taken):
    """ST 4.1: the maximum allowable initial timer count is 65,452 and the minimum is 1. Choice: clamp and log."""
    sim, host, _ = steppers()
    load_count(host, count)
    host.wait_ms(250)
    assert host.items(1, 0x04, 2) == taken.to_bytes(2, "little")
    assert rules(sim) == ([] if count == taken else ["X-73"])


@item("ST-021", "X-51")
def test_counter_wraps_at_32_bits():
    """ST 1.0: a 32-bit position counter. Choice: two's complement, no flag."""
    sim, host, (chip,) = steppers(mode=0)
    host.exchange(1, 0x4, [0x89, *i32(0x7FFFFFFF), *(65452).to_bytes(2, "little"), 250])
    host.link.sleep_until(0x7FFFFFFF * 20_000 + host.link.now_ns() + 1_000_000_000)
    assert host.position(1) == 0x7FFFFFFF
    assert not chip.moving
    load_count(host, 65452)
    host.wait_ms(1)
    assert -0x80000000 < host.position(1) < -0x80000000 + 100
    assert rules(sim) == []


@item("ST-005", "ST-037", "ST-115", "ST-128")
@pytest.mark.parametrize("reverse", [False, True])
def test_direction_bit_turns_unprofiled_and_velocity_motion(reverse):
    """ST 4.1, 5.1: bit 4, 0 = forward, 1 = reverse; DIR LOW is forward."""
    for way in ("count", "velocity"):
        sim, host, _ = steppers()
        if way == "count":
            load_count(host, 65000, reverse=reverse)
        else:
            profile(host, speed=100, acceleration=1, reverse=reverse)
        host.wait_ms(300)
        assert np.sign(host.position(1)) == (-1 if reverse else 1)
        assert set(sim.trace().run_dir) == {-1 if reverse else 1}


@item("ST-022", "ST-024", "ST-038", "ST-123")
@pytest.mark.parametrize("stop", [1, 2, 777, -1, -300])
def test_unprofiled_position_mode(stop):
    """ST 4.1: count and stopping position together: constant speed, abrupt stop exactly there."""
    sim, host, (chip,) = steppers(mode=1)
    load_count(host, 64000, position=stop, reverse=stop < 0)
    host.wait_ms(2000)
    assert host.position(1) == stop
    assert not chip.moving
    gaps = gaps_ns(sim)
    assert len(gaps) == abs(stop) - 1
    assert gaps == pytest.approx((65536 - 64000 + 8) / 2.5e6 * 1e9, rel=1e-6)


@item("X-61")
@pytest.mark.parametrize("latch", ["rollover", "immediate"])
def test_when_a_new_count_acts(latch):
    """Choice: at the next roll-over (section 4.1: 'reloaded with the initial timer count'), or at once, by name."""
    sim, host, _ = steppers(mode=0, count_latch=latch)
    load_count(host, 1)  # 13.1 ms
    host.wait_ms(15)
    load_count(host, 65452)
    host.wait_ms(15)
    gaps = gaps_ns(sim)
    slow = 65551 * 200
    assert (gaps[0] == pytest.approx(slow, rel=1e-6)) == (latch == "rollover")
    assert gaps[1:] == pytest.approx(20_000, rel=1e-6)


@item("X-62")
@pytest.mark.parametrize("first", ["period", "immediate"])
def test_first_pulse_after_a_start(first):
    """Choice: one full period after execution, or at once, by name."""
    sim, host, _ = steppers(mode=0, first_pulse=first, start_delay_max_ns=0)
    load_count(host, 1, start=False)
    host.send(1, 0x5)
    executed = sim.buses[0].command.free_ns
    host.wait_ms(40)
    delay = sim.trace().pulses_ns("M1")[0] - executed
    assert delay - (65551 * 200 if first == "period" else 0) == pytest.approx(0, abs=201)  # one base tick


# -- velocity profile -------------------------------------------------------------------------------------------------


@item("ST-023", "ST-040", "ST-141")
@four
@pytest.mark.parametrize("speed", [1, 7, 100, 250])
def test_profiled_rates(bits, speed):
    """ST 4.2, Table 3: rate = speed x {25, 50, 100, 200}; 250 gives 6250, 12500, 25000, 50000. X-67: within 0.46 %."""
    sim, host, (chip,) = steppers(mode=bits)
    profile(host, speed=speed, acceleration=1)
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
    profile(host, speed=25, acceleration=1)
    host.wait_ms(20)
    profile(host, speed=125, acceleration=4)
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
    profile(host, speed=250, acceleration=value)
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
    profile(host, speed=200, acceleration=2)
    host.wait_ms(250)
    chip.synchronise()
    assert chip.timer.speed == 200
    profile(host, speed=50)
    host.wait_ms(40)
    chip.synchronise()
    assert 50 < chip.timer.speed < 200
    host.wait_ms(60)
    chip.synchronise()
    assert chip.timer.speed == 50
    assert rules(sim) == []


@item("ST-126")
@pytest.mark.parametrize("kind", ["velocity", "trapezoid"])
def test_goal_speed_below_the_minimum_is_replaced(kind):
    """ST 5.1: if the goal speed is less than the minimum profile speed, the minimum profile speed will be used."""
    sim, host, _ = steppers(mode=2, least_speed=40)
    profile(host, speed=5, acceleration=1, position=300 if kind == "trapezoid" else None)
    host.wait_ms(100)
    assert gaps_ns(sim) == pytest.approx(1e9 / (40 * 50), rel=1e-3)


@item("ST-127")
def test_nearest_speed_is_the_start_of_the_ramp():
    """ST 5.1: entering velocity mode from an unprofiled mode ramps from the nearest integer speed value."""
    sim, host, (chip,) = steppers(mode=0)
    load_count(host, count_for(20_000, 0), speed=100)
    host.wait_ms(20)
    profile(host, speed=120, acceleration=40)
    host.wait_ms(3)
    chip.synchronise()
    assert chip.timer.speed == 100
    host.wait_ms(10)
    chip.synchronise()
    assert chip.timer.speed == 101
    assert rules(sim) == []


@item("ST-039", "ST-129")
@pytest.mark.parametrize("kind", ["count", "velocity"])
def test_reversal_needs_a_stop(kind):
    """ST 4.1, 4.2, 5.1: to change the direction Stop Motor must first be issued; X-60."""
    sim, host, (chip,) = steppers()

    def go(reverse):
        if kind == "count":
            load_count(host, 65000, reverse=reverse)
        else:
            profile(host, speed=100, acceleration=1, reverse=reverse)

    go(False)
    host.wait_ms(100)
    go(True)
    host.wait_ms(100)
    assert rules(sim) == ["ST-129"]
    assert chip.timer.direction == 1
    host.exchange(1, 0x7, [0x05])
    go(True)
    host.wait_ms(100)
    assert chip.timer.direction == -1
    assert rules(sim) == ["ST-129"]


# -- trapezoid --------------------------------------------------------------------------------------------------------


@item("ST-050", "ST-051", "ST-123", "ST-124", "ST-125")
@four
@pytest.mark.parametrize("goal", [1, 2, 3, 37, -500, 8000])
def test_trapezoid_ends_on_its_goal(bits, goal):
    """ST 4.3: accelerate, slew at the running speed, decelerate to a stop at the commanded goal position."""
    sim, host, (chip,) = steppers(mode=bits)
    profile(host, speed=120, acceleration=3, position=goal)
    host.wait_ms(10_000)
    assert host.position(1) == goal
    assert not chip.moving
    assert len(sim.trace().pulses_ns("M1")) == abs(goal)
    assert rules(sim) == []


@item("ST-050", "ST-051")
@pytest.mark.parametrize("goal", [900, 40_000])
def test_trapezoid_is_symmetric_and_reaches_its_speed(goal):
    """ST 4.3: deceleration occurs at the same rate as the acceleration; a short move is a triangle."""
    sim, host, _ = steppers(mode=0, least_speed=10)
    profile(host, speed=150, acceleration=1, position=goal)
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
    profile(host, speed=200, acceleration=1)
    host.wait_ms(100)
    host.exchange(1, 0x7, [0x09])
    host.wait_ms(100)
    assert not chip.moving
    there = host.position(1)
    profile(host, position=there + 2000)
    host.wait_ms(100)
    assert gaps_ns(sim)[-1] == pytest.approx(1e9 / 4000, rel=1e-3)  # the least speed, 20 x 200
    assert rules(sim) == ["ST-155"]


@item("X-68")
def test_profiles_begin_at_the_minimum_speed():
    """Choice: least profile speed at once, then one more every acceleration time."""
    sim, host, _ = steppers(mode=0, least_speed=100)
    profile(host, speed=103, acceleration=200)
    host.wait_ms(300)
    rates = 1e9 / gaps_ns(sim)
    assert rates[0] == pytest.approx(20_000, rel=1e-3)
    levels = sorted(set(np.round(rates, -1)))
    assert len(levels) == 4


# -- load and start ---------------------------------------------------------------------------------------------------


@item("ST-110", "ST-111", "ST-112", "ST-113", "ST-114", "ST-118")
@pytest.mark.parametrize("bits", range(16))
def test_load_length_follows_the_control_byte(bits):
    """ST 5.1: n = 1 + 4 position + 1 speed + 1 acceleration + 3 timer count, in that order, 1..10 bytes."""
    sim, host, (chip,) = steppers()
    fields = [i32(0x01020304), bytes([77]), bytes([9]), bytes([0x34, 0x12, 55])]
    data = bytes([bits]) + b"".join(f for k, f in enumerate(fields) if bits >> k & 1)
    assert len(data) == 1 + 4 * (bits & 1) + (bits >> 1 & 1) + (bits >> 2 & 1) + 3 * (bits >> 3 & 1)
    host.exchange(1, 0x4, data)
    host.wait_ms(1)
    load = chip.loads.last
    assert load.loaded == bits
    assert load.position == (0x01020304 if bits & 1 else 0)
    assert load.speed == (77 if bits & 2 else 0)
    assert load.acceleration == (9 if bits & 4 else 0)
    assert (load.count, load.nearest_speed) == ((0x1234, 55) if bits & 8 else (0, 0))
    assert rules(sim) == []


@item("ST-116")
def test_control_bits_5_and_6_should_be_zero():
    """ST 5.1: not used, clear to zero."""
    sim, host, _ = steppers()
    host.exchange(1, 0x4, [0x60])
    host.wait_ms(1)
    assert rules(sim) == ["ST-116"]


@item("ST-117", "ST-130", "ST-131")
def test_a_load_without_bit_7_has_no_effect_until_start():
    """ST 5.1: no effect whatsoever, and may be overwritten, until Start Motion; with bit 7 executed immediately."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=50, start=False)
    host.wait_ms(200)
    assert not chip.moving
    load_count(host, 65000, position=30, start=False)
    host.exchange(1, 0x5)
    host.wait_ms(1000)
    assert host.position(1) == 30
    load_count(host, 65000, position=60)
    host.wait_ms(1000)
    assert host.position(1) == 60
    assert rules(sim) == []


@item("X-47")
def test_start_without_a_fresh_load_executes_the_last_one_again():
    """Choice: the worst case; a count-only load then runs for ever."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=20, start=False)
    host.exchange(1, 0x5)
    host.wait_ms(200)
    load_count(host, 65100)
    host.wait_ms(100)
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x5)
    host.wait_ms(50)
    assert chip.moving
    assert rules(sim) == ["X-47"]


@item("X-48")
def test_a_load_stays_pending_over_a_stop():
    """Choice: Load, Stop, Start executes the load; logged."""
    sim, host, (_chip,) = steppers()
    load_count(host, 65000, position=20, start=False)
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x5)
    host.wait_ms(200)
    assert host.position(1) == 20
    assert rules(sim) == ["X-48"]


@item("ST-119", "ST-120")
def test_position_range():
    """ST 5.1: -0x7FFFFFFF to 0x7FFFFFFF, the goal not more than 0x7FFFFFFF from the current position."""
    sim, host, (_chip,) = steppers(mode=0)
    load_count(host, 65452, position=0x7FFFFFFF, start=False)
    host.wait_ms(1)
    assert rules(sim) == []
    load_count(host, 65452, position=-0x80000000, start=False)
    host.wait_ms(1)
    assert rules(sim) == ["ST-119"]
    load_count(host, 65452, position=1000)
    host.wait_ms(100)
    load_count(host, 65452, position=-0x7FFFFFFF, reverse=True, start=False)
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x4, [0x99, *i32(-0x7FFFFFFF), *(65452).to_bytes(2, "little"), 250])
    host.wait_ms(1)
    assert rules(sim)[-1] == "ST-120"


@item("ST-121", "ST-122", "X-73")
@pytest.mark.parametrize(
    ("speed", "acceleration", "logged"), [(0, 5, 1), (251, 5, 1), (5, 0, 1), (1, 1, 0), (250, 255, 0)]
)
def test_ranges_of_speed_and_acceleration(speed, acceleration, logged):
    """ST 5.1: speed 1-250, acceleration 1-255. Choice: clamp and log."""
    sim, host, (chip,) = steppers()
    profile(host, speed=speed, acceleration=acceleration, start=False)
    host.wait_ms(1)
    assert rules(sim) == ["X-73"] * logged
    assert chip.loads.last.speed == min(max(speed, 1), 250)
    assert chip.loads.last.acceleration == max(acceleration, 1)


@item("ST-133")
def test_parameters_not_loaded_keep_their_values():
    """ST 5.1, foot of Table 4: the previously loaded value will be used."""
    sim, host, _ = steppers(mode=0)
    profile(host, position=1000, speed=100, acceleration=1)
    host.wait_ms(500)
    profile(host, position=3000)
    host.wait_ms(500)
    assert host.position(1) == 3000
    assert gaps_ns(sim)[1400:2600] == pytest.approx(50_000, rel=1e-3)
    assert rules(sim) == []


@item("X-63")
def test_direction_bit_away_from_the_stop_position_runs_away():
    """Choice: bit 4 decides, so the axis runs away; logged."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=100, reverse=True)
    host.wait_ms(500)
    assert host.position(1) < -100
    assert chip.moving
    assert rules(sim) == ["X-63"]


@item("X-65")
def test_zero_length_move():
    """Choice: no pulse, stays Stopped, logged."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=0)
    profile(host, position=0, speed=10, acceleration=1)
    host.wait_ms(500)
    assert not chip.moving
    assert len(chip.runs) == 0
    assert rules(sim) == ["X-65", "X-65"]


# -- other commands ---------------------------------------------------------------------------------------------------


@item("ST-100", "X-72")
def test_reset_position():
    """ST 5.1: resets the 32-bit counter to 0; while moving it is executed and logged (choice)."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=40)
    host.wait_ms(500)
    host.exchange(1, 0x0)
    host.wait_ms(1)
    assert host.position(1) == 0
    assert chip.mechanical_steps == 40
    assert rules(sim) == []
    load_count(host, 65000)
    host.wait_ms(100)
    host.exchange(1, 0x0)
    host.wait_ms(1)
    assert 0 <= chip.position < 10
    assert rules(sim) == ["X-72"]


@item("ST-102", "X-76")
def test_status_item_2_is_the_timer_count():
    """ST 5.1: current initial timer count, 2 bytes. Choice: the one with which the timer was last reloaded."""
    _, host, _ = steppers(mode=0)
    load_count(host, 1)
    host.wait_ms(20)
    load_count(host, 65000)
    host.wait_ms(1)
    assert host.items(1, 0x04, 2) == bytes([1, 0])
    host.wait_ms(20)
    assert int.from_bytes(host.items(1, 0x04, 2), "little") == 65000
    host.exchange(1, 0x7, [0x05])
    profile(host, speed=100, acceleration=1)
    host.wait_ms(200)
    assert int.from_bytes(host.items(1, 0x04, 2), "little") == 65536 - 250 + 16


@item("ST-104")
def test_type_and_version():
    """ST 3.4, 5.1: PIC-STEP controller device type = 3; version 1 is that of the data sheet."""
    _, host, _ = steppers()
    assert host.items(1, 0x20, 2) == bytes([3, 1])


@item("ST-140", "ST-141", "ST-142", "ST-143", "ST-144", "ST-145")
def test_set_parameters_fields():
    """ST 5.1: operating mode, minimum speed, running and holding current, thermal limit; bits 5-7 ignored."""
    sim, host, (chip,) = steppers()
    for bits, multiple in ((0, 8), (1, 4), (2, 2), (3, 1)):
        for flags in (0x00, 0x04, 0x08, 0x10, 0x1C):
            host.exchange(1, 0x6, [bits | flags, 33, 44, 55, 0])
            host.wait_ms(1)
            assert chip.speed_mode == multiple
            assert (chip.limit_stop, chip.estop_stop, chip.off_on_stop) == (
                not flags & 4,
                not flags & 8,
                bool(flags & 16),
            )
            assert (chip.timer.least_speed, chip.running_current, chip.holding_current) == (33, 44, 55)
    assert rules(sim) == []
    host.exchange(1, 0x6, [0xE3, 33, 44, 55, 0])
    host.wait_ms(1)
    assert chip.speed_mode == 1
    assert rules(sim) == ["ST-145"]


@item("ST-146", "X-66")
def test_no_motion_before_set_parameters():
    """ST 5.1: this command must be issued before any motions can be executed."""
    sim, host = machine([StepModule("M1")])
    host.start_up(1)
    host.exchange(1, 0x7, [0x01])
    load_count(host, 65000)
    host.wait_ms(500)
    assert host.position(1) == 0
    assert rules(sim) == ["X-66"]


@item("ST-147")
def test_set_parameters_while_moving():
    """ST 5.1: changes to the speed mode bits and minimum profile speed will be ignored in motion; the rest is taken."""
    sim, host, (chip,) = steppers(mode=0)
    load_count(host, 60000)
    host.wait_ms(50)
    host.exchange(1, 0x6, [0x07, 99, 1, 2, 0])
    host.wait_ms(50)
    assert chip.speed_mode == 8
    assert chip.timer.least_speed == 1
    assert (chip.running_current, chip.holding_current, chip.limit_stop) == (1, 2, False)
    assert gaps_ns(sim) == pytest.approx((5536 + 16) * 200, rel=1e-6)


@item("ST-009", "ST-150", "ST-156", "ST-202")
def test_stop_motor_bit_0_is_amp_en():
    """ST 5.1: AMP_EN follows bit 0 regardless of the other bits; the command is needed first."""
    _, host, (chip,) = steppers()
    for control in (0x00, 0x01, 0x04, 0x05, 0x08, 0x09):
        host.exchange(1, 0x7, [control])
        host.wait_ms(1)
        assert chip.amp_enabled == bool(control & 1)
        assert bool(host.status(1) & 0x04) == bool(control & 1)
    _sim, host = machine([StepModule("M1")])
    host.wait_ms(2)
    assert not host.status(0) & 0x04


@item("ST-150", "ST-151", "ST-170")
@pytest.mark.parametrize("mode", ["trapezoid", "velocity", "with stop", "no stop"])
@pytest.mark.parametrize("control", [0x05, 0x09])
def test_stop_motor_stops_every_mode(mode, control):
    """ST 5.1, Table 4 first row: Stopped is entered from any mode by Stop Motor; bit 2 abruptly, bit 3 smoothly."""
    sim, host, (chip,) = steppers(mode=0, least_speed=10)
    if mode == "trapezoid":
        profile(host, position=500_000, speed=100, acceleration=2)
    elif mode == "velocity":
        profile(host, speed=100, acceleration=2)
    else:
        load_count(host, count_for(20_000, 0), speed=100, position=500_000 if mode == "with stop" else None)
    host.wait_ms(200)
    assert host.status(1) & 0x01
    before = host.position(1)
    host.exchange(1, 0x7, [control])
    host.wait_ms(1)
    if control == 0x05:
        assert not chip.moving
        stopped = host.position(1)
        assert stopped - before < 100
        host.wait_ms(100)
        assert host.position(1) == stopped
    else:
        assert chip.moving
        host.wait_ms(100)
        assert not chip.moving
    assert rules(sim) == []


@item("ST-152", "ST-154")
def test_smooth_stop_ramps_down_to_the_minimum_speed():
    """ST 5.1: decelerates with the current acceleration; at the minimum profile speed, it will stop."""
    sim, host, _ = steppers(mode=0, least_speed=50)
    profile(host, speed=150, acceleration=4)
    host.wait_ms(300)
    before = len(sim.trace().pulses_ns("M1"))
    host.exchange(1, 0x7, [0x09])
    host.wait_ms(300)
    gaps = gaps_ns(sim)[before:]
    rates = 1e9 / gaps
    assert rates[-1] == pytest.approx(51 * 200, rel=0.01)
    assert np.all(np.diff(gaps) >= -1)
    steps = sum(s * 200 * 1e-3 for s in range(51, 151))  # 1 ms at each speed
    assert len(gaps) == pytest.approx(steps, rel=0.02)


@item("ST-153")
def test_stop_motor_with_two_manners_is_logged():
    """ST 5.1: only one of bits 2 or 3 should be set at one time; unused bits clear."""
    sim, host, _ = steppers()
    host.exchange(1, 0x7, [0x0D])
    host.exchange(1, 0x7, [0x81])
    host.wait_ms(1)
    assert rules(sim) == ["ST-153", "ST-153"]


@item("ST-012", "ST-160")
def test_outputs():
    """ST 2.3: outputs 1-4 are initialized LOW, output 5 HIGH; ST 5.1 Set Outputs: bits 0-4 are OUT1-OUT5."""
    sim, host, (chip,) = steppers()
    assert chip.outputs == 0b10000
    for value in range(32):
        host.exchange(1, 0x8, [value])
        host.wait_ms(1)
        assert chip.outputs == value
    assert rules(sim) == []
    host.exchange(1, 0x8, [0xFF])
    host.wait_ms(1)
    assert chip.outputs == 0x1F
    assert rules(sim) == ["ST-160"]


@item("ST-161", "N-085", "X-75")
def test_save_as_home():
    """ST 5.1: the current position is saved in the home position register; X-75 while homing."""
    sim, host, _ = steppers()
    load_count(host, 65000, position=123)
    host.wait_ms(1000)
    host.exchange(1, 0xC)
    host.wait_ms(1)
    assert host.home(1) == 123
    host.exchange(1, 0x9, [0x01])
    host.exchange(1, 0xC)
    assert host.status(1) & 0x80
    assert rules(sim) == ["X-75"]


@item("ST-161")
def test_hard_reset_stops_and_forgets():
    """ST 5.1 Hard Reset: power-up state."""
    sim, host, (chip,) = steppers()
    load_count(host, 60000)
    host.exchange(1, 0x8, [0])
    host.wait_ms(100)
    host.send(1, 0xF)
    host.wait_ms(10)
    assert not chip.moving
    assert (chip.position, chip.outputs, chip.amp_enabled, chip.parameters_set) == (0, 0x10, False, False)
    assert rules(sim) == []


@item("ST-162")
@pytest.mark.parametrize("command", [0xB, 0xD])
def test_commands_b_and_d_do_not_exist(command):
    """ST 5.1: not defined for the PIC-STEP."""
    sim, host, _ = steppers()
    assert len(host.exchange(1, command)) == 1
    host.wait_ms(1)
    assert rules(sim) == ["X-41"]


# -- status -----------------------------------------------------------------------------------------------------------


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
        profile(host, speed=250, acceleration=20)
    elif mode == "trapezoid":
        profile(host, speed=250, acceleration=4, position=50_000)
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
    assert rules(sim) == ["X-66"]


@item("ST-130", "ST-133")
def test_an_overwritten_load_leaves_its_values_behind():
    """ST 5.1: a later load overwrites one that waits; what it does not load is what was loaded before."""
    sim, host, _ = steppers(mode=0)
    profile(host, position=5000, speed=100, acceleration=1, start=False)
    profile(host, position=2000, start=False)
    host.exchange(1, 0x5)
    host.wait_ms(1000)
    assert host.position(1) == 2000
    assert gaps_ns(sim).min() == pytest.approx(50_000, rel=1e-3)
    assert rules(sim) == []


@item("ST-184", "X-60")
def test_a_refused_stop_position_changes_nothing_for_later_counts():
    """Choice: the refused load is ignored, so the stop position that the run began with stays."""
    sim, host, _ = steppers(mode=0)
    load_count(host, 64000, position=400)
    host.wait_ms(20)
    load_count(host, 64000, position=900)
    load_count(host, 64500)
    host.wait_ms(2000)
    assert host.position(1) == 400
    assert rules(sim) == ["ST-184"]
