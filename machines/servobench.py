"""One PIC-SERVO axis on the bench: small test motions with trial gains, always between two returns to safe gains.

A trial sets its gains, makes its motion and is watched by reading the position as often as the bus allows. It ends at
once if the axis leaves the room that it was given or the chip has disabled its servo (position error limit), and
whatever it showed, the axis is then held by the gains of the machine file again and brought back to where it stood.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from machines.commission import Asker, UndecidedError
from nmc.chips import picservo
from nmc.chips.common import READ_STATUS
from nmc.errors import RemoteFault
from nmc.picservo import Gains, PicServo
from nmc.program import Exchange

F8 = npt.NDArray[np.float64]

NS_PER_MS = 1_000_000
AT_ONCE = 0x7FFFFFFF
"""Velocity and acceleration with which the profile reaches its goal in one tick: the true step response (4.3)."""
ONE = 65536
SETTLE_MS = 150
RETURN_TICKS = 400
"""The way back takes about so many servo ticks."""
RETURN_TIMEOUT_NS = 2_000 * NS_PER_MS
WITHIN_COUNTS = 2
"""A step has settled when it stays this near."""


@dataclass(frozen=True, slots=True)
class Watched:
    """A motion as it was seen: time f8[N] in ms from its begin, position f8[N] in counts; how it ended."""

    time_ms: F8
    position: F8
    disabled: bool
    left_room: bool

    @property
    def whole(self) -> bool:
        """It was watched to its end."""
        return not (self.disabled or self.left_room)

    def reversals(self) -> int:
        """How often the direction changed."""
        moves = np.diff(self.position)
        signs = np.sign(moves[moves != 0])
        return int(np.count_nonzero(np.diff(signs)))


@dataclass(frozen=True, slots=True)
class Response:
    """A step of ``step`` counts: position f8[N] counts beyond the begin, in the direction of the step."""

    step: int
    time_ms: F8
    position: F8
    whole: bool

    @property
    def overshoot(self) -> float:
        """Counts beyond the goal, or beyond where it comes to rest if a load has pushed that further."""
        return max(float(self.position.max(initial=0.0)) - max(self.step, self.rest), 0.0)

    @property
    def rest(self) -> float:
        """Where it comes to rest: the mean of the last fifth of the time, counts."""
        return float(self.position[-max(len(self.position) // 5, 1) :].mean())

    @property
    def steady_error(self) -> float:
        """Mean distance from the goal, counts, in the last fifth of the time."""
        return abs(self.rest - self.step)

    @property
    def rise_ms(self) -> float:
        """Time to nine tenths of the step; infinite if it does not come there."""
        there = np.flatnonzero(self.position >= 0.9 * self.step)
        return float(self.time_ms[there[0]]) if len(there) else float("inf")

    @property
    def settle_ms(self) -> float:
        """Time after which it stays within two counts of the goal; infinite if it does not."""
        away = np.flatnonzero(np.abs(self.position - self.step) > WITHIN_COUNTS)
        if not len(away):
            return 0.0
        return float(self.time_ms[away[-1] + 1]) if away[-1] + 1 < len(self.time_ms) else float("inf")

    @property
    def area(self) -> float:
        """Absolute error over time, counts x ms: what a controller is to make small."""
        return float(np.trapezoid(np.abs(self.position - self.step), self.time_ms))


class ServoBench:
    """Trials of one axis.

    safe: the gains that hold it between trials (whoever finds better ones may put them here); room: counts either way
    that it may be moved.
    """

    def __init__(self, chip: PicServo, safe: Gains, room: int, asker: Asker) -> None:
        self.chip = chip
        self.safe = safe
        self.room = room
        self.asker = asker
        self.trials = 0
        self.home = chip.position()
        chip.bus.arm_faults(chip.address)  # here a servo that disables itself is a finding, not a fault

    def step(self, gains: Gains, step: int, watch_ms: int) -> Response:
        """The answer to a step of ``step`` counts (signed) from the place of rest."""
        goal = self.home + step

        def begin() -> None:
            self.chip.load_trajectory(position=goal, velocity=AT_ONCE, acceleration=AT_ONCE, start_now=True)

        seen = self._trial(gains, begin, watch_ms, settle_first=True)
        sign = 1 if step > 0 else -1
        return Response(abs(step), seen.time_ms, (seen.position - self.home) * sign, seen.whole)

    def creep(self, gains: Gains, velocity: float, watch_ms: int) -> Watched:
        """A slow motion in velocity mode, ``velocity`` in counts a tick, signed."""

        def begin() -> None:
            speed = round(abs(velocity) * ONE)
            self.chip.load_trajectory(
                velocity=speed, acceleration=speed, velocity_mode=True, reverse=velocity < 0, start_now=True
            )

        return self._trial(gains, begin, watch_ms, settle_first=False)

    def restore(self) -> None:
        """Safe gains, and slowly back to the place of rest. Raises UndecidedError if the safe gains do not hold it."""
        chip = self.chip
        self.hold()
        distance = abs(self.home - chip.position())
        if not distance:
            return
        velocity = max(round(2 * distance * ONE / RETURN_TICKS), ONE // 16)
        acceleration = max(velocity * 4 // RETURN_TICKS, 1)
        chip.load_trajectory(position=self.home, velocity=velocity, acceleration=acceleration, start_now=True)
        try:
            chip.wait_until_done(RETURN_TIMEOUT_NS)
        except RemoteFault as fault:
            raise UndecidedError(f"with the gains of its file the axis does not come back: {fault}") from fault

    def hold(self) -> None:
        """Stand here, held by the safe gains, also if the servo has been disabled."""
        self.chip.set_gain(self.safe)
        self.chip.stop_motor("abruptly")
        self.chip.clear_sticky_bits()
        self.chip.stop_motor("abruptly")

    def _trial(self, gains: Gains, begin: Callable[[], None], watch_ms: int, *, settle_first: bool) -> Watched:
        """Set the gains, move, look on, restore."""
        self.trials += 1
        limit = min(gains.position_error_limit, 2 * self.room)
        try:
            self.chip.set_gain(replace(gains, position_error_limit=limit))
            seen = self._watch(SETTLE_MS) if settle_first else None
            if seen is None or seen.whole:
                begin()
                seen = self._watch(watch_ms)
        except BaseException:
            self.hold()  # and no way back: somebody wants it to stand, or the bus is in trouble
            raise
        self.restore()
        return seen

    def _watch(self, for_ms: int) -> Watched:
        asker = self.asker
        begin_ns = asker.now_ns
        time_ms: list[float] = []
        counts: list[int] = []
        disabled = left_room = False
        item = bytes([picservo.ITEM_POSITION])
        while not (disabled or left_room):
            evidence = asker.exchange(Exchange(self.chip.address, READ_STATUS, item, reply_extra=4))
            position = int.from_bytes(evidence.extra, "little", signed=True)
            time_ms.append((evidence.replied_ns - begin_ns) / NS_PER_MS)
            counts.append(position)
            disabled = bool((evidence.status or 0) & picservo.STATUS_POSITION_ERROR)
            left_room = abs(position - self.home) > self.room
            if time_ms[-1] >= for_ms:
                break
        return Watched(np.array(time_ms), np.array(counts, dtype=np.float64), disabled, left_room)
