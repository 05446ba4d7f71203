"""The streaming front: a trajectory in, bus exchanges out, one at a time, as the executor asks for them.

A source owns one bus. Lowering is lazy: step trains are cut from the trajectory chunk by chunk and the next exchange
is chosen only after the evidence of the previous one, so nothing is ever further ahead than one load an axis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from nmc.budget import BusTiming
from nmc.program import Evidence, Exchange
from planner.motors import Motor, ServoMotor, StepMotor
from planner.quantize import NS_PER_S
from planner.steptrain import Samples, StepTrain, longest_gap_s
from planner.stream_adaptive import AdaptiveSchedule
from planner.stream_axis import StepAxis
from planner.stream_base import StepSchedule
from planner.stream_exact import ExactSchedule
from planner.stream_group import GroupSchedule
from planner.stream_hold import Retimed
from planner.stream_pieces import PieceTrain
from planner.stream_servo import LOCK_EXCHANGES, STOP_HERE_BYTES, Pace, SmoothLane, StopHereLane
from planner.stream_strain import Off, servo_off, step_axes_off
from planner.timing import Rate
from planner.types import Trajectory, nobody_asks

Profile = Literal["auto", "group", "adaptive", "exact", "stop-here", "smooth"]
PROFILES: tuple[str, ...] = get_args(Profile)
LINE_NS = 5_000_000
SENT_NS = 8_000_000
"""What lies within this time of now counts as sent: loads on their way and periods that run."""
LEAD_IN_NS = 50_000_000
"""Time between the first exchange and t = 0 of the plan: room to load every axis before the first Start."""


@dataclass(frozen=True, slots=True)
class Progress:
    """Where the stream is: time in the plan, source line, planned position of each axis."""

    time_s: float
    duration_s: float
    line: int
    position: dict[str, float]


@dataclass(frozen=True, slots=True)
class StreamCounts:
    """Counters of a stream: group slices begun, slices that began late, mean slice length."""

    slices: int
    late_slices: int
    slice_ms: float


class StreamSource:
    """An ``nmc.program.ExchangeSource`` for the motors of one bus."""

    def __init__(self, trajectory: Trajectory, stream: StepSchedule, start_ns: int) -> None:
        self.trajectory = trajectory
        self.plan_start_ns = start_ns
        self._stream = stream
        self._former: StepSchedule | None = None
        self._run = stream.run()
        self._now_ns = 0
        self._line, self._line_ns = 0, -LINE_NS

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        """The next exchange, or None when every leg is done."""
        self._now_ns = self._stream.now_ns = now_ns
        if self._former is not None:
            self._former.now_ns = now_ns  # it still ends its slice
        try:
            exchange = next(self._run) if evidence is None else self._run.send(evidence)
        except StopIteration:
            return None
        return self._with_line(exchange)

    def passed(self, now_ns: int) -> None:
        """Time has passed since the last exchange was asked for, in a wait perhaps: requests count from here."""
        self._now_ns = max(self._now_ns, now_ns)

    def hold(self) -> float:
        """Come to rest along the path, as soon as the axes allow; returns the time of the rest in s of the plan.

        The stream then keeps the machine standing and asks it how it is until ``resume``. Raises ValueError for a
        trajectory that cannot be timed anew, or a profile that cannot hold.
        """
        schedule, trajectory = self.rate_control()
        rest_s = trajectory.hold(self._sent_s())
        schedule.retime(self.trajectory, self.plan_start_ns + round(rest_s.time_s * NS_PER_S))
        return rest_s.time_s

    def resume(self) -> None:
        """Go on after a hold, from where the axes were read to be."""
        schedule, trajectory = self.rate_control()
        trajectory.resume(self._sent_s() + schedule.departure_ns() / NS_PER_S)
        schedule.retime(self.trajectory, None)

    def override(self, rate: Rate) -> None:
        """Feed and rapid override of everything that has not been sent; while held it counts from the resume on.

        Raises ValueError as ``hold`` does, PlanError for a rate outside its range.
        """
        schedule, trajectory = self.rate_control()
        trajectory.override(self._sent_s(), rate)
        if schedule.hold is None:
            schedule.retime(self.trajectory, None)

    def assume(self, jitter_max_ns: int) -> None:
        """From now on the host is believed to need up to this long before the first byte of a packet leaves."""
        for stream in (self._former, self._stream):
            if stream is not None:
                stream.assume(replace(stream.timing, jitter_max_ns=jitter_max_ns))

    @property
    def held(self) -> bool:
        """A hold has been asked for and not been resumed from."""
        return isinstance(self._stream, AdaptiveSchedule) and self._stream.hold is not None

    @property
    def holding(self) -> bool:
        """A hold is on and every axis has come to rest and been read."""
        hold = self._stream.hold if isinstance(self._stream, AdaptiveSchedule) else None
        return hold is not None and hold.stands

    @property
    def steppers_rest(self) -> bool:
        """No stepper of this bus is known to move."""
        return not any(axis.moving for axis in self._stream.axes)

    def offs(self) -> list[Off]:
        """How far behind its plan each motor of this bus is believed to be."""
        stream, now_ns = self._stream, self._now_ns
        found = step_axes_off(stream.axes, self.trajectory, self.plan_start_ns, now_ns)
        if isinstance(stream, AdaptiveSchedule):
            found += [servo_off(lane, now_ns) for lane in stream.servos]
        return found

    def _sent_s(self) -> float:
        return (self._now_ns + SENT_NS - self.plan_start_ns) / NS_PER_S

    def rate_control(self) -> tuple[AdaptiveSchedule, Retimed]:
        """What takes new times, and the trajectory that gives them. Raises ValueError as ``hold`` does."""
        if not isinstance(self.trajectory, Retimed):
            raise ValueError("this trajectory cannot be timed anew")
        if isinstance(self._stream, GroupSchedule):
            self._former, self._stream = self._stream, self._stream.hand_over()
        assert isinstance(self._stream, AdaptiveSchedule)
        return self._stream, self.trajectory

    def progress(self) -> Progress:
        """Where the plan stands at the last exchange."""
        time_s = min(max((self._now_ns - self.plan_start_ns) / NS_PER_S, 0.0), self.trajectory.duration_s)
        at = np.array([time_s])
        q = self.trajectory.q(at)[0]
        line = int(self.trajectory.line(at)[0])
        return Progress(
            time_s, self.trajectory.duration_s, line, dict(zip(self.trajectory.axes, q.tolist(), strict=True))
        )

    def counts(self) -> StreamCounts:
        """Slices and late slices so far; ``slice_ms`` is the mean over the whole stream."""
        streams = [each for each in (self._former, self._stream) if each is not None]
        slices, late = (sum(counts) for counts in zip(*((s.slices, s.late_slices) for s in streams), strict=True))
        span_ns = max(self._now_ns - self.plan_start_ns, 0)
        return StreamCounts(slices, late, span_ns / 1e6 / slices if slices else 0.0)

    def _with_line(self, exchange: Exchange) -> Exchange:
        """Name the line that the exchange serves, looked up anew every few milliseconds of the plan."""
        at_ns = max(exchange.send_at_ns, self._now_ns)
        if not 0 <= at_ns - self._line_ns < LINE_NS:
            time_s = (at_ns - self.plan_start_ns) / NS_PER_S
            self._line, self._line_ns = int(self.trajectory.line(np.array([time_s]))[0]), at_ns
        e = exchange  # forty thousand a minute: dataclasses.replace would cost three times as much
        return Exchange(
            e.address,
            e.command,
            e.data,
            e.reply_extra,
            e.send_at_ns,
            self._line,
            e.bus,
            e.at_rest,
            e.endless,
            e.not_after_ns,
            e.for_rest,
        )


def lead_in_ns(motors: Sequence[Motor], timing: BusTiming) -> int:
    """Time that a stream needs between its first exchange and t = 0: first loads, and locking onto servo clocks."""
    locks = sum((LOCK_EXCHANGES + 1) * timing.worst_ns(STOP_HERE_BYTES) for m in motors if isinstance(m, ServoMotor))
    return LEAD_IN_NS + locks


def make_source(
    trajectory: Trajectory,
    motors: Sequence[Motor],
    *,
    timing: BusTiming,
    start_ns: int,
    profile: Profile = "auto",
    alive: Callable[[], None] = nobody_asks,
) -> StreamSource:
    """A stream of ``trajectory`` for the motors of one bus.

    All modules must rest, parked (see ``planner.stream_regroup``), with their counters at the trajectory's first
    position and servos enabled. start_ns: link time of t = 0; leave ``lead_in_ns`` before it. profile: of the steppers
    ``group``, ``adaptive`` or ``exact``, of the servos ``stop-here`` or ``smooth``; a name of one kind leaves the other
    at its default, and on a bus with servos the steppers are always led ``adaptive``. alive: called between bounded
    pieces of what is reckoned while the machine moves, so that its watchdog knows.

    Raises:
        StreamError: from ``next``, when a reply contradicts the twins: the machine must be stopped.
        ValueError: motors of several buses, or a profile that is not offered.
    """
    if len({motor.bus for motor in motors}) != 1:
        raise ValueError("a source drives the motors of one bus")
    if profile not in PROFILES:
        raise ValueError(f"profile {profile!r} is not offered ({', '.join(PROFILES)} are)")
    steppers = [motor for motor in motors if isinstance(motor, StepMotor)]
    servos = [motor for motor in motors if isinstance(motor, ServoMotor)]
    samples = Samples(trajectory)
    exact = profile == "exact" and not servos
    together = len(steppers) if exact else 0
    trains = [
        StepTrain(trajectory, motor, samples=samples, alive=alive, gap_s=longest_gap_s(motor, timing, together))
        for motor in steppers
    ]
    if exact:
        schedule: StepSchedule = ExactSchedule([PieceTrain(t) for t in trains], timing, motors[0].bus, start_ns)
        return StreamSource(trajectory, schedule, start_ns)
    axes = [StepAxis(train, timing, start_ns) for train in trains]
    if not servos and profile != "adaptive":
        return StreamSource(trajectory, GroupSchedule(axes, timing, motors[0].bus), start_ns)
    adaptive = AdaptiveSchedule(axes, timing, motors[0].bus)
    adaptive.alive = alive
    mates: list[SmoothLane] = []
    pace = Pace(alone={motor.axis for motor in servos} == set(trajectory.axes))
    for motor in servos:
        if profile == "smooth":
            adaptive.add_servo(SmoothLane(trajectory, motor, adaptive, start_ns, mates))
        else:
            adaptive.add_servo(StopHereLane(trajectory, motor, adaptive, start_ns, pace))
    return StreamSource(trajectory, adaptive, start_ns)
