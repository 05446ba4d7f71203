"""Questions to a PIC-STEP that its data sheet leaves open and the driver's guard forbids to ask (X-63 to X-66).

Each question is one short run at ``PERIOD_NS`` a step that is ended by a Stop Motor after ``STEPS_MOST`` steps at the
latest, sent over the same line without the guard. Afterwards the axis is brought back to where it stood. What the chip
does is told in words. The driver avoids all of these cases but one: a run onwards from a reached stop position.
"""

from __future__ import annotations

from dataclasses import dataclass

from machines.bringup import Connection, expectations
from machines.commission import Asker, StopRequested, UndecidedError, never, unguarded
from machines.schema import MachineConfig
from nmc.bus import Bus
from nmc.chips import picstep
from nmc.chips.common import LOAD_TRAJECTORY, READ_STATUS, STOP_MOTOR
from nmc.picstep import PicStep
from nmc.program import Exchange
from nmc.setup import identify, reset_network
from planner.quantize import count_of_period, nearest_speed

NS_PER_MS = 1_000_000
PERIOD_NS = 20 * NS_PER_MS
STEPS_MOST = 6
WATCH_NS = 400 * NS_PER_MS
SPEED_MODE = 1


@dataclass(frozen=True, slots=True)
class Answer:
    """What a chip did. as_assumed: the simulator does the same."""

    rule: str
    question: str
    answer: str
    as_assumed: bool


@dataclass(frozen=True, slots=True)
class Outcome:
    """Where a run went: steps from its begin, and whether it had to be stopped."""

    steps: int
    moving: bool


class Silences:
    """The questions about one axis. The chip must be in speed mode 1x, at rest, its amplifier on."""

    def __init__(self, chip: PicStep, connection: Connection, stop_requested: StopRequested = never) -> None:
        self.chip = chip
        self.asker = Asker(unguarded(connection, chip.bus), stop_requested)

    def ask_all(self, amplifier_off: bool = False) -> list[Answer]:
        """X-63, X-64 and X-65; with ``amplifier_off`` also the first half of X-66, which lets the axis go.

        Raises UndecidedError where the axis cannot be brought back.
        """
        found = [self.direction(), self.same_direction(), self.reversal(), self.no_length()]
        return [*found, self.amplifier_off()] if amplifier_off else found

    def direction(self) -> Answer:
        """X-63: a stop position ahead, the direction bit pointing back."""
        begin = self._ready()
        seen = self._run(begin + 3, begin, reverse=True)
        self._return(begin)
        words = {
            (True, False): "the stop position decides: it went there",
            (False, True): "the direction bit decides: it ran away from the stop position",
            (False, False): "it did not move",
        }.get((seen.steps == 3 and not seen.moving, seen.steps < 0), f"it made {seen.steps:+d} steps")
        return Answer("X-63", "direction bit and stop position disagree", words, seen.steps < 0)

    def same_direction(self) -> Answer:
        """X-64, first half: a run in the same direction after a reached stop position, without a Stop Motor."""
        begin = self._ready()
        self._to(begin + 2)
        seen = self._run(begin + 4, begin + 2, reverse=False)
        self._return(begin)
        good = seen == Outcome(2, False)
        words = "it runs to its new stop position" if good else _strange(seen)
        return Answer("X-64", "a run onwards from a reached stop position, without Stop Motor", words, good)

    def reversal(self) -> Answer:
        """X-64, second half: a run back from a reached stop position, without a Stop Motor."""
        begin = self._ready()
        self._to(begin + 3)
        seen = self._run(begin, begin + 3, reverse=True)
        self._return(begin)
        good = seen == Outcome(-3, False)
        words = "it turns back: a reached stop position counts as stopped" if good else _strange(seen)
        return Answer("X-64", "a run back from a reached stop position, without Stop Motor", words, good)

    def no_length(self) -> Answer:
        """X-65: a stop position where the axis stands."""
        begin = self._ready()
        seen = self._run(begin, begin, reverse=False)
        self._return(begin)
        good = seen == Outcome(0, False)
        words = "no step, it stands" if good else _strange(seen)
        return Answer("X-65", "a move of no length", words, good)

    def amplifier_off(self) -> Answer:
        """X-66, first half: motion while AMP_EN is low. The motor holds nothing meanwhile."""
        begin = self._ready()
        self.chip.stop_motor("abruptly", amplifier=False)
        seen = self._run(begin + 3, begin, reverse=False)
        self._stop(amplifier=False)
        self._back_unpowered(begin)
        self.chip.stop_motor("abruptly")
        good = seen == Outcome(3, False)
        words = "the position counter runs, the motor is without current" if good else _strange(seen)
        return Answer("X-66", "motion with the amplifier off", words, good)

    # --- runs ------------------------------------------------------------------------------------------------------

    def _ready(self) -> int:
        self.chip.stop_motor("abruptly")
        return self.chip.position()

    def _to(self, goal: int) -> None:
        """A legal run, watched to its end by the free line, so that no Stop Motor comes after it."""
        begin = self.chip.position()
        seen = self._run(goal, begin, reverse=goal < begin)
        if seen != Outcome(goal - begin, False):
            raise UndecidedError(f"a plain run of {goal - begin} steps made {seen.steps}: is it at a limit switch?")

    def _run(self, goal: int, begin: int, *, reverse: bool) -> Outcome:
        seen = run_freely(self.asker, self.chip.address, goal, begin, reverse=reverse)
        if seen.moving:
            self._stop(amplifier=True)
        return seen

    def _stop(self, *, amplifier: bool) -> None:
        control = picstep.STOP_ABRUPTLY | (picstep.STOP_AMP_ENABLE if amplifier else 0)
        self.asker.exchange(Exchange(self.chip.address, STOP_MOTOR, bytes([control])))

    def _return(self, place: int) -> None:
        self.chip.stop_motor("abruptly")
        if self.chip.position() != place:
            self._to(place)
            self.chip.stop_motor("abruptly")
        if self.chip.position() != place:
            raise UndecidedError("the axis did not come back to where it stood")

    def _back_unpowered(self, place: int) -> None:
        """The counter went on while the motor stood: it goes back in the same way, before the motor is held again."""
        here = self.chip.position()
        if here != place:
            run_freely(self.asker, self.chip.address, place, here, reverse=place < here)


def run_freely(asker: Asker, address: int, goal: int, begin: int, *, reverse: bool) -> Outcome:
    """Load stop position and count, start, and look on until the chip stands, has gone too far, or time is up."""
    control = picstep.LOAD_POSITION | picstep.LOAD_COUNT | picstep.LOAD_START_NOW
    control |= picstep.LOAD_REVERSE if reverse else 0
    count = count_of_period(PERIOD_NS, SPEED_MODE).to_bytes(2, "little")
    data = bytes((control,)) + goal.to_bytes(4, "little", signed=True) + count
    data += bytes((nearest_speed(PERIOD_NS, SPEED_MODE),))
    asker.exchange(Exchange(address, LOAD_TRAJECTORY, data))
    end_ns = asker.now_ns + WATCH_NS
    seen = _look(asker, address, begin)
    while abs(seen.steps) < STEPS_MOST and asker.now_ns < end_ns:
        seen = _look(asker, address, begin)
        if not seen.moving and asker.now_ns > end_ns - WATCH_NS + 2 * PERIOD_NS:
            break
    return seen


def _look(asker: Asker, address: int, begin: int) -> Outcome:
    item = bytes([picstep.ITEM_POSITION])
    evidence = asker.exchange(Exchange(address, READ_STATUS, item, reply_extra=4))
    steps = int.from_bytes(evidence.extra, "little", signed=True) - begin
    return Outcome(steps, bool((evidence.status or 0) & picstep.STATUS_MOVING))


def _strange(seen: Outcome) -> str:
    if seen.moving:
        return f"it ran on and was stopped after {seen.steps:+d} steps"
    return f"it made {seen.steps:+d} steps" if seen.steps else "it did not move"


def before_parameters(config: MachineConfig, bus: Bus, name: str, address: int) -> Answer:
    """X-66, second half: motion of a module that has been reset and not been given its parameters.

    Resets the whole bus first and leaves it reset: amplifiers off, positions forgotten.
    """
    reset_network(bus)
    free = Bus(bus.link, grace_ns=bus.grace_ns, host_latency_ns=bus.host_latency_ns)
    identify(free, len(expectations(config, name)))
    seen = run_freely(Asker(free), address, 3, 0, reverse=False)
    free.exchange(Exchange(address, STOP_MOTOR, bytes([picstep.STOP_ABRUPTLY])))
    reset_network(bus)
    good = seen == Outcome(0, False)
    words = "the load is ignored" if good else _strange(seen)
    if seen.steps and not seen.moving:
        words += " (the amplifier was off)"
    return Answer("X-66", "motion before Set Parameters", words, good)
