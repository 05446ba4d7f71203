"""The guardian: a chip that takes counts at once, not at the roll-over as assumed, is found out and stopped."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from stream_rig import Conditions, bring_up, random_path

from nmc.budget import BusTiming
from nmc.executor import play, stop_all
from planner.stream import lead_in_ns, make_source
from planner.stream_error import StreamError


@pytest.mark.parametrize("seed", range(10))
def test_wrong_latch_semantics_end_the_stream_within_100_ms_and_5_steps(seed: int) -> None:
    path = random_path(seed, 20.0, duration_s=3.0)
    simulation, bus, motors = bring_up(path.axes, Conditions(seed=seed, count_latch="immediate"))
    timing = BusTiming.at(115200)
    source = make_source(
        path,
        motors,
        timing=timing,
        start_ns=bus.link.now_ns() + lead_in_ns(motors, timing),
        profile="adaptive",
    )
    with pytest.raises(StreamError, match="axis"):
        for _ in play(bus, source):
            pass
    stop_all(bus)
    stopped_ns = bus.link.now_ns() - source.plan_start_ns
    assert stopped_ns < 100e6 + 50e6  # some tens of milliseconds pass before the first axis makes its first step
    stood = np.array([simulation.steppers()[motor.name].position / motor.steps_per_unit for motor in motors])
    planned = path.q(np.arange(0.0, stopped_ns * 1e-9, 1e-4))
    off_path_steps = np.linalg.norm(planned - stood, axis=1).min() * motors[0].steps_per_unit
    assert off_path_steps <= 5.0
