"""Profile ``exact``: every turn of an axis is a short move that stops on its own step. Safe whatever the chip does.

A leg is cut into pieces of about one round of the bus. Each is loaded from rest with its own stop position and started
at once, runs a little faster than planned and stands before the next is begun, so neither when a new count acts nor a
host that dies can take the axis further than one piece. The price is a pause a piece: for slow feeds and for the first
contact with hardware.

    planned   | | | | | | | | | | | | |
    piece     |||||||| .  |||||||| .  |     the pause is as long as execution and clock are uncertain
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence

from nmc.budget import BusTiming
from nmc.program import Exchange
from planner.quantize import NS_PER_S
from planner.steptrain import Leg, StepTrain
from planner.stream_adaptive import IDLE_NS, AdaptiveSchedule
from planner.stream_axis import StepAxis
from planner.stream_base import LEG_BYTES, NO_OPERATION, Stream
from planner.stream_lane import StepLane, Turn
from planner.types import Trajectory

MARGIN_NS = 100_000
"""Added to what execution delay and jitter make uncertain."""


class PieceTrain:
    """The legs of a step train, handed out in pieces; how far the next piece goes is decided when it is loaded."""

    def __init__(self, train: StepTrain) -> None:
        self.motor = train.motor
        self.trajectory = train.trajectory
        self.start_steps = train.start_steps
        self._train = train
        self._leg: Leg | None = None
        self._from = 0
        self._piece: Leg | None = None

    def peek(self) -> Leg | None:
        """The next piece; before ``cut`` it is a single step."""
        if self._leg is None:
            if self._train.peek() is None:
                return None
            self._leg, self._from = self._train.pop(), 0
        if self._piece is None:
            self._piece = self._steps(self._leg, self._from + 1)
        return self._piece

    def cut(self, until_ns: int) -> Leg:
        """Let the next piece take every step of its leg that is planned before ``until_ns``, at least one."""
        assert self._leg is not None
        end = max(bisect_left(self._leg.instants_ns, until_ns), self._from + 1)
        self._piece = self._steps(self._leg, end)
        return self._piece

    def pop(self) -> Leg:
        """Take the next piece."""
        piece = self.peek()
        assert piece is not None
        assert self._leg is not None
        self._from += len(piece)
        if self._from >= len(self._leg):
            self._leg = None
        self._piece = None
        return piece

    def _steps(self, leg: Leg, end: int) -> Leg:
        start = leg.start_steps + leg.direction * self._from
        instants, gaps = leg.instants_ns[self._from : end], leg.gaps_ns[self._from : end - 1]
        stop = start + leg.direction * len(instants)
        return Leg(leg.direction, start, stop, leg.times_ns[self._from : end], instants, gaps)


class ExactLane(StepLane):
    """A PIC-STEP axis that is only ever loaded at rest."""

    def __init__(self, axis: StepAxis, train: PieceTrain, schedule: AdaptiveSchedule, axes: int) -> None:
        super().__init__(axis, schedule)
        self.train = train
        self.round_ns = axes * self.timing.mean_exchange_ns(LEG_BYTES)

    @property
    def pause_ns(self) -> int:
        """What must lie between two pieces."""
        return self.timing.jitter_max_ns + self.timing.start_delay_max_ns + MARGIN_NS

    @property
    def moving(self) -> bool:
        """A piece may still run when the next command has crossed the wire."""
        return self.axis.moving and self._free_ns() > self.schedule.now_ns

    def _free_ns(self) -> int:
        """From when a command may be sent so that even the slowest chip has arrived before it is complete."""
        return self.axis.twin.surely_stopped_from_ns() + 1 - self.timing.command_ns(1)

    def appointment_ns(self, horizon_ns: int) -> int | None:
        """When the next piece has to be sent, not before the one that runs has ended."""
        axis = self.axis
        piece = axis.next_leg()
        if piece is None:
            return None
        execute_ns = piece.instants_ns[0] + axis.start_ns - min(self.round_ns // 2, axis.period_max_ns)
        send_ns = execute_ns - self.schedule.mean_ns(0, LEG_BYTES)
        if axis.needs_stop_motor():
            send_ns -= self.timing.worst_ns(1)
        return max(send_ns, self._free_ns()) if axis.moving else send_ns

    def keep(self, turn: Turn) -> Stream:
        """Begin the next piece (or send the Stop Motor before it); the one before has ended when this is executed."""
        axis, schedule = self.axis, self.schedule
        if axis.moving:
            axis.close()
        if (yield from schedule.stop_motor(axis, turn.send_ns)):
            return
        execute_ns = schedule.mean_ns(turn.send_ns, LEG_BYTES)
        piece = self.train.cut(execute_ns + self.round_ns - axis.start_ns)
        last_ns = min(piece.instants_ns[-1] + axis.start_ns, execute_ns + self.round_ns - self.pause_ns)
        data, load = axis.piece_load((last_ns - execute_ns) // len(piece))
        evidence = yield schedule.load(axis, data, turn.send_ns)
        schedule.expect_rest(axis, evidence)
        axis.executed(load, schedule.window(evidence))

    def retime(self, trajectory: Trajectory) -> None:
        """Cut what is left from the trajectory as it is now; a piece beyond a rest is taken back."""
        axis, leg = self.axis, self.axis.leg
        from_ns, steps = axis.stood() if leg is None else (leg.instants_ns[-1] + 1, leg.stop_steps)
        self.train = PieceTrain(StepTrain(trajectory, axis.motor, from_ns / NS_PER_S, steps))
        axis.train, axis.trajectory = self.train, trajectory

    def worth_um(self, turn: Turn) -> float:
        """A running piece is never changed."""
        return 0.0


class ExactSchedule(AdaptiveSchedule):
    """The adaptive schedule over lanes whose every move ends by itself."""

    def __init__(self, trains: Sequence[PieceTrain], timing: BusTiming, bus: int, start_ns: int) -> None:
        axes = [StepAxis(train, timing, start_ns) for train in trains]
        super().__init__(axes, timing, bus)
        pairs = zip(axes, trains, strict=True)
        self.lanes = [ExactLane(axis, train, self, len(axes)) for axis, train in pairs]

    def run(self) -> Stream:
        """No group Start: each piece begins at its own instant, from the first to the last."""
        while True:
            for lane in self.lanes:
                lane.settle(self.now_ns)
            self._take_new_times()
            if not all(lane.done for lane in self.lanes):
                yield from self.proceed()
                continue
            if self.hold is None:
                return
            self.hold.stands = self.hold.stands or self.now_ns > self.hold.rest_ns
            yield Exchange(self.lanes[0].address, NO_OPERATION, send_at_ns=self.now_ns + IDLE_NS, bus=self.bus)

    def _take_new_times(self) -> None:
        """A piece that runs ends on its own step; what comes after it gets new instants."""
        if self._new_times is not None:
            for lane in self.lanes:
                assert isinstance(lane, ExactLane)
                lane.retime(self._new_times)
        self._new_times = None
