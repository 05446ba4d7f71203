"""Long traces: the older part goes to disk and comes back in order."""

import numpy as np

from sim.clock import ChipClock
from sim.spool import KEEP, LIMIT, Spool
from sim.trace import BusLog, StepRuns, collect


def test_a_spool_keeps_its_tail_in_memory_and_its_order():
    spool = Spool("q")
    for value in range(3 * LIMIT + 17):
        spool.tail.append(value)
        spool.settle()
        assert len(spool.tail) < LIMIT + 1
    assert len(spool) == 3 * LIMIT + 17
    assert spool.spilled >= 3 * (LIMIT - KEEP)
    assert np.array_equal(spool.read(), np.arange(3 * LIMIT + 17))
    assert np.array_equal(spool.read(), np.arange(3 * LIMIT + 17))


def test_runs_and_bytes_survive_the_disk():
    runs, log = StepRuns(ChipClock(200, 0)), BusLog()
    count = 2 * LIMIT + 5
    for k in range(count):
        runs.add(1000 * k, 10 + k % 3, 2, 1 if k % 2 else -1)
        log.host([3 * k, 3 * k + 1], [k & 0xFF, 7])
        log.status(3 * k + 2, 9)
    trace = collect(["X"], {"X": runs}, {}, [log])
    assert np.array_equal(trace.run_first_ns, np.arange(count) * 200_000)
    assert np.array_equal(trace.run_period_ns, (10 + np.arange(count) % 3) * 200.0)
    assert set(trace.run_count) == {2}
    assert np.array_equal(trace.bus_ns, np.arange(3 * count))
    assert np.array_equal(trace.bus_byte[2::3], np.full(count, 9))
    assert np.array_equal(trace.bus_line[:3], [0, 0, 1])


def test_runs_join_where_they_can():
    runs = StepRuns(ChipClock(200, 0))
    runs.add(100, 10, 3, 1)  # 100 110 120
    runs.add(130, 10, 2, 1)  # the same train
    runs.add(150, 20, 3, 1)  # 150 still in the old period, then 170 190
    runs.add(210, 20, 1, -1)
    first, period, count, direction = runs.read()
    assert (first.tolist(), period.tolist(), count.tolist(), direction.tolist()) == (
        [100, 170, 210],
        [10, 20, 20],
        [6, 2, 1],
        [1, 1, -1],
    )
