"""Looking changes nothing: a chip brought to the present at any moments makes the same pulses as one left alone."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.rawhost import i32, servos, steppers
from sim.spec import Switch

SWITCHES = (Switch("limit1", 900, None), Switch("limit2", None, -900), Switch("home", 200, 260))

step_action = st.one_of(
    st.tuples(st.just("count"), st.integers(1, 65452), st.booleans(), st.none() | st.integers(-1500, 1500)),
    st.tuples(st.just("velocity"), st.integers(1, 250), st.integers(1, 20), st.booleans()),
    st.tuples(st.just("trapezoid"), st.integers(-1500, 1500), st.integers(1, 250), st.integers(1, 20)),
    st.tuples(st.just("stop"), st.sampled_from([0x05, 0x09])),
    st.tuples(st.just("home"), st.sampled_from([0x08, 0x18, 0x28, 0x2B])),
    st.tuples(st.just("reset")),
)
servo_action = st.one_of(
    st.tuples(st.just("velocity"), st.integers(0, 20 * 65536), st.integers(1, 3000), st.booleans()),
    st.tuples(st.just("trapezoid"), st.integers(-3000, 3000), st.integers(1, 20 * 65536), st.integers(1, 3000)),
    st.tuples(st.just("stop"), st.sampled_from([0x03, 0x05, 0x09])),
    st.tuples(st.just("home"), st.sampled_from([0x08, 0x18, 0x29])),
    st.tuples(st.just("pwm"), st.integers(0, 255), st.booleans()),
)
waits = st.lists(st.integers(1, 400), min_size=1, max_size=6)


def send_step(host, action):
    kind, *values = action
    if kind == "count":
        count, reverse, stop = values
        data = b"" if stop is None else i32(stop)
        control = 0x88 | (0x10 if reverse else 0) | (0x01 if stop is not None else 0)
        host.exchange(1, 0x4, [control, *data, *count.to_bytes(2, "little"), 50])
    elif kind == "velocity":
        host.exchange(1, 0x4, [0x86 | (0x10 if values[2] else 0), *values[:2]])
    elif kind == "trapezoid":
        host.exchange(1, 0x4, [0x87, *i32(values[0]), *values[1:]])
    elif kind == "stop":
        host.exchange(1, 0x7, values)
    elif kind == "home":
        host.exchange(1, 0x9, values)
    else:
        host.exchange(1, 0x0)


def send_servo(host, action):
    kind, *values = action
    if kind == "velocity":
        control = 0xB6 | (0x40 if values[2] else 0)
        host.exchange(1, 0x4, [control, *i32(values[0]), *i32(values[1])])
    elif kind == "trapezoid":
        host.exchange(1, 0x4, [0x97, *i32(values[0]), *i32(values[1]), *i32(values[2])])
    elif kind == "pwm":
        host.exchange(1, 0x4, [0x88 | (0x40 if values[1] else 0), values[0]])
    else:
        host.exchange(1, 0x7 if kind == "stop" else 0x9, values)


def play(rig, send, actions, glances):
    sim, host, (chip,) = rig
    for action, pause in actions:
        send(host, action)
        end = host.link.now_ns() + pause * 1_000_000
        if glances is not None:
            for part in glances:
                host.link.sleep_until(min(end, host.link.now_ns() + part * 37_000))
                chip.synchronise()
        host.link.sleep_until(end)
    trace = sim.trace()
    return [
        getattr(trace, name) for name in ("run_first_ns", "run_count", "run_dir", "servo_command", "servo_position")
    ], [(v.time_ns, v.rule) for v in sim.violations]


@settings(max_examples=3 * settings.default.max_examples // 2)
@given(st.lists(st.tuples(step_action, st.integers(0, 300)), min_size=1, max_size=8), waits, st.integers(0, 3))
def test_a_stepper_does_not_notice_being_looked_at(actions, glances, mode):
    rigs = [steppers(mode=mode, least_speed=3, switches=SWITCHES) for _ in range(2)]
    alone, rules = play(rigs[0], send_step, actions, None)
    seen, rules_seen = play(rigs[1], send_step, actions, glances)
    assert all(np.array_equal(a, b) for a, b in zip(alone, seen, strict=True))
    assert rules == rules_seen
    # the counter is the sum of the pulses since it was last zeroed, whatever stopped them
    chip = rigs[0][2][0]
    zeroed = sum(before for _, before in chip.counter_resets)
    assert int((alone[1] * alone[2]).sum()) == chip.position + zeroed


@settings(max_examples=settings.default.max_examples // 2)
@given(st.lists(st.tuples(servo_action, st.integers(0, 200)), min_size=1, max_size=6), waits)
def test_a_servo_does_not_notice_being_looked_at(actions, glances):
    rigs = [servos(switches=SWITCHES[:2]) for _ in range(2)]
    alone, rules = play(rigs[0], send_servo, actions, None)
    seen, rules_seen = play(rigs[1], send_servo, actions, glances)
    assert all(np.array_equal(a, b) for a, b in zip(alone, seen, strict=True))
    assert rules == rules_seen
