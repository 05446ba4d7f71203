"""The compiled walk gives the positions of the search, bit for bit: which of them is asked is a matter of speed."""

import numpy as np

from gcode import canon
from planner import trajectory as module
from planner.plan import plan
from planner.types import Limits

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)


def test_walk_and_search_agree_to_the_last_bit(monkeypatch):
    rng = np.random.default_rng(7)
    ends = np.cumsum(rng.normal(0.0, 3.0, (60, 3)), axis=0)
    moves = [canon.Feed(n + 1, (*end, 0, 0, 0, 0, 0, 0), 30.0) for n, end in enumerate(ends.tolist())]
    path = plan(moves, LIMITS, start=np.zeros(3), solver="kernel").trajectory
    t = np.concatenate((rng.uniform(-0.1, path.duration_s + 0.1, 4000), path.junctions_s()))
    monkeypatch.setattr(module, "at_hand", lambda: False)
    searched = path.q(t)
    monkeypatch.setattr(module, "at_hand", lambda: True)
    assert (path.q(t) == searched).all()
    assert (path.q(np.sort(t)) == searched[np.argsort(t)]).all()
