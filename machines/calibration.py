"""Measures a module's crystal against the clock of this computer.

A PIC-STEP makes equally spaced steps on a long slow run; a PIC-SERVO ends a servo tick with every answer, at rest too.
Either is a row of events k = 0, 1, 2 ... at ``first + k * period``, each of which is seen in a window that is certain
(``staircase.py``), whatever the host has added. So the period is certainly between

    max over i < j of (first_ns[j] - last_ns[i]) / (j - i)
    min over i < j of (last_ns[j] - first_ns[i]) / (j - i)

and nothing is assumed about how host and adapter delay things. If the two cross, the events are not equally spaced: the
module was disturbed, or this host cannot tell its ticks apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from machines.commission import Asker, UndecidedError
from machines.staircase import Sighting, Window, received
from nmc.budget import BusTiming
from nmc.chips import picstep
from nmc.chips.common import LOAD_TRAJECTORY, NOP, READ_STATUS, SERVO_TICK_NS
from nmc.picservo import PicServo
from nmc.picstep import PicStep
from nmc.program import Exchange
from nmc.servo_twin import TickClock
from planner.quantize import count_of_period, nearest_speed, period_of_count_ns

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
SPEED_MODE = 1
DENSE_NS = 1_500 * NS_PER_MS
"""So long at both ends of a run every exchange is used; in between the long lever does the work."""
SPARSE_NS = 20 * NS_PER_MS
WIRE_SLACK_NS = 2_000
"""What crystal and rounding do to the length of an answer on the wire."""
SHARP_NS = 400_000
"""An answer tells which servo tick it came from if its window is shorter than a tick by a good part."""
SHARP_LEAST = 100
GOLDEN = 0.618_033_988_75
PPM_MOST = 1_000
"""No crystal is further off than this."""

I8 = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Crystal:
    """The crystal runs ``ppm`` fast, certainly within plus or minus ``within_ppm``; from so many events."""

    ppm: float
    within_ppm: float
    events: int


@dataclass(frozen=True, slots=True)
class Row:
    """Windows of numbered events: number i8[N], ascending; first_ns, last_ns i8[N]."""

    number: I8
    first_ns: I8
    last_ns: I8


def period_bounds(row: Row) -> tuple[float, float]:
    """The least and the greatest period in ns that all windows allow; crossed if none does."""
    order = np.argsort(row.number, kind="stable")
    number, first, last = row.number[order], row.first_ns[order], row.last_ns[order]
    least, most = 0.0, float("inf")
    for i in range(len(number) - 1):
        gap = (number[i + 1 :] - number[i]).astype(np.float64)
        apart = gap > 0
        if apart.any():
            least = max(least, float(((first[i + 1 :] - last[i])[apart] / gap[apart]).max()))
            most = min(most, float(((last[i + 1 :] - first[i])[apart] / gap[apart]).min()))
    return least, most


def crystal_of(rows: Sequence[Row], nominal_ns: float) -> Crystal:
    """The crystal that all rows agree on. Raises UndecidedError if they do not agree, or say nothing."""
    bounds = [period_bounds(row) for row in rows]
    least, most = max(low for low, _ in bounds), min(high for _, high in bounds)
    if least > most:
        raise UndecidedError("what was seen is not evenly spaced: the module was disturbed, or this host is too late")
    slow_ppm, fast_ppm = (nominal_ns / most - 1) * 1e6, (nominal_ns / least - 1) * 1e6
    ppm, within = (slow_ppm + fast_ppm) / 2, (fast_ppm - slow_ppm) / 2
    if abs(ppm) > PPM_MOST or within > PPM_MOST:
        raise UndecidedError(f"{ppm:+.0f} ppm within {within:.0f} is not what a crystal shows")
    return Crystal(ppm, within, sum(len(row.number) for row in rows))


# --- PIC-STEP ------------------------------------------------------------------------------------------------------


def calibrate_stepper(
    chip: PicStep, timing: BusTiming, asker: Asker, steps: int, seconds: float, progress: Callable[[], None]
) -> Crystal:
    """There and back over ``steps`` (signed), each way in about ``seconds``.

    The chip must be in speed mode 1x, at rest, its amplifier on. Raises UndecidedError.
    """
    count = count_of_period(round(seconds * NS_PER_S / abs(steps)), SPEED_MODE)
    nominal_ns = period_of_count_ns(count, SPEED_MODE)
    begin = chip.position()
    rows = []
    for goal in (begin + steps, begin):
        rows.append(_stepper_row(chip, timing, asker, goal, nominal_ns))
        progress()
    return crystal_of(rows, nominal_ns)


def _stepper_row(chip: PicStep, timing: BusTiming, asker: Asker, goal: int, period_ns: int) -> Row:
    """One run at a constant rate; it ends at ``goal`` by itself."""
    chip.stop_motor("abruptly")
    begin = chip.position()
    reverse = goal < begin
    total = abs(goal - begin)
    control = picstep.LOAD_POSITION | picstep.LOAD_COUNT | picstep.LOAD_START_NOW
    control |= picstep.LOAD_REVERSE if reverse else 0
    count = count_of_period(period_ns, SPEED_MODE).to_bytes(2, "little")
    data = bytes((control,)) + goal.to_bytes(4, "little", signed=True) + count
    started = asker.exchange(
        Exchange(chip.address, LOAD_TRAJECTORY, data + bytes((nearest_speed(period_ns, SPEED_MODE),)))
    )
    ends_ns = started.sent_ns + (total + 1) * period_ns
    sightings: list[Sighting] = []
    moving = True
    while moving:
        now_ns = asker.now_ns
        dense = now_ns < started.sent_ns + DENSE_NS or now_ns > ends_ns - DENSE_NS
        send_ns = 0 if dense else now_ns + SPARSE_NS
        item = bytes([picstep.ITEM_POSITION])
        evidence = asker.exchange(Exchange(chip.address, READ_STATUS, item, reply_extra=4, send_at_ns=send_ns))
        position = int.from_bytes(evidence.extra, "little", signed=True)
        moving = bool((evidence.status or 0) & picstep.STATUS_MOVING)
        steps = begin - position if reverse else position - begin
        sightings.append(Sighting(received(timing, evidence), steps, moving))
        if asker.now_ns > ends_ns + NS_PER_S:
            raise UndecidedError("the motor still moves after the end of its run")
    if sightings[-1].steps != total:
        raise UndecidedError(f"the motor stopped after {sightings[-1].steps} of {total} steps: is it at a switch?")
    return _row_of_steps(sightings)


def _row_of_steps(sightings: Sequence[Sighting]) -> Row:
    """Every pair of neighbouring sightings holds the steps between them; the first step may not keep the distance."""
    number: list[int] = []
    first: list[int] = []
    last: list[int] = []
    for before, after in pairwise(sightings):
        for step in {before.steps + 1, after.steps}:
            if before.steps < step <= after.steps and step > 1:
                number.append(step)
                first.append(before.window.first_ns - WIRE_SLACK_NS)
                last.append(after.window.last_ns + WIRE_SLACK_NS)
    if len(number) < 2:
        raise UndecidedError("too few steps were seen")
    return Row(np.array(number), np.array(first), np.array(last))


# --- PIC-SERVO -----------------------------------------------------------------------------------------------------


def calibrate_servo(chip: PicServo, timing: BusTiming, asker: Asker, seconds: float) -> Crystal:
    """Asks the module again and again; nothing moves. Raises UndecidedError.

    Every answer begins at the end of a tick (PIC-SERVO data sheet section 4.1), the first after the command was
    complete. Which tick it was is told by a clock that follows the answers.
    """
    clock = TickClock()
    begin_ns = asker.now_ns
    end_ns = begin_ns + round(seconds * NS_PER_S)
    asked = 0
    number: list[int] = []
    windows: list[Window] = []
    while asker.now_ns < end_ns:
        now_ns = asker.now_ns
        dense = now_ns < begin_ns + DENSE_NS or now_ns > end_ns - DENSE_NS
        dither_ns = int(SERVO_TICK_NS * (asked * GOLDEN % 1.0))  # now and then just before the end of a tick
        send_ns = now_ns + dither_ns + (0 if dense else SPARSE_NS)
        evidence = asker.exchange(Exchange(chip.address, NOP, send_at_ns=send_ns))
        asked += 1
        window = received(timing, evidence)
        if window.last_ns - window.first_ns <= SHARP_NS:
            number.append(clock.observe(window.last_ns))
            windows.append(window)
    if len(number) < SHARP_LEAST:
        raise UndecidedError(f"only {len(number)} of {asked} answers came promptly enough to tell servo ticks apart")
    first = np.array([window.first_ns for window in windows]) - WIRE_SLACK_NS
    last = np.array([window.last_ns for window in windows]) + WIRE_SLACK_NS
    return crystal_of([Row(np.array(number), first, last)], SERVO_TICK_NS)
