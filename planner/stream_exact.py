"""Profile ``exact``: all axes make the path in slices, and in every slice each of them stops on its own step.

While the pieces of a slice run, the next ones are loaded with stop position and count but not started, which has "no
effect whatsoever" (PIC-STEP data sheet, section 5.1). When all axes stand, one group Start begins them together:

    X     | | | | | | | .  | | | | | | | .  |       each dot: the axis stands on its stop position
    Y     |   |   |   | .  |   |    |    .  |
    bus   [X ][Y ]   [Start][X ][Y ]   [Start]

No count ever meets an axis that moves, so it does not matter when the chip takes a new count, and a host that dies
leaves every axis on a step of its path, one slice further at most. All axes pause together, and together they are late
when the host is: the path suffers from neither, only its tempo, and the slice that follows makes up for that.

A start executed in a running axis would be against table 4: before the Start even the slowest chip has arrived, counted
from the answer to the last Start, which came after it had been received, however long the host or the wire took.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from nmc.budget import BusTiming
from nmc.program import Evidence, Exchange
from planner.quantize import NS_PER_S
from planner.steptrain import LEG_BYTES
from planner.stream_adaptive import IDLE_NS, AdaptiveSchedule
from planner.stream_axis import LOAD_TRAJECTORY, Load, StepAxis
from planner.stream_base import LATE_NS, NO_OPERATION, START_MOTION, Stream
from planner.stream_pieces import PieceTrain, Slice, best_end_ns, period_for, steps_in
from planner.stream_regroup import STREAMING_GROUP, Groups, regroup
from planner.types import Trajectory

MARGIN_NS = 50_000
"""Between the slowest chip's arrival and the Start."""
REGROUP_BYTES = 2
"""Data of a Set Address."""
FASTER = 1.5
"""A slice runs at most so much faster than the plan."""
PAUSES = 4
"""A slice is at least this many pauses long."""
LONG_NS = 8_000_000
"""A slice is made no longer than this to catch up, unless it takes longer to load all axes: how far its chord is off a
bend grows with the square of it."""
LAG_NS = 10_000_000
"""Beyond this lag slices grow longer all the same."""
RATE_RESERVE = 1.05
"""Near its chip's highest rate an axis needs longer slices, in which the pauses take so little that this is left."""
LEAST_RUN = 0.05
"""Share of such a slice, at least, in which it runs."""
BEND_STEPS = 1.0
"""Such a slice is no longer than lets its chord be this far off the path; on a bend such an axis falls behind."""
LONGEST_NS = 100_000_000
"""What stands for that length where the path does not bend."""
END_SHARE = 0.08
"""A slice may end this share of it sooner or later."""
GAP_SLICES = 2
"""Where no axis steps for so many slices, the machine rests and the next slice begins with the step that ends it."""


@dataclass(frozen=True, slots=True)
class Piece:
    """What one axis does in a slice; ``turns``: a Stop Motor has to come before its load."""

    axis: StepAxis
    steps: int
    direction: int
    period_ns: int
    turns: bool


def pause_ns(timing: BusTiming) -> int:
    """How long the axes stand before the next Start is executed, three times in four or so.

    Less would make slices late more often, more would make all of them faster.
    """
    unsure_ns = timing.reply_delay_max_ns + timing.jitter_max_ns
    return timing.start_delay_max_ns + unsure_ns * 3 // 4 + MARGIN_NS


def round_least_ns(timing: BusTiming) -> int:
    """Time from Start to Start on such a bus, at least."""
    return PAUSES * pause_ns(timing)


class ExactSchedule(AdaptiveSchedule):
    """Slices begun by a group Start when every axis stands. ``trains``: one an axis; start_ns: link time of t = 0."""

    def __init__(self, trains: Sequence[PieceTrain], timing: BusTiming, bus: int, start_ns: int) -> None:
        self.trains = list(trains)
        super().__init__([StepAxis(train, timing, start_ns) for train in trains], timing, bus)
        self.start_ns = start_ns
        self._made_ns: int | None = None
        """Until here, ns of the plan, slices have been begun."""

    def run(self) -> Stream:
        """Slice after slice, until the trains are over and every axis stands; before a rest in the plan all stand."""
        while True:
            self._take_new_times()
            due_ns = self._due_ns()
            if (due_ns is None or self._after_rest(due_ns)) and any(axis.moving for axis in self.axes):
                yield from self._arrive()
            elif due_ns is not None:
                yield from self._slice(due_ns)
            elif self.hold is None:
                return
            else:
                self.hold.stands = self.hold.stands or self.now_ns > self.hold.rest_ns
                yield from self._ask(self.axes[0], self.now_ns + IDLE_NS)

    def _due_ns(self) -> int | None:
        """Planned instant, ns of the plan, of the first step that has not been loaded; None if there is none."""
        dues = [axis_ns for axis in self.axes if (axis_ns := axis.first_step_ns()) is not None]
        return min(dues) - self.start_ns if dues else None

    def _after_rest(self, due_ns: int) -> bool:
        """Nothing steps for so long that the slice with the step due then begins anew, not where the last one ended."""
        return self._made_ns is None or due_ns - self._made_ns > GAP_SLICES * self._full_round_ns()

    def _arrive(self) -> Stream:
        """See every axis stand."""
        for axis in self.axes:
            if axis.moving:
                yield from self._ask(axis, self._stands_ns(axis) - self.timing.command_ns(0))
                axis.close(self.now_ns)

    def _ask(self, axis: StepAxis, at_ns: int) -> Stream:
        evidence = yield Exchange(axis.motor.address, NO_OPERATION, send_at_ns=at_ns, bus=self.bus)
        self._expect(axis, evidence)

    # --- a slice -----------------------------------------------------------------------------------------------------

    def _slice(self, due_ns: int) -> Stream:
        """Load what comes next while the last slice runs; when all stand, start it."""
        part, pieces, wanted_ns = self._plan(due_ns)
        foreseen_ns = max(wanted_ns, self.now_ns + self._loading_ns(pieces, self.timing.worst_ns)) + LATE_NS
        yield from self.regroup({piece.axis.motor.address for piece in pieces})
        loads = []
        for piece in pieces:
            loads.append((yield from self._load(piece)))
        if self.changing:
            return  # nothing of this has begun: what comes next is planned anew, and loaded over it
        members = tuple(piece.axis.motor.address for piece in pieces)
        start = Exchange(STREAMING_GROUP, START_MOTION, send_at_ns=wanted_ns, bus=self.bus, at_rest=members)
        evidence = yield start
        if not evidence.sent:
            return  # recalled for new times
        self.late_slices += evidence.sent_ns > foreseen_ns
        self._began(part, loads, evidence)

    def _load(self, piece: Piece) -> Generator[Exchange, Evidence, tuple[StepAxis, Load]]:
        """Stop position and count for the next Start; an axis that turns is stopped first, which needs it to stand."""
        axis = piece.axis
        if piece.turns:
            stands_ns = self._stands_ns(axis)
            if axis.moving:
                axis.close(self.now_ns)
            yield from self.stop_motor(axis, stands_ns - self.timing.command_ns(1))
        data, load = axis.piece_load(piece.period_ns)
        address, rests = axis.motor.address, () if axis.moving else (axis.motor.address,)
        evidence = yield Exchange(address, LOAD_TRAJECTORY, data, bus=self.bus, at_rest=rests, for_rest=axis.moving)
        self._expect(axis, evidence)
        return axis, load

    def _began(self, part: Slice, loads: Sequence[tuple[StepAxis, Load]], evidence: Evidence) -> None:
        """The Start has been answered: the leader stood, and what has been loaded is under way."""
        leader = self.groups.leader[STREAMING_GROUP]
        for axis in self.axes:
            if axis.motor.address == leader:
                self.expect_rest(axis, evidence)
            if axis.moving:
                axis.close(self.now_ns)
        window = self.timing.execution_window_ns(evidence.sent_ns, evidence.replied_ns, 0)
        received_ns = evidence.replied_ns - self.timing.reply_ns(0)
        latest_ns = max(window.latest_ns, received_ns + self.timing.start_delay_max_ns)
        for axis, load in loads:
            axis.executed(load, window._replace(latest_ns=latest_ns))
        self.slices += 1
        self._made_ns = part.until_ns

    def _expect(self, axis: StepAxis, evidence: Evidence) -> None:
        """The guardian: an axis moves although even the slowest chip has arrived, or stands long before the fastest."""
        twin = axis.twin
        judged_ns = evidence.sent_ns + self.timing.command_ns(len(evidence.exchange.data))
        if not axis.moving or self._stands_ns(axis) <= judged_ns:
            self.expect_rest(axis, evidence)
        elif twin.surely_moving_until_ns() - twin.nominal.period_ns > evidence.replied_ns:
            self.expect_moving(axis, evidence)  # a period early is the chip whose first step comes at once

    # --- what a slice is to be ----------------------------------------------------------------------------------------

    def _plan(self, due_ns: int) -> tuple[Slice, list[Piece], int]:
        """The slice with the step that is due at ``due_ns``, what each axis does in it, and when its Start is to leave.

        It begins where the last one ended, or half a slice before the first step after a rest. It ends where the plan
        will be when the next Start can be executed, so a slice that has come late is followed by a faster one.
        """
        made_ns = self._made_ns
        least_ns = self._rate_round_ns(due_ns)
        round_ns = max(self._full_round_ns(), least_ns)
        from_ns = due_ns - round_ns // 2 if made_ns is None or self._after_rest(due_ns) else made_ns
        lead_ns = self.mean_ns(0) - self.start_ns
        wanted_ns = max([from_ns - lead_ns, *(self._stands_ns(a) - self.timing.command_ns(0) for a in self.axes)])
        full_ns = round_ns
        loading_ns = round_ns
        pieces: list[Piece] = []
        for turn in range(3):  # how long loading takes hangs on the pieces, and they on how long it takes: to and fro
            begin_ns = max(wanted_ns, self.now_ns + loading_ns) + lead_ns
            run_ns = round_ns - pause_ns(self.timing)
            longest_ns = max(LONG_NS, full_ns * 21 // 20) + max(begin_ns - from_ns - LAG_NS, 0) // 2
            until_ns = min(begin_ns + round_ns, from_ns + int(FASTER * run_ns), from_ns + longest_ns)
            part = Slice(from_ns, until_ns, run_ns)
            part, pieces = self._pieces(part)
            loading_ns = self._loading_ns(pieces, self.timing.mean_exchange_ns)
            expected_ns = max(self._round_ns(self._next_loading_ns(part, pieces)), least_ns)
            round_ns = expected_ns if turn == 0 else max(round_ns, expected_ns)
        return part, pieces, wanted_ns

    def _next_loading_ns(self, part: Slice, pieces: Sequence[Piece]) -> int:
        """How long loading for the slice after this one will take."""
        timing = self.timing
        until_ns = 2 * part.until_ns - part.from_ns
        taken = {piece.axis.motor.address: piece for piece in pieces}
        changes = loading_ns = 0
        for axis, train in zip(self.axes, self.trains, strict=True):
            piece = taken.get(axis.motor.address)
            ahead = train.after(piece.steps if piece else 0)
            moves = ahead is not None and ahead[0] < until_ns
            changes += moves is not (piece is not None)
            if ahead is not None and moves:
                turns = piece is not None and piece.direction != ahead[1]
                loading_ns += timing.mean_exchange_ns(LEG_BYTES) + turns * timing.mean_exchange_ns(1)
        return loading_ns + changes * timing.mean_exchange_ns(REGROUP_BYTES)

    def _pieces(self, part: Slice) -> tuple[Slice, list[Piece]]:
        """What each axis does in a slice, and the slice, which may have to be shorter."""
        wanted = part
        part = part.until(part.until_ns + int(END_SHARE * (part.until_ns - part.from_ns)))
        for axis, train in zip(self.axes, self.trains, strict=True):
            part = self._fitting(part, axis, train)
        part = self._well_ended(part, wanted)
        pieces = []
        for axis, train in zip(self.axes, self.trains, strict=True):
            due = train.due(part.until_ns)
            steps = steps_in(part, due, axis.motor.first_at_once)
            if steps:
                pieces.append(self._piece(axis, train, due[:steps], part))
        pieces.sort(key=lambda piece: piece.turns)  # what has to stand first comes last
        return part, pieces or [self._first_step(part)]

    def _well_ended(self, part: Slice, wanted: Slice) -> Slice:
        """A slice ends where the steps of the axes fall well, about where it was wanted to."""
        span_ns = wanted.until_ns - wanted.from_ns
        step_ns = 2 * min(axis.period_min_ns for axis in self.axes)
        earliest_ns = min(wanted.until_ns - int(END_SHARE * span_ns), part.until_ns - step_ns)
        best_ns = best_end_ns([train.due(part.until_ns) for train in self.trains], earliest_ns, part.until_ns)
        return part if best_ns is None else part.until(best_ns + 1)

    def _fitting(self, part: Slice, axis: StepAxis, train: PieceTrain) -> Slice:
        """A slice is cut shorter where an axis cannot step so fast, and where one would begin a second leg in it."""
        due = train.due(part.until_ns)
        steps = steps_in(part, due, axis.motor.first_at_once)
        if steps * axis.period_min_ns > part.run_ns:
            part = part.until(
                part.from_ns + (part.until_ns - part.from_ns) * part.run_ns // (steps * axis.period_min_ns)
            )
        if 0 < steps == len(due):
            ahead = train.after(steps)
            least_ns = part.from_ns + (part.until_ns - part.from_ns) // 4
            if ahead is not None and least_ns < ahead[0] < part.until_ns:
                part = part.until(ahead[0])
        return part

    def _piece(self, axis: StepAxis, train: PieceTrain, instants_ns: list[int], part: Slice) -> Piece:
        leg = train.cut(len(instants_ns))
        turns = not axis.stop_motor_sent and leg.direction != (axis.leg.direction if axis.leg else axis.last_direction)
        return Piece(axis, len(leg), leg.direction, period_for(part, instants_ns, axis.motor.first_at_once), turns)

    def _first_step(self, part: Slice) -> Piece:
        """What goes on if no step is in the slice: the one that is due first."""
        dues = [(train.due(part.from_ns)[:1], axis, train) for axis, train in zip(self.axes, self.trains, strict=True)]
        first, axis, train = min((each for each in dues if each[0]), key=lambda each: each[0])
        return self._piece(axis, train, first, part)

    def _stands_ns(self, axis: StepAxis) -> int:
        """From when on even the slowest chip stands; 0 of an axis at rest."""
        return axis.twin.surely_stopped_from_ns() + MARGIN_NS if axis.moving else 0

    def _rate_round_ns(self, due_ns: int) -> int:
        """How long a slice from ``due_ns`` on must be so that an axis makes all its steps beside the pause in it."""
        busiest = 0.0
        for axis, train in zip(self.axes, self.trains, strict=True):
            due = train.due(due_ns + LONG_NS)
            if len(due) > 2:
                busiest = max(busiest, RATE_RESERVE * axis.period_min_ns * (len(due) - 1) / max(due[-1] - due[0], 1))
        round_ns = int(pause_ns(self.timing) / max(1.0 - busiest, LEAST_RUN))
        return round_ns if round_ns <= round_least_ns(self.timing) else min(round_ns, self._chord_ns(due_ns))

    def _chord_ns(self, due_ns: int) -> int:
        """How long a slice from ``due_ns`` on may be for its chord to be ``BEND_STEPS`` off the path: a t^2 / 8."""
        trajectory = self.axes[0].trajectory
        column = [trajectory.axes.index(axis.motor.axis) for axis in self.axes]
        per_unit = np.array([axis.motor.steps_per_unit for axis in self.axes])
        before, after = trajectory.v(np.array([due_ns, due_ns + LONG_NS]) / NS_PER_S)[:, column] * per_unit
        change, way = after - before, after + before
        across = change - way * (change @ way) / max(float(way @ way), 1e-9)
        bend = float(np.linalg.norm(across)) / (LONG_NS / NS_PER_S)
        return int((8 * BEND_STEPS / bend) ** 0.5 * NS_PER_S) if bend > 1e-3 else LONGEST_NS

    def _full_round_ns(self) -> int:
        """Time from Start to Start if every axis is loaded in between."""
        return self._round_ns(len(self.axes) * self.timing.mean_exchange_ns(LEG_BYTES))

    def _round_ns(self, loading_ns: int) -> int:
        """Time from Start to Start, in the mean, with so much loading in between."""
        return max(self.timing.mean_exchange_ns(0) + loading_ns, round_least_ns(self.timing))

    def _loading_ns(self, pieces: Sequence[Piece], exchange_ns: Callable[[int], int]) -> int:
        """How long it takes until the Start of these pieces may leave; ``exchange_ns``: of so many data bytes."""
        groups = self.groups
        groups = Groups(set(groups.streaming), set(groups.parked), dict(groups.leader))
        addresses = [piece.axis.motor.address for piece in pieces]
        at_ns = self.now_ns + len(regroup(groups, addresses, addresses)) * exchange_ns(REGROUP_BYTES)
        for piece in pieces:
            if piece.turns:
                at_ns = max(at_ns, self._stands_ns(piece.axis) - self.timing.command_ns(1)) + exchange_ns(1)
            at_ns += exchange_ns(LEG_BYTES)
        return at_ns - self.now_ns

    # --- new times ---------------------------------------------------------------------------------------------------

    def _take_new_times(self) -> None:
        """A piece that runs ends on its own step; what comes after it gets new instants."""
        if self._new_times is None:
            return
        self.trains = [self._recut(axis, self._new_times) for axis in self.axes]
        self._new_times = None

    def _recut(self, axis: StepAxis, trajectory: Trajectory) -> PieceTrain:
        leg = axis.leg
        from_ns, steps = axis.stood() if leg is None else (leg.instants_ns[-1] + 1, leg.stop_steps)
        train = PieceTrain(axis.cut(trajectory, from_ns, steps, len(self.axes)))
        axis.train, axis.trajectory = train, trajectory
        return train
