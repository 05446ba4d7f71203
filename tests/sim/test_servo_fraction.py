"""The trace keeps a PIC-SERVO's command position to its last bit: 48 bits of which 16 are a fraction (section 4.4)."""

from dataclasses import replace

import numpy as np

from machines.judge import trace_pins
from machines.thin import thin_servo
from sim.rawhost import FIRM_GAINS, i32, servos
from sim.trace import load

VELOCITY_LOAD = 0xB6
"""Velocity and acceleration, servo and velocity mode, start now."""


def moved(goal):
    sim, host, _ = servos(gains=FIRM_GAINS)
    reverse = 0x40 if goal < 0 else 0
    host.exchange(1, 0x4, [VELOCITY_LOAD | reverse, *i32(abs(goal)), *i32(65536 * 100)])
    host.wait_ms(50)
    return sim.trace()


def commands(trace):
    return (trace.servo_command.astype(np.int64) << 16) + trace.servo_fraction


def test_a_slow_command_moves_by_its_velocity_every_tick():
    for goal in (7001, -7001):  # a tenth of a count a tick
        steps = np.diff(commands(moved(goal)))
        assert set(steps[-50:].tolist()) == {goal}


def test_the_fraction_is_saved_thinned_and_may_be_missing(tmp_path):
    trace = moved(7001)
    trace.save(tmp_path / "new.npz")
    again = load(tmp_path / "new.npz")
    assert np.array_equal(commands(again), commands(trace))
    thin = thin_servo(again, 10)
    assert len(thin.servo_fraction) == len(thin.servo_command) < len(trace.servo_command)
    assert np.array_equal(commands(thin)[:-1], commands(trace)[::10][: len(thin.servo_command) - 1])
    replace(trace, servo_fraction=np.zeros(0, np.uint16)).save(tmp_path / "old.npz")
    old = load(tmp_path / "old.npz")
    assert not len(old.servo_fraction)
    assert not len(thin_servo(old, 10).servo_fraction)


def test_a_trace_says_the_command_as_well_as_it_knows_it():
    trace = moved(7001)
    assert np.array_equal(trace.commanded * 65536.0, commands(trace))
    old = replace(trace, servo_fraction=np.zeros(0, np.uint16))
    assert old.commanded is old.servo_command


def test_pins_take_the_truth_as_it_is_and_add_half_a_count_to_whole_ones():
    trace = moved(7001)
    exact = trace_pins(trace, {}, trace.commanded).position[:, 0]
    whole = trace_pins(trace, {}, trace.servo_command).position[:, 0]
    assert np.array_equal(exact, trace.commanded)
    assert set(np.unique(whole - trace.servo_command)) == {0.0, 0.5}
