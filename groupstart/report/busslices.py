"""The bytes of a trace as slices for a timeline: packets of the host, answers of the modules; and step rates."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from groupstart.report.perfetto import Sample, Slice
from groupstart.report.rates import emitted_rate
from nmc.dump import chunks_of_bytes, dump_lines
from sim.trace import Trace

BITS_A_BYTE, START_BAUD = 10, 19_200


def bus_slices(trace: Trace) -> tuple[dict[int, str], Iterator[Slice]]:
    """Names of the tracks (two a bus: host, modules) and every packet on them."""
    buses = sorted({int(line) // 2 for line in np.unique(trace.bus_line)})
    tracks = {}
    for bus in buses:
        tracks[2 * bus + 1], tracks[2 * bus + 2] = f"bus {bus}: host", f"bus {bus}: modules"
    return tracks, (item for bus in buses for item in _slices(trace, bus))


def _slices(trace: Trace, bus: int) -> Iterator[Slice]:
    times, lines, values = trace.bus_ns.tolist(), trace.bus_line.tolist(), trace.bus_byte.tolist()
    ends = {side: trace.bus_ns[trace.bus_line == 2 * bus + side] for side in (0, 1)}
    for line in dump_lines(chunks_of_bytes(times, lines, values, bus)):
        if line.direction not in "<>" or not line.raw:
            continue
        side = 0 if line.direction == ">" else 1
        # a byte is noted when its stop bit ends: the packet began one byte before its first note
        first = int(np.searchsorted(ends[side], line.time_ns))
        last = min(first + len(line.raw), len(ends[side])) - 1
        if first > last:
            continue
        span = int(ends[side][last] - ends[side][first])
        byte_ns = span // (last - first) if last > first else BITS_A_BYTE * 1_000_000_000 // START_BAUD
        begin = max(int(ends[side][first]) - byte_ns, 0)
        yield Slice(2 * bus + 1 + side, begin, int(ends[side][last]), line.words)


def rate_samples(trace: Trace, first: int) -> tuple[dict[int, str], Iterator[Sample]]:
    """A counter track with the step rate of every stepper, numbered from ``first`` on."""
    steppers = [name for k, name in enumerate(trace.axes) if np.any(trace.run_axis == k)]
    counters = {first + k: f"{name} steps/s" for k, name in enumerate(steppers)}

    def samples() -> Iterator[Sample]:
        for track, name in zip(counters, steppers, strict=True):
            t_s, rate = emitted_rate(trace, name)
            for at, value in zip(t_s.tolist(), rate.tolist(), strict=True):
                yield Sample(track, max(round(at * 1e9) + trace.plan_start_ns, 0), value)

    return counters, samples()
