"""What somebody may ask of a running machine: hold, go on, feed and rapid override, stop.

A ``Control`` is asked between two exchanges and never waits; whoever has buttons or keys fills it, from another thread
if need be, and is told how the machine stands. ``Script`` is one whose requests come at given times of the run.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, cast

FEED_PERCENT = (1.0, 200.0)
RAPID_PERCENT = (1.0, 100.0)
Kind = Literal["hold", "resume", "stop", "feed", "rapid"]


@dataclass(frozen=True, slots=True)
class Request:
    """One wish. percent: of the programmed feeds or of rapids, for these two kinds."""

    kind: Kind
    percent: float = 100.0


@dataclass(frozen=True, slots=True)
class RateStatus:
    """How a run stands. state: "running", "holding" (braking) or "held" (every axis at rest and read back).

    rest_s, rest_mm: of a hold, as announced when it was asked for: time and path until the rest. bus_percent: below
    100 the bus carries no more, and everything runs that much slower. refused: why the last request was not met.
    """

    state: Literal["running", "holding", "held"] = "running"
    feed_percent: float = 100.0
    rapid_percent: float = 100.0
    bus_percent: float = 100.0
    rest_s: float = 0.0
    rest_mm: float = 0.0
    refused: str = ""


class Control:
    """Requests for a run, taken in the order in which they came."""

    def __init__(self) -> None:
        self.status = RateStatus()
        self._waiting: deque[Request] = deque()

    def hold(self) -> None:
        """Come to rest along the path."""
        self._waiting.append(Request("hold"))

    def resume(self) -> None:
        """Go on after a hold."""
        self._waiting.append(Request("resume"))

    def stop(self) -> None:
        """Stop every motor at once; the program is over."""
        self._waiting.append(Request("stop"))

    def feed(self, percent: float) -> None:
        """Override of programmed feeds; kept within 1 to 200."""
        self._waiting.append(Request("feed", _within(percent, FEED_PERCENT)))

    def rapid(self, percent: float) -> None:
        """Override of rapids; kept within 1 to 100."""
        self._waiting.append(Request("rapid", _within(percent, RAPID_PERCENT)))

    def take(self, time_s: float) -> Request | None:
        """The next request, if there is one. time_s: since t = 0 of the plan, in time of the machine."""
        return self._waiting.popleft() if self._waiting else None

    def told(self, status: RateStatus) -> None:
        """How the run stands has changed."""
        self.status = status

    def pause(self) -> None:
        """The twin is held and its time must not race: whoever answers to a person waits here a moment."""


class Script(Control):
    """Requests at times of the run: ``Script([(0.5, "hold"), (0.8, "resume"), (1.5, "feed 50")])``.

    Raises ValueError for words that are no request, times that go back, or a hold that nobody ends.
    """

    def __init__(self, lines: Iterable[tuple[float, str]]) -> None:
        super().__init__()
        self._ahead = deque((time_s, _request(words)) for time_s, words in lines)
        times = [time_s for time_s, _ in self._ahead]
        if times != sorted(times):
            raise ValueError("the times of a script must ascend")
        kinds = [request.kind for _, request in self._ahead if request.kind in ("hold", "resume", "stop")]
        if kinds and kinds[-1] == "hold":
            raise ValueError("the script holds and never resumes or stops")

    def take(self, time_s: float) -> Request | None:
        """The next request whose time has come."""
        if self._ahead and time_s >= self._ahead[0][0]:
            return self._ahead.popleft()[1]
        return super().take(time_s)


def _request(words: str) -> Request:
    """``hold``, ``resume``, ``stop``, ``feed PERCENT``, ``rapid PERCENT``."""
    kind, _, number = words.partition(" ")
    if kind in ("hold", "resume", "stop") and not number:
        return Request(cast("Kind", kind))
    if kind not in ("feed", "rapid"):
        raise ValueError(f"{words!r} is no request; hold, resume, stop, feed PERCENT and rapid PERCENT are")
    try:
        percent = float(number.removesuffix("%"))
    except ValueError:
        raise ValueError(f"{words!r}: give a percentage, such as {kind} 50") from None
    least, most = FEED_PERCENT if kind == "feed" else RAPID_PERCENT
    if not least <= percent <= most:
        raise ValueError(f"{words!r}: {kind} override goes from {least:g} to {most:g} %")
    return Request(cast("Kind", kind), percent)


def _within(percent: float, bounds: tuple[float, float]) -> float:
    return min(max(percent, bounds[0]), bounds[1])
