"""Feed hold on a running stream: along the path to rest, steps exact afterwards.

The trajectory is timed anew after what was sent and ends in a rest. A PIC-STEP's stop position cannot be moved while it
runs (data sheet, table 4), so an axis that has to stand before it is brought there by its counts: behind its last
wanted step comes the longest period that the timer knows, and a Stop Motor falls into that gap.

    steps    | | |  |   |     |         .  .  .  .  .  .  .  .  (|)       the step in brackets never comes
    counts                     '-- longest period -->
    bus                            [Stop Motor][read position]

Then the counters are read, and the rest of the path begins at what was read.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from nmc.program import Exchange
from planner.stream_axis import StepAxis
from planner.stream_base import AMP_ENABLE, STOP_ABRUPTLY, STOP_MOTOR, StepSchedule, Stream
from planner.types import Trajectory

READ_STATUS = 0x3
POSITION_ITEM = b"\x01"
POSITION_BYTES = 4
AFTER_REST_NS = 4_000_000
"""The Stop Motors leave this long after the path has come to rest: late last steps have fallen by then."""


@runtime_checkable
class Retimed(Protocol):
    """A trajectory that can be timed anew after a moment up to which everything has been sent."""

    def hold(self, sent_s: float) -> Rests:
        """Come to rest along the path."""

    def resume(self, sent_s: float) -> None:
        """Go on from the rest."""


class Rests(Protocol):
    """Where and when a hold comes to rest."""

    time_s: float


class Hold:
    """One hold, from its announcement until the axes stand and have been read."""

    def __init__(self, schedule: StepSchedule, trajectory: Trajectory, rest_ns: int) -> None:
        self.schedule = schedule
        self.trajectory = trajectory
        self.rest_ns = rest_ns
        self.read = False

    def stands_at(self, now_ns: int) -> bool:
        """The path rests and the axes have not been read yet."""
        return not self.read and now_ns > self.rest_ns + AFTER_REST_NS

    def stand(self) -> Stream:
        """Stop every stepper in the gap behind its last wanted step, then read where all of them are."""
        schedule = self.schedule
        moving = [axis for axis in schedule.axes if axis.moving]
        for axis in sorted(moving, key=lambda axis: axis.twin.fast.ahead(schedule.now_ns)[0]):
            data = bytes((AMP_ENABLE | STOP_ABRUPTLY,))
            yield Exchange(axis.motor.address, STOP_MOTOR, data, bus=schedule.bus)
        for axis in schedule.axes:
            yield from self._read(axis)
        self.read = True

    def _read(self, axis: StepAxis) -> Stream:
        schedule = self.schedule
        evidence = yield Exchange(
            axis.motor.address, READ_STATUS, POSITION_ITEM, reply_extra=POSITION_BYTES, bus=schedule.bus
        )
        if axis.moving:
            schedule.expect_rest(axis, evidence)
            axis.halted(int.from_bytes(evidence.extra, "little", signed=True), self.trajectory, schedule.now_ns)
