"""How a CY545 spaces its steps: the chip's own walk through its rate table.

The ramp spends a fixed time on each entry of the table (CY545 manual, chapter 17). A step takes the rate of the entry
that holds when it begins, and slowing down repeats the steps of speeding up in reverse order (chapter 5: the two are
symmetrical), so a move that is too short for the top rate turns round in its middle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

ENDLESS = 1 << 60  # steps

Run = tuple[int, int]
"""Table index and number of steps."""


@dataclass(frozen=True, slots=True)
class Ramp:
    """period: ticks a step by table index; entry: ticks a table entry; first, top: indices of F and R (F <= R)."""

    period: Sequence[int]
    entry: int
    first: int
    top: int


def climb(ramp: Ramp, start: int) -> list[Run]:
    """The steps from entry ``start`` until ``ramp.top`` holds."""
    runs: list[Run] = []
    at = 0
    for index in range(start, ramp.top):
        end = (index - start + 1) * ramp.entry
        if at < end:
            steps = -(-(end - at) // ramp.period[index])
            runs.append((index, steps))
            at += steps * ramp.period[index]
    return runs


def endless(ramp: Ramp, start: int) -> list[Run]:
    """Continuous mode: up to the top rate, then on for ever."""
    return [*climb(ramp, start), (ramp.top, ENDLESS)]


def journey(ramp: Ramp, start: int, steps: int) -> list[Run]:
    """``steps`` steps that begin at entry ``start`` and end at the first rate."""
    low = climb(Ramp(ramp.period, ramp.entry, ramp.first, start), ramp.first)
    rest = steps - _total(low)
    if rest <= 0:
        return _first_steps(low, steps)[::-1]
    up = climb(ramp, start)
    if 2 * _total(up) <= rest:
        cruise = [(ramp.top, rest - 2 * _total(up))] if rest > 2 * _total(up) else []
        return [*up, *cruise, *up[::-1], *low[::-1]]
    rising = _first_steps(up, rest // 2)
    middle = [(_entry_of(up, rest // 2), 1)] if rest % 2 else []
    return [*rising, *middle, *rising[::-1], *low[::-1]]


def brake(ramp: Ramp, index: int, waited: int, steps: int) -> list[Run]:
    """From entry ``index`` down to the first rate, where stepping ends; at most ``steps`` steps.

    waited: ticks from the moment at which INHIBIT_ABORT fell to the next step.
    """
    runs: list[Run] = []
    at = waited
    while steps > 0:
        present = index - at // ramp.entry
        if present <= ramp.first:
            break
        end = (index - present + 1) * ramp.entry
        count = min(-(-(end - at) // ramp.period[present]), steps)
        runs.append((present, count))
        at += count * ramp.period[present]
        steps -= count
    return runs


def _total(runs: Sequence[Run]) -> int:
    return sum(count for _, count in runs)


def _first_steps(runs: Sequence[Run], steps: int) -> list[Run]:
    out: list[Run] = []
    for index, count in runs:
        if steps <= 0:
            break
        out.append((index, min(count, steps)))
        steps -= count
    return out


def _entry_of(runs: Sequence[Run], step: int) -> int:
    """Entry of step number ``step`` (from 0)."""
    for index, count in runs:
        if step < count:
            return index
        step -= count
    raise IndexError("no such step")
