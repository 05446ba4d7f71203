"""Host twins of a PIC-STEP's step timer in unprofiled position mode.

The chip (data sheet, section 4.1): a timer rolls over, a step comes out, the timer is reloaded with the initial timer
count. A count that is loaded while the axis runs acts at the next roll-over (the old period finishes); from rest the
first step comes one period after the start; the axis stands on the step that reaches the stop position.

    start e      r        r+P      r+2P          load executes between two roll-overs:
      |-----P----|----P----|----P----|             the running period is finished, then P' holds

``StepTimer`` is one possible chip. ``StepTimerTwin`` holds three: the nominal one, which follows the mean of what is
believed (``nmc.belief``), and the fastest and slowest ones that agree with everything the host knows (execution
windows, crystal error), so that the true chip lies between them.
"""

from __future__ import annotations

from dataclasses import dataclass

from nmc.belief import Belief
from nmc.budget import Window

PPM = 1_000_000


@dataclass(slots=True)
class StepTimer:
    """One step timer: next roll-over at ``next_ns``, then every ``period_ns``; ``left`` steps until the stop."""

    next_ns: int = 0
    period_ns: int = 0
    left: int = 0

    def start(self, execute_ns: int, period_ns: int, steps: int, at_once: bool = False) -> None:
        """Begin a run of ``steps`` from rest; ``at_once``: with the first step, not with a period."""
        self.next_ns = execute_ns if at_once else execute_ns + period_ns
        self.period_ns = period_ns
        self.left = steps

    def copy(self) -> StepTimer:
        """As it is now."""
        return StepTimer(self.next_ns, self.period_ns, self.left)

    def advance(self, now_ns: int) -> int:
        """Emit every step up to and including ``now_ns``; return how many."""
        if self.next_ns > now_ns:
            return 0
        count = self.left - self.left_at(now_ns)
        self.next_ns += count * self.period_ns
        self.left -= count
        return count

    def left_at(self, now_ns: int) -> int:
        """Steps left at ``now_ns`` if nothing is loaded before."""
        if self.left <= 0 or self.next_ns > now_ns:
            return self.left
        return self.left - min(self.left, (now_ns - self.next_ns) // self.period_ns + 1)

    def ahead(self, now_ns: int) -> tuple[int, int]:
        """(next step's instant, steps left) as they will be at ``now_ns`` if nothing is loaded before."""
        left = self.left_at(now_ns)
        return self.next_ns + (self.left - left) * self.period_ns, left

    def arrival_ns(self) -> int:
        """Instant of the last step of the run (of the past one if none is left)."""
        return self.next_ns + (self.left - 1) * self.period_ns


@dataclass(slots=True)
class Latch:
    """A latch of the position that has been sent and not yet read: the twins as they were, and what came after."""

    window: Window
    timers: tuple[StepTimer, StepTimer]
    superseded: list[tuple[int, int]]
    loads: list[tuple[Window, int]]


class StepTimerTwin:
    """Nominal, fastest and slowest step timer of one axis, in host time.

    at_once: this chip was measured to make its first step when it is started, not one period later.
    """

    __slots__ = (
        "_latch", "_superseded", "at_once", "belief", "crystal_ppm", "fast", "nominal", "revision", "slow", "steps",
    )  # fmt: skip

    def __init__(self, crystal_ppm: int, at_once: bool = False) -> None:
        self.crystal_ppm = crystal_ppm
        self.at_once = at_once
        self.nominal = StepTimer()
        self.fast = StepTimer()
        self.slow = StepTimer()
        self.belief = Belief(crystal_ppm)
        self.steps = 0
        self.revision = 0
        """Another one after everything that was learnt or sent: what was reckoned before is out of date."""
        self._superseded: list[tuple[int, int]] = []
        self._latch: Latch | None = None

    def start(self, window: Window, period_ns: int, steps: int) -> None:
        """A run of ``steps`` was started from rest at an instant within the given window."""
        self.steps = steps
        self.fast.start(window.earliest_ns, self._fast_period(period_ns), steps, self.at_once)
        self.slow.start(window.latest_ns, self._slow_period(period_ns), steps, self.at_once)
        self._superseded.clear()
        self._latch = None
        self.belief.start(window, period_ns, steps, self.at_once)
        self._follow(window.middle_ns)

    def load(self, window: Window, period_ns: int) -> None:
        """A new count was executed within the given window while the axis was moving.

        Slower: the fastest chip takes it last and the slowest first, and that bounds every other chip. Faster: a chip
        between the two may meet the load one roll-over earlier or later than its bound does, so one period changes
        sides. After a step in the window the next comes no earlier than the window's begin plus the new period, and
        after a step before its end no later than its end plus the longest period that may still be running (several
        loads may fall into one long period).
        """
        if self._latch is not None:
            self._latch.loads.append((window, period_ns))
        self._load(window, period_ns)
        self.belief.load(window, period_ns)
        self._follow(window.middle_ns)

    def _load(self, window: Window, period_ns: int) -> None:
        earliest_ns, latest_ns, _ = window
        fast, slow = self.fast, self.slow
        running_ns = self._longest_running_ns(earliest_ns)
        self._superseded.append((slow.period_ns, latest_ns))
        if period_ns >= fast.period_ns:
            fast.advance(latest_ns)
            slow.advance(earliest_ns)
        else:
            race_early = fast.left_at(earliest_ns) != slow.left_at(earliest_ns)
            race_late = fast.left_at(latest_ns) != slow.left_at(latest_ns)
            fast.advance(earliest_ns)
            slow.advance(latest_ns)
            if race_early:
                fast.next_ns = min(fast.next_ns, earliest_ns + self._fast_period(period_ns))
            if race_late:
                slow.next_ns = max(slow.next_ns, latest_ns + running_ns - self._slow_period(period_ns))
        fast.period_ns = self._fast_period(period_ns)
        slow.period_ns = self._slow_period(period_ns)

    def latch(self, window: Window) -> None:
        """The position was saved within the given window (Save Current Position as Home); it will be read later."""
        timers = (self.fast.copy(), self.slow.copy())
        self.belief.latch(window)
        self._latch = Latch(window, timers, list(self._superseded), [])

    def latched(self, steps: int) -> bool:
        """The saved position was read: ``steps`` of this run had been made at the latch.

        The bounds close in on that and the loads since then are replayed. False if even the bounding twins exclude it:
        the chip does not behave as this file says. A run that began or ended since leaves nothing to compare.
        """
        latch, self._latch = self._latch, None
        if latch is None:
            return True
        fast, slow = latch.timers
        left = self.steps - steps
        earliest_ns, latest_ns, _ = latch.window
        if not fast.left_at(latest_ns) <= left <= slow.left_at(earliest_ns):
            return False
        self.fast, self.slow, self._superseded = fast, slow, latch.superseded
        running_ns = self._longest_running_ns(earliest_ns)
        for timer, period_ns in ((fast, 0), (slow, running_ns)):
            if timer.left_at(earliest_ns) < left:  # one step more than was seen: it comes after the latch
                timer.left, timer.next_ns = left, earliest_ns + 1
            elif timer.left_at(latest_ns) > left:  # one step less: it came before
                timer.left, timer.next_ns = left, latest_ns + period_ns
        for load in latch.loads:
            self._load(*load)
        self.belief.latched(left)
        self._follow(max(since.middle_ns for since in (latch.window, *(loaded for loaded, _ in latch.loads))))
        return True

    def done(self, now_ns: int) -> int:
        """Steps of this run that the nominal chip has emitted by ``now_ns``."""
        self.nominal.advance(now_ns)
        return self.steps - self.nominal.left

    def surely_moving_until_ns(self) -> int:
        """Before this instant even the fastest chip has steps to go (if no load changes that)."""
        return self.fast.arrival_ns()

    def surely_stopped_from_ns(self) -> int:
        """After this instant even the slowest chip has made its last step."""
        return self.slow.arrival_ns()

    def _longest_running_ns(self, earliest_ns: int) -> int:
        """Longest period that may be running when the next load executes.

        A period that was superseded is still running only if it began before that and is longer than the time since.
        """
        longest_ns, kept = max(self.slow.period_ns, 0), []
        for period_ns, since_ns in self._superseded:
            if period_ns > earliest_ns - since_ns:
                kept.append((period_ns, since_ns))
                longest_ns = max(longest_ns, period_ns)
        self._superseded = kept
        return longest_ns

    def _follow(self, at_ns: int) -> None:
        """The nominal timer is the mean of the possible chips."""
        self.revision += 1
        self.nominal.next_ns, self.nominal.period_ns, self.nominal.left = self.belief.mean(at_ns)

    def _fast_period(self, period_ns: int) -> int:
        return period_ns - period_ns * self.crystal_ppm // PPM - 1

    def _slow_period(self, period_ns: int) -> int:
        return period_ns + period_ns * self.crystal_ppm // PPM + 1
