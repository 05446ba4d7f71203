"""A host that is held up between deciding and sending: what is not safe any more does not leave."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.paths import circle, random_path
from benchmarks.rig import Conditions, bring_up
from nmc.budget import BusTiming
from nmc.executor import play
from nmc.link import Link
from planner.stream import lead_in_ns, make_source


class HeldUp:
    """A link whose host is descheduled for up to 30 ms now and then, whenever it looks at the clock."""

    def __init__(self, link: Link, seed: int) -> None:
        self._link = link
        self._rng = np.random.default_rng(seed)

    def now_ns(self) -> int:
        if self._rng.random() < 0.01:
            self._link.sleep_until(self._link.now_ns() + int(self._rng.integers(1_000_000, 30_000_000)))
        return self._link.now_ns()

    def __getattr__(self, name: str) -> object:
        return getattr(self._link, name)


@pytest.mark.parametrize("profile", ["group", "adaptive", "exact"])
@pytest.mark.parametrize("seed", range(4))
def test_no_axis_runs_away_and_the_end_is_exact(profile: str, seed: int) -> None:
    path = circle(2.0, 20.0) if seed % 2 else random_path(seed, 40.0, duration_s=2.0)
    simulation, bus, motors = bring_up(path.axes, Conditions(seed=seed))
    bus.link = HeldUp(bus.link, seed)  # type: ignore[assignment]
    timing = BusTiming.at(115200)
    start_ns = bus.link.now_ns() + lead_in_ns(motors, timing)
    source = make_source(path, motors, timing=timing, start_ns=start_ns, profile=profile)  # type: ignore[arg-type]
    for _ in play(bus, source):
        pass
    bus.link.sleep_until(bus.link.now_ns() + 300_000_000)
    ends = np.floor(path.q(np.array([path.duration_s]))[0] * 200.0 + 0.5)
    assert [simulation.steppers()[name].position for name in path.axes] == ends.tolist()
    assert simulation.rules() == []
