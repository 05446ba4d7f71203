"""Finds the gains of a PIC-SERVO by the procedure of its data sheet (section 4.3), on a real axis or on the twin.

    1  Kp = Ki = 0: raise Kd until the motor starts to hum, then back off a little
    2  raise Kp and command small steps until they overshoot, then back off a little
    3  IL = 16000: raise Ki until what is left of a step goes away in acceptable time
    4  lower IL to the least value that still takes it away

A hum is heard by the encoder: an axis that creeps in velocity mode turns back and forth between its edges. Every trial
is small, in both directions, and goes back to the gains of the machine file before the next (``servobench.py``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from machines.commission import UndecidedError
from machines.servobench import Response, ServoBench
from nmc.picservo import Gains

CREEP = 0.1
"""Counts a tick: slow enough that single encoder edges show."""
CREEP_MS = 300
HUM_REVERSALS = 6
"""So many changes of direction in two creeps of 0.3 s are a hum."""
STEP_MS = 250
LONG_MS = 500
"""What the integral term has not taken away by then stays."""
KD_FIRST, KD_MOST = 500, 0x7FFF
KP_FIRST, KP_MOST = 20, 0x7FFF
KI_FIRST, KI_MOST = 20, 0x3FFF
RAISE = 1.25
"""From one trial to the next; to back off a little is to go one trial back."""
RAISE_KI = 1.5
IL_FIRST = 16_000
IL_LEAST = 1
IL_SPARE = 4.0
"""Friction and load are not the same everywhere: so much more than was needed here."""
OVERSHOOT = 0.04
OVERSHOOT_KI = 0.20
"""Shares of a step; the integral term brings some overshoot with it (step 3 of the sheet)."""
SHORT = 0.25
"""A step that is still this far from its goal tells nothing about overshoot: the gain is too weak for the load."""
COUNTS = 1.0
"""An error of one count is none."""


@dataclass(frozen=True, slots=True)
class Attempt:
    """One line of the search: what was tried, and what it showed in words."""

    stage: str
    gains: Gains
    words: str
    good: bool


@dataclass(frozen=True, slots=True)
class Tuned:
    """The gains that were found; steps with the gains before and with these; the search."""

    gains: Gains
    before: tuple[Response, Response]
    after: tuple[Response, Response]
    attempts: tuple[Attempt, ...]
    notes: tuple[str, ...]


class Tuner:
    """The search on one bench. step: counts of a test step; tell: told of every attempt."""

    def __init__(self, bench: ServoBench, step: int, tell: Callable[[Attempt], None] = lambda attempt: None) -> None:
        self.bench = bench
        self.step = step
        self._tell = tell
        self._attempts: list[Attempt] = []
        self._notes: list[str] = []

    def tune(self) -> Tuned:
        """The whole procedure. Raises UndecidedError where the axis does not answer as a servo does."""
        start = self.bench.safe
        self.bench.restore()
        before = self._steps(start)
        bare = replace(start, position_gain=0, integral_gain=0, integration_limit=0)
        damped = self._raise_kd(bare)
        self.bench.safe = self._raise_kp(damped)  # from here on it comes back better than with the gains of its file
        self.bench.safe = gains = self._lower_il(self._raise_ki(self.bench.safe))
        after = self._steps(gains)
        if not all(one.whole for one in after):
            raise UndecidedError("the axis leaves its room with the gains that were found")
        self.bench.restore()
        self.bench.safe = start
        self.bench.hold()
        return Tuned(gains, before, after, tuple(self._attempts), tuple(self._notes))

    # --- the four steps --------------------------------------------------------------------------------------------

    def _raise_kd(self, bare: Gains) -> Gains:
        """Step 1."""
        kd, last = float(KD_FIRST), 0
        while kd <= KD_MOST:
            gains = replace(bare, velocity_gain=round(kd))
            creeps = [self.bench.creep(gains, velocity, CREEP_MS) for velocity in (CREEP, -CREEP)]
            turns = sum(creep.reversals() for creep in creeps)
            hums = turns >= HUM_REVERSALS
            self._note("Kd", gains, f"{turns} turns while creeping" + (": it hums" if hums else ""), not hums)
            if hums:
                break
            last = gains.velocity_gain
            kd *= RAISE
        else:
            self._notes.append("the motor does not hum even with the greatest Kd")
        if not last:
            raise UndecidedError(f"the motor hums with Kd = {KD_FIRST} already: is the encoder's direction right?")
        return replace(bare, velocity_gain=last)

    def _raise_kp(self, damped: Gains) -> Gains:
        """Step 2."""
        kp, last = float(KP_FIRST), 0
        while kp <= KP_MOST:
            gains = replace(damped, position_gain=round(kp))
            steps = self._steps(gains)
            beyond = max(one.overshoot for one in steps)
            short = max(one.steady_error for one in steps) > SHORT * self.step
            good = all(one.whole for one in steps) and (short or beyond <= max(OVERSHOOT * self.step, COUNTS))
            self._note("Kp", gains, _words(steps), good)
            if not good:
                break
            if short and gains.position_gain * self.step >= 256 * gains.output_limit:
                raise UndecidedError("even the full output does not bring the axis to the end of a step: is it free?")
            last = gains.position_gain
            kp *= RAISE
        if not last:
            raise UndecidedError(f"a step overshoots with Kp = {KP_FIRST} already: is the encoder's direction right?")
        return replace(damped, position_gain=last)

    def _raise_ki(self, stiff: Gains) -> Gains:
        """Step 3; no integral term where nothing is left of a step."""
        steps = self._steps(stiff, LONG_MS)
        if max(one.steady_error for one in steps) <= COUNTS:
            self._note("Ki", stiff, _words(steps), True)
            return stiff
        ki, best = float(KI_FIRST), stiff
        error = max(one.steady_error for one in steps)
        while ki <= KI_MOST:
            gains = replace(stiff, integral_gain=round(ki), integration_limit=IL_FIRST)
            steps = self._steps(gains, LONG_MS)
            left = max(one.steady_error for one in steps)
            calm = all(one.whole for one in steps) and max(one.overshoot for one in steps) <= max(
                OVERSHOOT_KI * self.step, 2 * COUNTS
            )
            self._note("Ki", gains, _words(steps), calm and left <= COUNTS)
            if not calm:
                break
            if left < error:
                best, error = gains, left
            if left <= COUNTS:
                break
            ki *= RAISE_KI
        if error > COUNTS:
            self._notes.append(f"{error:.1f} counts of a step stay; more integral gain makes it overshoot")
        return best

    def _lower_il(self, found: Gains) -> Gains:
        """Step 4."""
        if not found.integral_gain:
            return found
        allowed = max(*(one.steady_error for one in self._steps(found, LONG_MS)), COUNTS)
        least, limit = IL_FIRST, IL_FIRST // 2
        while limit >= IL_LEAST:
            gains = replace(found, integration_limit=limit)
            steps = self._steps(gains, LONG_MS)
            good = all(one.whole for one in steps) and max(one.steady_error for one in steps) <= allowed
            self._note("IL", gains, _words(steps), good)
            if not good:
                break
            least, limit = limit, limit // 2
        return replace(found, integration_limit=min(round(IL_SPARE * least), IL_FIRST))

    # --- trials ----------------------------------------------------------------------------------------------------

    def _steps(self, gains: Gains, watch_ms: int = STEP_MS) -> tuple[Response, Response]:
        """The answers to a step forward and to one back."""
        return self.bench.step(gains, self.step, watch_ms), self.bench.step(gains, -self.step, watch_ms)

    def _note(self, stage: str, gains: Gains, words: str, good: bool) -> None:
        attempt = Attempt(stage, gains, words, good)
        self._attempts.append(attempt)
        self._tell(attempt)


def _words(steps: tuple[Response, Response]) -> str:
    if not all(one.whole for one in steps):
        return "it leaves its room"
    beyond = max(one.overshoot for one in steps)
    left = max(one.steady_error for one in steps)
    rise = max(one.rise_ms for one in steps)
    return f"overshoot {beyond:.0f}, left {left:.1f} counts, {rise:.1f} ms to nine tenths"
