"""Runs of plain lines executed as columns: modal values are carried forward, arcs and offsets computed for all at once.

The block path knows G0 to G3 with axis words, I J K R, F and N, in any modes that are set before the run. It stops at
the first line that it cannot vouch for (an arc whose radii differ, a missing feed, a word that nothing uses): the
complete interpreter executes that line, and says what is wrong with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gcode.arcs import RADIUS_TOLERANCE_MM, SPIRAL_INCH, SPIRAL_MM, SPIRAL_RELATIVE
from gcode.canon import KIND_ARC, MoveBlock, Text
from gcode.columns import F8, I8, LETTERS, Flags
from gcode.emit import PLANE_AXES
from gcode.frame import LINEAR, Frame
from gcode.machine import Machine

AXES = "xyzabcuvw"
PLANE_INDEX = {170: 0, 180: 1, 190: 2}
CENTER_COLUMNS = {170: ("i", "j", "k"), 180: ("k", "i", "j"), 190: ("j", "k", "i")}
MIN_RUN = 24
"""Shorter runs are quicker line by line."""


@dataclass(slots=True)
class _Rows:
    """The lines of one run: values by letter, and what follows from the modes."""

    columns: dict[str, F8]
    count: int
    motion: npt.NDArray[np.int16]
    moves: Flags
    feed: F8
    bad: Flags


def can_run(machine: Machine) -> bool:
    """Whether the present modes allow the block path."""
    state = machine.state
    return (
        machine.compensation is None
        and machine.local is None
        and not machine.arc_forbidden
        and not state.lathe_diameter
        and state.feed_mode == 940
        and state.plane in PLANE_AXES
        and state.motion in {0, 10, 20, 30, 800}
        and machine.cycle.initial is None
        and (state.rotation_deg == 0.0 or state.plane == 170)
    )


def execute_run(
    machine: Machine,
    values: F8,
    first_line: int,
    emit: Callable[[MoveBlock], None],
    *,
    strict_arcs: bool,
    strict_rapids: bool,
) -> int:
    """Executes plain lines (columns of ``values``) as far as it can; gives the number of lines executed.

    strict_arcs: stop before an arc whose radii differ noticeably, so that it can be warned of; strict_rapids: before a
    rapid below Z0, likewise.
    """
    rows = _read(machine, values)
    good = int(np.argmax(rows.bad)) if rows.bad.any() else rows.count
    if good == 0:
        return 0
    positions = _positions(machine, rows, good)
    if strict_rapids and 2 in positions:
        low = (positions[2] < 0.0) & rows.moves[:good] & (rows.motion[:good] == 0)
        good = int(np.argmax(low)) if low.any() else good
        if good == 0:
            return 0
        positions = {axis: column[:good] for axis, column in positions.items()}
    center, turns, good = _arcs(machine, rows, positions, good, strict_arcs)
    if good == 0:
        return 0
    selected = np.flatnonzero(rows.moves[:good])
    block = _block(machine, rows, positions, center, turns, selected, first_line, good)
    state = machine.state
    for axis, column in positions.items():
        state.position[axis] = float(column[good - 1])
    coded = rows.columns.get("g")
    if coded is not None and not np.isnan(coded[:good]).all():
        state.motion = int(rows.motion[good - 1])
    state.feed = float(rows.feed[good - 1])
    if len(block) or block.notes:
        emit(block)
    return good


def _forward(column: F8, start: float) -> F8:
    """Each value held until the next one; ``start`` before the first."""
    given = np.flatnonzero(~np.isnan(column))
    if len(given) == len(column):
        return column
    values, lengths = np.empty(len(given) + 1), np.empty(len(given) + 1, np.int64)
    values[0], values[1:] = start, column[given]
    edges = np.append(given, len(column))
    lengths[0], lengths[1:] = edges[0], np.diff(edges)
    return np.repeat(values, lengths)


def _read(machine: Machine, values: F8) -> _Rows:
    count = values.shape[1]
    present = ~np.isnan(values)
    columns = {letter: values[i] for i, letter in enumerate(LETTERS) if present[i].any() and letter != "n"}
    has = {letter: present[LETTERS.index(letter)] for letter in columns}
    none = np.zeros(count, np.bool_)
    state = machine.state
    coded = has.get("g", none)
    bad = none.copy()
    if "g" in columns:
        code = columns["g"]
        bad |= coded & ~((code == 0.0) | (code == 1.0) | (code == 2.0) | (code == 3.0))
        motion = (_forward(np.where(bad, np.nan, code) * 10.0, float(state.motion))).astype(np.int16)
    else:
        motion = np.full(count, state.motion, np.int16)
    axes = _any(has, AXES, none)
    centers = _any(has, "ijk", none)
    radius = has.get("r", none)
    round_ = (motion == 20) | (motion == 30)
    moves = axes | coded | (centers & round_)
    feed = _forward(columns["f"], state.feed) if "f" in columns else np.full(count, state.feed)
    if "f" in columns:
        bad |= columns["f"] < 0.0
    bad |= moves & (motion > 0) & (feed == 0.0)
    bad |= moves & (motion == 800)
    bad |= (centers | radius) & ~round_
    bad |= moves & round_ & (centers == radius)
    bad |= (centers | radius) & ~moves
    _check_arc_words(machine, has, moves & round_, bad, none)
    for letter in columns:
        if letter in AXES and letter.upper() not in machine.setup.axes:
            bad |= has[letter]
    return _Rows(columns, count, motion, moves, feed, bad)


def _any(has: dict[str, Flags], letters: str, none: Flags) -> Flags:
    found = none
    for letter in letters:
        if letter in has:
            found = found | has[letter]
    return found


def _check_arc_words(machine: Machine, has: dict[str, Flags], arcs: Flags, bad: Flags, none: Flags) -> None:
    """Centre words must suit the plane; R needs an end in the plane; absolute centres need both words."""
    state = machine.state
    first, second, _ = PLANE_AXES[state.plane]
    one, two, wrong = CENTER_COLUMNS[state.plane]
    bad |= arcs & has.get(wrong, none)
    ends = has.get(AXES[first], none) | has.get(AXES[second], none)
    bad |= arcs & has.get("r", none) & ~ends
    if state.ijk_absolute:
        bad |= arcs & ~has.get("r", none) & ~(has.get(one, none) & has.get(two, none))


def _positions(machine: Machine, rows: _Rows, good: int) -> dict[int, F8]:
    """Positions after each line in program coordinates, of the axes that the run names."""
    state = machine.state
    positions: dict[int, F8] = {}
    for axis, letter in enumerate(AXES):
        column = rows.columns.get(letter)
        if column is None:
            continue
        column = column[:good]
        if state.incremental:
            steps = np.concatenate(([state.position[axis]], np.where(np.isnan(column), 0.0, column)))
            positions[axis] = np.cumsum(steps)[1:]
        else:
            positions[axis] = _forward(column, state.position[axis])
    return positions


def _arcs(
    machine: Machine, rows: _Rows, positions: dict[int, F8], good: int, strict: bool
) -> tuple[tuple[F8, F8], npt.NDArray[np.int32], int]:
    """Centres (program coordinates) and turns by line, and the number of lines up to the first doubtful arc."""
    state = machine.state
    motion = rows.motion[:good]
    arcs = np.flatnonzero(rows.moves[:good] & (motion >= 20))
    turns = np.zeros(good, np.int32)
    a, b = np.zeros(good), np.zeros(good)
    if len(arcs) == 0:
        return (a, b), turns, good
    first, second, _ = PLANE_AXES[state.plane]
    start, stop = [], []
    for axis in (first, second):
        column = positions.get(axis)
        if column is None:
            column = np.full(good, state.position[axis])
        stop.append(column[arcs])
        start.append(np.where(arcs > 0, column[arcs - 1], state.position[axis]))
    one, two, _ = CENTER_COLUMNS[state.plane]
    zero = np.zeros(len(arcs))
    i = _or_zero(rows.columns[one][:good][arcs]) if one in rows.columns else zero
    j = _or_zero(rows.columns[two][:good][arcs]) if two in rows.columns else zero
    ca, cb = (i, j) if state.ijk_absolute else (start[0] + i, start[1] + j)
    radius = rows.columns["r"][:good][arcs] if "r" in rows.columns else np.full(len(arcs), np.nan)
    by_radius = ~np.isnan(radius)
    doubtful = ~by_radius & _doubtful(machine, start, stop, (ca, cb), strict)
    if by_radius.any():
        ra, rb, wrong = _radius_centers(machine, start, stop, radius, motion[arcs] == 20)
        ca, cb = np.where(by_radius, ra, ca), np.where(by_radius, rb, cb)
        doubtful |= by_radius & wrong
    a[arcs], b[arcs] = ca, cb
    turns[arcs] = np.where(motion[arcs] == 20, -1, 1)
    if doubtful.any():
        good = int(arcs[np.argmax(doubtful)])
    return (a, b), turns, good


def _or_zero(column: F8) -> F8:
    """Missing values are zero."""
    return np.where(np.isnan(column), 0.0, column)


def _doubtful(machine: Machine, start: list[F8], stop: list[F8], center: tuple[F8, F8], strict: bool) -> Flags:
    unit = machine.state.unit_mm
    r1 = np.hypot(center[0] - start[0], center[1] - start[1])
    r2 = np.hypot(center[0] - stop[0], center[1] - stop[1])
    error = np.abs(r1 - r2)
    allowed = SPIRAL_MM if unit == 1.0 else SPIRAL_INCH
    if strict:
        allowed *= 0.25
    tiny = RADIUS_TOLERANCE_MM / unit
    limit = np.minimum(np.maximum(allowed, SPIRAL_RELATIVE * np.maximum(r1, r2)), 100.0 * allowed)
    if strict:
        limit = np.full(len(r1), allowed)
    doubtful: Flags = (error > limit * (1.0 - 1e-9)) | (r1 < tiny) | (r2 < tiny)
    return doubtful


def _radius_centers(
    machine: Machine, start: list[F8], stop: list[F8], radius: F8, clockwise: Flags
) -> tuple[F8, F8, Flags]:
    """Centres of R arcs, and which of them are doubtful: closed, too small, or zero."""
    da, db = stop[0] - start[0], stop[1] - start[1]
    half = np.hypot(da, db) / 2.0
    size = np.abs(np.nan_to_num(radius, nan=1.0))
    tiny = RADIUS_TOLERANCE_MM / machine.state.unit_mm
    wrong = (half == 0.0) | (half - size > tiny * (1.0 - 1e-9)) | (size == 0.0)
    safe = np.where(wrong, 1.0, size)
    ratio = np.where(wrong, 0.0, half / safe)
    ratio = np.where(ratio > 1.0 - 1e-12, 1.0, ratio)
    theta = np.arctan2(db, da) + np.where(clockwise == (radius < 0.0), np.pi / 2.0, -np.pi / 2.0)
    offset = safe * np.cos(np.arcsin(ratio))
    ca = (start[0] + stop[0]) / 2.0 + offset * np.cos(theta)
    cb = (start[1] + stop[1]) / 2.0 + offset * np.sin(theta)
    return ca, cb, wrong


def _block(
    machine: Machine,
    rows: _Rows,
    positions: dict[int, F8],
    center: tuple[F8, F8],
    turns: npt.NDArray[np.int32],
    selected: I8,
    first_line: int,
    good: int,
) -> MoveBlock:
    """The rows of the run in machine coordinates."""
    state, frame = machine.state, machine.emit.frame
    used = sorted({0, 1, 2} | positions.keys())
    motion = rows.motion[selected]
    every = len(selected) == good
    program = [
        np.full(len(selected), state.position[axis])
        if axis not in positions
        else positions[axis][:good]
        if every
        else positions[axis][selected]
        for axis in used
    ]
    end = _to_machine(frame, used, program)
    feed = rows.feed[selected] * state.unit_mm / 60.0
    if any(axis in {3, 4, 5} for axis in used) and state.unit_mm != 1.0:
        feed = _rotary_feed(machine, used, end, rows.feed[selected], feed)
    feed = np.where(motion == 0, 0.0, feed)
    centers = np.zeros((len(selected), 2))
    round_ = motion >= 20
    if round_.any():
        centers[round_] = _centers(frame, state.plane, used, program, center, selected, round_)
    kind = np.minimum(motion // 10, KIND_ARC).astype(np.uint8)
    plane = np.full(len(selected), PLANE_INDEX[state.plane], np.uint8)
    lines = (selected + first_line).astype(np.int32)
    if len(selected):
        _stand_at(machine, used, end[-1])
    names = "".join(AXES[axis] for axis in used).upper()
    notes = _feed_notes(rows, selected, first_line, good)
    return MoveBlock(names, kind, lines, end, feed, plane, centers, turns[selected], notes)


def _feed_notes(rows: _Rows, selected: I8, first_line: int, good: int) -> tuple[tuple[int, Text], ...]:
    column = rows.columns.get("f")
    if column is None:
        return ()
    lines = np.flatnonzero(~np.isnan(column[:good]))
    before = np.searchsorted(selected, lines)
    return tuple(
        (int(row), Text(int(line) + first_line, f"SET_FEED_RATE({value:.4f})"))
        for row, line, value in zip(before, lines, column[lines], strict=True)
    )


def _to_machine(frame: Frame, used: list[int], program: list[F8]) -> F8:
    """Program columns to machine columns, with the very operations of ``Frame.to_machine``."""
    shifted = [column + frame.shift[axis] for axis, column in zip(used, program, strict=True)]
    if frame.rotation_deg:
        angle = frame.rotation_deg * math.pi / 180.0
        cosine, sine = math.cos(angle), math.sin(angle)
        x, y = shifted[0], shifted[1]
        shifted[0], shifted[1] = x * cosine - y * sine, x * sine + y * cosine
    end = np.empty((len(program[0]), len(used)))
    for column, axis in enumerate(used):
        value = shifted[column]
        value += frame.origin[axis]
        value += frame.tool[axis]
        if axis in LINEAR:
            value *= frame.unit_mm
        end[:, column] = value
    return end


def _centers(
    frame: Frame, plane: int, used: list[int], program: list[F8], center: tuple[F8, F8], selected: I8, round_: Flags
) -> F8:
    """Arc centres in machine coordinates: points of the plane, transformed like positions."""
    first, second, _ = PLANE_AXES[plane]
    chosen = selected[round_]
    points = [column[round_] for column in program]
    points[used.index(first)] = center[0][chosen]
    points[used.index(second)] = center[1][chosen]
    at = _to_machine(frame, used, points)
    return at[:, [used.index(first), used.index(second)]]


def _rotary_feed(machine: Machine, used: list[int], end: F8, degrees: F8, feed: F8) -> F8:
    """Moves of rotary axes alone have their feed in degrees per minute, whatever the length unit."""
    before = np.vstack([[machine.emit.last[axis] for axis in used], end[:-1]]) if len(end) else end
    change = end != before
    linear = [column for column, axis in enumerate(used) if axis in LINEAR]
    rotary = [column for column, axis in enumerate(used) if axis not in LINEAR]
    alone = ~change[:, linear].any(axis=1) & change[:, rotary].any(axis=1)
    return np.where(alone, degrees / 60.0, feed)


def rows_block(machine: Machine, axes: list[int], table: F8, notes: tuple[tuple[int, Text], ...]) -> MoveBlock:
    """Straight moves as a block. table: f8[N, 2 + axes + 1]: motion code, line, program coordinates, feed."""
    state, frame = machine.state, machine.emit.frame
    program = [table[:, 2 + column] for column in range(len(axes))]
    end = _to_machine(frame, axes, program)
    motion, feed = table[:, 0], table[:, -1]
    rate = feed * state.unit_mm / 60.0
    if any(axis in {3, 4, 5} for axis in axes) and state.unit_mm != 1.0 and len(end):
        rate = _rotary_feed(machine, axes, end, feed, rate)
    count = len(table)
    if count:
        _stand_at(machine, axes, end[-1])
    return MoveBlock(
        "".join(AXES[axis] for axis in axes).upper(),
        (motion >= 10.0).astype(np.uint8),
        table[:, 1].astype(np.int32),
        end,
        np.where(motion == 0.0, 0.0, rate),
        np.full(count, PLANE_INDEX[state.plane], np.uint8),
        np.zeros((count, 2)),
        np.zeros(count, np.int32),
        notes,
    )


def _stand_at(machine: Machine, axes: list[int], end: F8) -> None:
    last = list(machine.emit.last)
    for column, axis in enumerate(axes):
        last[axis] = float(end[column])
    x, y, z, a, b, c, u, v, w = last
    machine.emit.last = (x, y, z, a, b, c, u, v, w)
