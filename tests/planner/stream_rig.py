"""Where the tests of streaming find the paths and the rig of the benchmark."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.paths import ClosedForm, circle, helix, line, random_path, rounded_square
from benchmarks.rig import Conditions, Outcome, bring_up, stream, timing_of
from nmc.bus import Bus
from nmc.executor import play
from nmc.program import Evidence
from planner.stream import Profile, StreamSource, lead_in_ns, make_source

__all__ = [
    "ClosedForm",
    "Conditions",
    "Outcome",
    "bring_up",
    "brought_up",
    "circle",
    "helix",
    "line",
    "random_path",
    "rounded_square",
    "said",
    "stream",
]


def brought_up(path: ClosedForm, conditions: Conditions, profile: Profile) -> tuple[Bus, StreamSource]:
    """A bus that is ready, and a stream of ``path`` for it."""
    _, bus, motors = bring_up(path.axes, conditions)
    timing = timing_of(conditions)
    start_ns = bus.link.now_ns() + lead_in_ns(motors, timing)
    return bus, make_source(path, motors, timing=timing, start_ns=start_ns, profile=profile)


def said(path: ClosedForm, conditions: Conditions, profile: Profile) -> list[Evidence]:
    """Everything that a stream says and hears."""
    return list(play(*brought_up(path, conditions, profile)))
