"""Ten minutes of random velocities on each chip end on the count that an independent reckoning gives.

PIC-STEP: the reckoning is the data sheet's own picture, a counter that counts up once a timer clock and makes a pulse
when it rolls over (section 4.1), one clock after the other. PIC-SERVO: the integral of the command velocity, written
as a sum of arithmetic series (section 4.4).
"""

import numpy as np
import pytest
from numba import njit

from sim.rawhost import FIRM_GAINS, i32, servos, steppers

MINUTES_10_NS = 600_000_000_000


@njit(cache=True)
def count_up(load_clock, load_count, load_direction, overhead, last_clock):
    """Step position when a count ``load_count[k]`` is loaded at clock ``load_clock[k]``; 0 stops abruptly."""
    position, counter, running, loaded, direction, k = 0, 0, False, 0, 1, 0
    for clock in range(load_clock[0], last_clock + 1):
        if running:
            counter += 1
            if counter == 65536 + overhead:
                position += direction
                counter = loaded
        while k < load_clock.shape[0] and load_clock[k] == clock:
            if load_count[k] == 0:
                running = False
            else:
                loaded = load_count[k]
                if not running:
                    running, counter, direction = True, loaded, load_direction[k]
            k += 1
    return position


@pytest.mark.parametrize("seed", [1, 2])
def test_step_timer_against_a_counter_that_counts(seed):
    rng = np.random.default_rng(seed)
    sim, host, (chip,) = steppers(mode=3, start_delay_max_ns=0, crystal_ppm=37.0)
    begin = host.link.now_ns()
    clocks, counts, directions = [], [], []

    def executed(count, direction):
        clocks.append(chip.clock.tick_at(sim.buses[0].command.free_ns))
        counts.append(count)
        directions.append(direction)

    direction = 1
    while host.link.now_ns() - begin < MINUTES_10_NS:
        if rng.random() < 0.1:
            host.exchange(1, 0x7, [0x05])
            executed(0, 1)
            direction = -direction
        count = int(rng.integers(45_000, 65_453))
        turn = 0x10 if direction < 0 else 0
        host.exchange(1, 0x4, [0x88 | turn, *count.to_bytes(2, "little"), 50])
        executed(count, direction)
        host.wait_ms(rng.uniform(5, 300))
    # base ticks are eight to a clock of mode 1x, and the timer begins anew with every start from rest
    assert position_of(clocks, counts, directions, 8, 2, chip.clock.tick_at(host.link.now_ns())) == chip.position
    assert sim.violations == []
    assert len(counts) > 3000


def position_of(ticks, counts, directions, prescale, overhead, last):
    """Add up the legs between stops, each reckoned in clocks that begin at its start."""
    total, k = 0, 0
    while k < len(ticks):
        if counts[k] == 0:
            k += 1
            continue
        end = next((j for j in range(k, len(ticks)) if counts[j] == 0), len(ticks))
        stop = ticks[end] if end < len(ticks) else last
        # a load between two clocks acts like one at the earlier of them: the roll-over comes on a clock
        clock = np.array([(t - ticks[k]) // prescale for t in ticks[k:end]])
        total += count_up(
            clock, np.array(counts[k:end]), np.array(directions[k:end]), overhead, (stop - ticks[k]) // prescale
        )
        k = end
    return total


def test_velocity_profile_of_a_step_against_the_same_counter():
    """ST 4.2: the speed changes by one every acceleration time until the goal; each is a new count of the timer."""
    rng = np.random.default_rng(5)
    sim, host, (chip,) = steppers(mode=2, start_delay_max_ns=0)
    ticks, counts = [], []

    def set_speed(tick, speed):
        ticks.append(tick)
        counts.append(65536 + 4 - round(25000 / speed + 1e-9))

    begin = host.link.now_ns()
    speed, goal, acceleration, boundary = 0, 0, 0, None
    while host.link.now_ns() - begin < MINUTES_10_NS:
        new_goal, new_acceleration = int(rng.integers(1, 251)), int(rng.integers(1, 60))
        host.exchange(1, 0x4, [0x86, new_goal, new_acceleration])
        tick = chip.clock.tick_at(sim.buses[0].command.free_ns)
        speed, boundary = walk(set_speed, speed, goal, acceleration, boundary, tick)
        if speed == 0:
            speed = 1
            set_speed(tick, speed)
        goal, acceleration = new_goal, new_acceleration
        if speed == goal:
            boundary = None
        elif boundary is None:
            boundary = tick + acceleration * 1250
        host.wait_ms(rng.uniform(50, 1500))
    last = chip.clock.tick_at(host.link.now_ns())
    walk(set_speed, speed, goal, acceleration, boundary, last)
    assert position_of(ticks, counts, [1] * len(ticks), 4, 4, last) == chip.position
    assert chip.position > 1_000_000
    assert sim.violations == []


def walk(set_speed, speed, goal, acceleration, boundary, until):
    """Let the speed go towards the goal, one a boundary, up to tick ``until``."""
    while boundary is not None and boundary <= until:
        speed += 1 if goal > speed else -1
        set_speed(boundary, speed)
        boundary = None if speed == goal else boundary + acceleration * 1250
    return speed, boundary


def series(velocity, goal, acceleration, ticks):
    """Sum of the command velocity over ``ticks`` ticks and the velocity after them, in closed form."""
    sign = 1 if goal > velocity else -1
    span = abs(goal - velocity)
    ramp = min(ticks, span // acceleration)  # whole ticks of full acceleration
    total = ramp * velocity + sign * acceleration * (ramp * (ramp + 1) // 2)
    velocity += sign * acceleration * ramp
    left = ticks - ramp
    if left and velocity != goal:  # the last tick of the ramp takes what is left of it
        velocity = goal
    return total + left * velocity, velocity


@pytest.mark.parametrize("seed", [1, 2])
def test_servo_command_is_the_integral_of_its_velocity(seed):
    rng = np.random.default_rng(seed)
    sim, host, (chip,) = servos(gains=(*FIRM_GAINS[:6], 0x3FFF, 1, 0), crystal_ppm=-55.0, trace_every=0)
    begin = host.link.now_ns()
    place, velocity, goal, acceleration = int(chip.n[7]), 0, 0, 1
    last = int(chip.n[0])
    while host.link.now_ns() - begin < MINUTES_10_NS:
        new_goal = int(rng.integers(-20 * 65536, 20 * 65536))
        new_acceleration = int(rng.integers(50, 4000))
        host.exchange(1, 0x4, [0xB6 | (0x40 if new_goal < 0 else 0), *i32(abs(new_goal)), *i32(new_acceleration)])
        executed = chip.clock.tick_at(reply_began(sim))
        moved, velocity = series(velocity, goal, acceleration, executed - last)
        place, last, goal, acceleration = place + moved, executed, new_goal, new_acceleration
        host.wait_ms(rng.uniform(20, 800))
    chip.synchronise()
    moved, velocity = series(velocity, goal, acceleration, int(chip.n[0]) - last)
    assert int(chip.n[7]) == place + moved
    assert abs(chip.position - chip.command_position) < 2000
    assert sim.violations == []


def reply_began(sim):
    """When the last reply's first bit left, which is the end of the servo tick that executed the command."""
    log = sim.bus_logs[0]
    return round(log.status_ns[-1] - 2 * (log.status_ns[-1] - log.status_ns[-2])) + 5
