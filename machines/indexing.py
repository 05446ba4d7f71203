"""A stream with stops for CY545s: common motion from a source of its own, then an index move, then the next stretch.

    buses     ...motion | park |   polls    |            | motion...
    CY545               | F R S N + |  G ~~~~ stepping ~~ | ?P  |

Nothing on the buses moves before the chip has said that it stands where it must. What comes too late shifts all that
follows, so a slow host costs time and never a place.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from machines.parts import Part
from nmc.chips.common import NOP
from nmc.cy545 import Cy545
from nmc.program import Evidence, Exchange
from planner.cy545_sequence import IndexedTrajectory, IndexMove, Stage
from planner.jerk import FilteredTrajectory
from planner.quantize import NS_PER_S
from planner.stream import Progress, StreamCounts, StreamSource
from planner.types import Trajectory

LATE_NS = 1_000_000
"""A stage that begins this much after its time counts as late."""
POLL_NS = 50_000_000
"""While a chip moves alone, a module of the buses is asked this often how it is."""


def stages_of(trajectory: Trajectory) -> tuple[Stage, ...]:
    """The stages of a trajectory with index moves, or of a part of one; none of any other."""
    if isinstance(trajectory, Part):
        end_s = trajectory.begin_s + trajectory.duration_s
        cut = [_within(stage, trajectory.begin_s, end_s) for stage in stages_of(trajectory.whole)]
        return tuple(stage for stage in cut if stage.duration_s > 0)
    if isinstance(trajectory, FilteredTrajectory):
        return stages_of(trajectory.base)
    return trajectory.stages if isinstance(trajectory, IndexedTrajectory) else ()


def _within(stage: Stage, begin_s: float, end_s: float) -> Stage:
    """What of a stage lies in a part, on the part's clock. Index moves are never cut."""
    first, last = max(stage.begin_s, begin_s), min(stage.begin_s + stage.duration_s, end_s)
    return Stage(first - begin_s, max(last - first, 0.0), stage.index)


def has_index_moves(trajectory: Trajectory) -> bool:
    """Whether something of it is for CY545s."""
    return any(stage.index is not None for stage in stages_of(trajectory))


@dataclass(frozen=True, slots=True)
class Yard:
    """What an indexing stream works with.

    chips: by axis. make: a source for a stretch of common motion with its t = 0 in link time. park: makes the modules
    as a stream must find them. lead_in_ns: what a source needs before its t = 0. poll, bus: address and bus of a
    module to ask.
    """

    chips: dict[str, Cy545]
    make: Callable[[Trajectory, int], StreamSource]
    park: Callable[[], None]
    lead_in_ns: int
    poll: int
    bus: int


class IndexingSource:
    """An ``nmc.program.ExchangeSource`` that also speaks to CY545s on their own lines, between two exchanges."""

    def __init__(self, trajectory: Trajectory, yard: Yard, start_ns: int) -> None:
        self.trajectory = trajectory
        self.plan_start_ns = start_ns
        self.shift_ns = 0
        """How much later than planned everything is by now."""
        self._late = 0
        self._yard = yard
        self._now_ns = start_ns
        self._counts: list[StreamCounts] = []
        self._present: StreamSource | None = None
        self._jitter_max_ns: int | None = None
        self._run = self._exchanges(stages_of(trajectory))

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        """The next exchange, or None when every stage is done."""
        self._now_ns = now_ns
        try:
            return next(self._run) if evidence is None else self._run.send(evidence)
        except StopIteration:
            return None

    def assume(self, jitter_max_ns: int) -> None:
        """From now on the host is believed to need up to this long before the first byte of a packet leaves."""
        self._jitter_max_ns = jitter_max_ns
        if self._present is not None:
            self._present.assume(jitter_max_ns)

    def progress(self) -> Progress:
        """Where the plan stands."""
        whole = self.trajectory
        time_s = min(max((self._now_ns - self.plan_start_ns - self.shift_ns) / NS_PER_S, 0.0), whole.duration_s)
        at = np.array([time_s])
        position = dict(zip(whole.axes, whole.q(at)[0].tolist(), strict=True))
        return Progress(time_s, whole.duration_s, int(whole.line(at)[0]), position)

    def counts(self) -> StreamCounts:
        """Slices of all stretches, the longest of their mean slices; a late stage counts as a late slice."""
        found = [*self._counts, *([self._present.counts()] if self._present else [])]
        return StreamCounts(
            sum(each.slices for each in found),
            sum(each.late_slices for each in found) + self._late,
            max((each.slice_ms for each in found), default=0.0),
        )

    def _exchanges(self, stages: Sequence[Stage]) -> Generator[Exchange, Evidence, None]:
        for number, stage in enumerate(stages):
            if stage.index is not None:
                yield from self._index(stage, stage.index)
                continue
            if number:
                self._yard.park()
            yield from self._common(stage, self._yard.lead_in_ns if number else 0)

    def _begin_ns(self, stage: Stage, needs_ns: int, now_ns: int) -> int:
        """When a stage begins: as planned, or later if it cannot any more."""
        planned_ns = self.plan_start_ns + self.shift_ns + round(stage.begin_s * NS_PER_S)
        late_ns = max(now_ns + needs_ns - planned_ns, 0)
        self.shift_ns += late_ns
        self._late += late_ns > LATE_NS
        return planned_ns + late_ns

    def _common(self, stage: Stage, lead_in_ns: int) -> Generator[Exchange, Evidence, None]:
        """lead_in_ns: to be kept from now to the stage's beginning; the first stage has been given its own."""
        clock = next(iter(self._yard.chips.values())).link
        begin_ns = self._begin_ns(stage, lead_in_ns, clock.now_ns())
        source = self._yard.make(Part(self.trajectory, stage.begin_s, stage.duration_s), begin_ns)
        self._present = source
        if self._jitter_max_ns is not None:
            source.assume(self._jitter_max_ns)
        exchange = source.next(clock.now_ns(), None)
        while exchange is not None:
            evidence = yield exchange
            exchange = source.next(self._now_ns, evidence)
        self._counts.append(source.counts())
        self._present = None

    def _index(self, stage: Stage, move: IndexMove) -> Generator[Exchange, Evidence, None]:
        chip = self._yard.chips[move.axis]
        chip.set_rates(move.settings.first, move.settings.rate, move.settings.slope)
        data = chip.prepare(move.end_steps)
        begin_ns = self._begin_ns(stage, chip.wire_ns(len(data)), chip.link.now_ns())
        while begin_ns - chip.link.now_ns() > POLL_NS:
            yield self._poll(begin_ns - POLL_NS, chip.link.now_ns(), move.line)
        chip.begin(data, move.end_steps, move.profile.duration_ns, begin_ns)
        while chip.link.now_ns() < chip.ready_ns:
            yield self._poll(chip.ready_ns, chip.link.now_ns(), move.line)
        chip.finish()

    def _poll(self, until_ns: int, now_ns: int, line: int) -> Exchange:
        """Ask a module how it is, at the latest at ``until_ns``: a stop is looked for between two exchanges."""
        at_ns = max(min(until_ns, now_ns + POLL_NS), now_ns)
        return Exchange(self._yard.poll, NOP, send_at_ns=at_ns, line=line, bus=self._yard.bus)
