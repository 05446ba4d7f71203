"""The host dies in the middle of a real job: how far the machine runs on, and how far it leaves the path.

A circle of 50 mm diameter on the machine ``mill3-step``; the watchdog is set to 50 ms. The host dies at random
instants and after a random number of bytes of a packet.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcode.setup import Setup
from machines.bringup import bring_up, connect, park
from machines.job import plan_job, read_job
from machines.load import load_machine
from machines.profiles import choose_profile
from machines.wiring import bus_timing, motors
from nmc.executor import play
from nmc.watchdog import Phase, Ward, Watchdog, patrol
from planner.stream import lead_in_ns, make_source

STEPS_PER_MM = 200
RADIUS_MM = 25.0
TIMEOUT_NS = 50_000_000
FEEDS = pytest.mark.parametrize(("feed_mm_s", "off_path_mm"), [(20.0, 0.03), (60.0, 0.2)])


class MortalLink:
    """A host's link that ends at an instant, after some bytes of the packet that it is writing then."""

    def __init__(self, link) -> None:
        self.link = link
        self.dies_at_ns = 1 << 62
        self.last_bytes = 0
        self.last_call_ns = 0

    def __getattr__(self, name: str):
        return getattr(self.link, name)

    def write(self, data: bytes) -> None:
        self.last_call_ns = self.link.now_ns()
        if self.last_call_ns >= self.dies_at_ns:
            self.link.write(data[: self.last_bytes])
            raise SystemExit
        self.link.write(data)


@pytest.fixture(scope="module")
def mill():
    return load_machine("mill3-step")


def circle(mill, feed_mm_s: float):
    text = f"G21 G90 G17 G64 P0.01 F{feed_mm_s * 60}\nG0 X{2 * RADIUS_MM} Y{RADIUS_MM}\nG2 I-{RADIUS_MM} J0\nM2\n"
    job = read_job(text, Setup(file="circle.nc"), mill)
    assert not job.errors
    return plan_job(job, mill).trajectory


def die(mill, trajectory, before_end_s: float, last_bytes: int, seed: int):
    """(simulation, watchdog, time of the host's last sign of life) after the take-over."""
    connection = connect(mill, seed=seed)
    bring_up(connection)
    park(connection)
    bus = connection.buses[0]
    driven = motors(mill)
    timing = bus_timing(mill, 0, True)
    start_ns = bus.link.now_ns() + lead_in_ns(driven, timing)
    profile = choose_profile(mill, "auto", True)
    source = make_source(trajectory, driven, timing=timing, start_ns=start_ns, profile=profile)
    wards = [Ward(address, "pic-step") for address in (1, 2, 3)]
    dog = Watchdog(wards, (0x81, 0x82), baud=115200, timeout_ns=TIMEOUT_NS, latency_ns=1_000_000)
    live = bus.link
    mortal = MortalLink(live)
    mortal.dies_at_ns = start_ns + round((trajectory.duration_s - before_end_s) * 1e9)
    mortal.last_bytes = last_bytes
    bus.link = mortal
    with pytest.raises(SystemExit):
        for _ in play(bus, source):
            pass
    dog.arm(mortal.last_call_ns)
    live.sleep_until(dog.due_ns)
    dog.check(live.now_ns())
    patrol(dog, live, rounds=20)
    return connection.simulation, dog, mortal.last_call_ns


def track(simulation, from_ns: int, until_ns: int):
    """Positions in mm every 0.2 ms, and the time of the last step."""
    trace = simulation.trace()
    times = np.arange(from_ns, until_ns, 200_000)
    at = np.zeros((len(times), 3))
    last_ns = 0
    for axis in range(3):
        at[:, axis] = trace.start_steps[axis]
    for run in range(len(trace.run_axis)):
        axis, count = int(trace.run_axis[run]), int(trace.run_count[run])
        first, period = float(trace.run_first_ns[run]), float(trace.run_period_ns[run])
        done = np.clip(np.floor((times - first) / period) + 1, 0, count) if count > 1 else (times >= first) * 1.0
        at[:, axis] += int(trace.run_dir[run]) * done
        last_ns = max(last_ns, int(first + period * (count - 1)))
    return at / STEPS_PER_MM, last_ns


@FEEDS
def test_a_host_that_dies_on_a_circle(mill, feed_mm_s: float, off_path_mm: float) -> None:
    kill(mill, feed_mm_s, off_path_mm, deaths=3)


@pytest.mark.slow
@FEEDS
def test_a_host_that_dies_on_a_circle_twenty_times(mill, feed_mm_s: float, off_path_mm: float) -> None:
    kill(mill, feed_mm_s, off_path_mm, deaths=20)


def kill(mill, feed_mm_s: float, off_path_mm: float, deaths: int) -> None:
    trajectory = circle(mill, feed_mm_s)
    dice = np.random.default_rng(7)
    exchange_ms = 1.5
    circle_s = 2 * math.pi * RADIUS_MM / feed_mm_s
    run_on_mm = feed_mm_s * (TIMEOUT_NS / 1e6 + exchange_ms) * 1e-3
    for death in range(deaths):
        before_end_s = dice.uniform(0.1, 0.95) * circle_s
        simulation, dog, died_ns = die(mill, trajectory, before_end_s, int(dice.integers(12)), death)
        assert dog.phase is Phase.STANDING
        simulation.world.run_until(simulation.world.now_ns + 300_000_000)
        places, last_ns = track(simulation, died_ns, simulation.world.now_ns)
        assert last_ns - died_ns <= (TIMEOUT_NS / 1e6 + exchange_ms) * 1e6, f"death {death}"
        radius = np.hypot(places[:, 0] - RADIUS_MM, places[:, 1] - RADIUS_MM)
        assert abs(radius[0] - RADIUS_MM) < 0.05, "the host died on the circle"
        assert np.abs(radius - RADIUS_MM).max() <= off_path_mm + 2 / STEPS_PER_MM, f"death {death}"
        assert math.dist(places[0], places[-1]) <= run_on_mm + 2 / STEPS_PER_MM
