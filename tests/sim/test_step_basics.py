"""The simulator from the host's side: start-up, one trapezoid, one stream, and the same again from the same seed."""

import numpy as np
import pytest

from sim.build import Simulation, build
from sim.spec import BusSpec, SimOptions, StepModule, Switch
from sim.trace import load


def packet(address, command, data=b""):
    body = bytes([address, len(data) << 4 | command]) + bytes(data)
    return b"\xaa" + body + bytes([sum(body) & 0xFF])


def exchange(link, address, command, data=b"", extra=0):
    link.write(packet(address, command, data))
    reply = link.read(extra + 2, link.now_ns() + 20_000_000)
    assert len(reply) == extra + 2
    assert sum(reply[:-1]) & 0xFF == reply[-1]
    return reply


def bus_of(count=3, **spec):
    modules = tuple(StepModule(f"M{i}", crystal_ppm_max=100, **spec) for i in range(count))
    return [BusSpec("main", modules, host_jitter_max_ns=200_000)]


def started(count=3, seed=1, mode=3, options=None, **spec) -> Simulation:
    """The nine start-up steps; group 0x81 led by the first module."""
    sim = build(bus_of(count, **spec), seed, options)
    link = sim.links[0]
    link.write(bytes(16))
    link.sleep_until(link.now_ns() + 10_000_000)
    link.flush_input()
    for address in range(1, count + 1):
        exchange(link, 0, 1, [address, 0xFF])
    link.write(packet(0xFF, 0xA, [10]))
    link.sleep_until(link.now_ns() + 5_000_000)
    link.set_baud(115200)
    for address in range(1, count + 1):
        exchange(link, address, 1, [address, 0x01 if address == 1 else 0x81])
        exchange(link, address, 6, [mode, 1, 100, 50, 0])
        exchange(link, address, 7, [1])
    return sim


def u32(value):
    return value.to_bytes(4, "little", signed=True)


def test_startup_breaks_no_rule():
    sim = started()
    assert sim.violations == []
    assert exchange(sim.links[0], 2, 3, [0x3F], 14)[-3:-1] == bytes([3, 1])


def test_group_start_of_trapezoids_ends_on_the_goals():
    sim = started()
    link = sim.links[0]
    goals = [1000, -2000, 3001]
    for address, goal in enumerate(goals, start=1):
        exchange(link, address, 4, [0x07, *u32(goal), 100, 2])
    exchange(link, 0x81, 5)
    link.sleep_until(link.now_ns() + 3_000_000_000)
    assert [m.position for m in sim.steppers().values()] == goals
    assert sim.violations == []
    trace = sim.trace()
    assert [int(trace.run_count[trace.run_axis == a].sum()) for a in range(3)] == [1000, 2000, 3001]
    periods = np.diff(trace.pulses_ns("M0"))
    assert np.abs(periods - periods[::-1]).max() < 0.25e-3 * 1e9 * 0.11  # the way down mirrors the way up


def test_unprofiled_position_mode_stops_on_the_step():
    sim = started(1, mode=0)
    link = sim.links[0]
    exchange(link, 1, 4, [0x89, *u32(500), *(65452).to_bytes(2, "little"), 250])
    link.sleep_until(link.now_ns() + 5_000_000)
    for count in (60000, 65000, 64000):
        exchange(link, 1, 4, [0x88, *count.to_bytes(2, "little"), 100])
    link.sleep_until(link.now_ns() + 5_000_000_000)
    assert sim.modules["M0"].position == 500
    assert not sim.modules["M0"].moving
    assert sim.violations == []


def test_new_count_acts_at_the_next_roll_over():
    sim = started(1, mode=0)
    link = sim.links[0]
    exchange(link, 1, 4, [0x88, *(1).to_bytes(2, "little"), 1])  # 76.28 steps/s: 13.11 ms
    link.sleep_until(link.now_ns() + 20_000_000)
    exchange(link, 1, 4, [0x88, *(65452).to_bytes(2, "little"), 250])
    link.sleep_until(link.now_ns() + 20_000_000)
    pulses = sim.trace().pulses_ns("M0")
    gaps = np.diff(pulses)
    assert gaps[0] == pytest.approx(65551 * 200, rel=2e-4)
    assert gaps[1:] == pytest.approx(20_000, rel=2e-4)


def test_same_seed_is_bit_identical(tmp_path):
    def run(seed):
        sim = started(3, seed=seed)
        link = sim.links[0]
        for address in (1, 2, 3):
            exchange(link, address, 4, [0x89, *u32(3000), 0x00, 0xF8, 80])
        exchange(link, 0x81, 5)
        for k in range(100):
            for address in (1, 2, 3):
                exchange(link, address, 4, [0x08, (k * 7 * address) & 0xFF, 0xF8, 80])
            exchange(link, 0x81, 5)
        return sim.trace()

    one, same, other = run(5), run(5), run(6)
    one.save(tmp_path / "trace.npz", {"M0": 200.0}, 123)
    back = load(tmp_path / "trace.npz")
    assert back.plan_start_ns == 123
    assert back.steps_per_unit[0] == 200.0
    for name in ("run_first_ns", "run_period_ns", "run_count", "run_dir", "bus_ns", "bus_byte", "bus_line"):
        assert np.array_equal(getattr(one, name), getattr(same, name))
        assert np.array_equal(getattr(one, name), getattr(back, name))
    assert not np.array_equal(one.run_first_ns, other.run_first_ns)


def test_limit_switch_on_the_mechanics_stops_the_axis():
    switch = Switch("limit1", 300, None)
    sim = started(1, mode=3, switches=(switch,), start_steps=100)
    link = sim.links[0]
    exchange(link, 1, 4, [0x89, *u32(500), 0x00, 0xF0, 10])
    link.sleep_until(link.now_ns() + 5_000_000_000)
    module = sim.modules["M0"]
    assert (module.position, module.mechanical_steps, module.moving) == (200, 300, False)
    assert exchange(link, 1, 3, [0x08], 1)[1] == 0x08
    exchange(link, 1, 4, [0x99, *u32(100), 0x00, 0xF0, 10])  # away from the switch is allowed
    link.sleep_until(link.now_ns() + 5_000_000_000)
    assert (module.position, module.mechanical_steps) == (100, 200)


def test_moving_a_stop_position_is_refused_and_logged():
    sim = started(1)
    link = sim.links[0]
    exchange(link, 1, 4, [0x89, *u32(500), 0x00, 0xF0, 10])
    exchange(link, 1, 4, [0x89, *u32(100), 0x00, 0xF0, 10])
    link.sleep_until(link.now_ns() + 5_000_000_000)
    assert sim.modules["M0"].position == 500
    assert [v.rule for v in sim.violations] == ["ST-184"]


def test_without_bus_log_nothing_of_the_bus_is_kept():
    sim = started(1, options=SimOptions(trace_bus=False))
    assert len(sim.trace().bus_ns) == 0
