"""What came out: step runs, servo samples and bus bytes, as arrays in a file that other tools may read.

A run of steps is (first, period, count, direction): pulse k of it rises at ``first + k * period``. Never single pulses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sim.clock import ChipClock
from sim.spool import LIMIT, Spool
from sim.violations import OutputChange

IntArray = npt.NDArray[Any]

_FIELDS = {
    "run_axis": "u1",
    "run_first_ns": "i8",
    "run_period_ns": "f8",
    "run_count": "i4",
    "run_dir": "i1",
    "start_steps": "i8",
    "steps_per_unit": "f8",
    "servo_axis": "u1",
    "servo_ns": "i8",
    "servo_command": "i4",
    "servo_position": "i4",
    "counts_per_unit": "f8",
    "bus_ns": "i8",
    "bus_line": "u1",
    "bus_byte": "u1",
}
_SLIPS = {"slip_axis": "u1", "slip_ns": "i8", "slip_steps": "i4"}
"""Where mechanics and pulses part; in no file before there were any."""
_FRACTIONS = {"servo_fraction": "u2"}
"""Of the command, beyond whole counts; in no file before PIC-SERVOs were judged by it."""
_SERVO = ("servo_ns", "servo_command", "servo_position", *_FRACTIONS)
_PINS = {"pin_index": "u1", "pin_ns": "i8", "pin_value": "i4"}
"""Changes of output pins; in no file where none has changed."""


class StepRuns:
    """The pulses of one motor, grown pulse train by pulse train. Times in ticks of the chip's clock."""

    def __init__(self, clock: ChipClock) -> None:
        self.clock = clock
        self._columns = [Spool("q"), Spool("q"), Spool("q"), Spool("b")]
        self._first, self._period, self._count, self._direction = (c.tail for c in self._columns)
        self._next_tick = -1  # where the next pulse of the last run would be

    def add(self, first: int, period: int, count: int, direction: int) -> None:
        """Append ``count`` pulses from tick ``first`` on, ``period`` ticks apart; joins the last run if it fits."""
        if first == self._next_tick and direction == self._direction[-1]:
            if period == self._period[-1]:
                self._count[-1] += count
                self._next_tick += count * period
                return
            # the pulse that ends the old period still belongs to the old run
            self._count[-1] += 1
            first += period
            count -= 1
            if count == 0:
                self._next_tick = -1
                return
        self._first.append(first)
        self._period.append(period)
        self._count.append(count)
        self._direction.append(direction)
        self._next_tick = first + count * period
        if len(self._first) >= LIMIT:
            for column in self._columns:
                column.settle()

    def __len__(self) -> int:
        return len(self._columns[0])

    def read(self) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """First tick, period in ticks, count and direction of every run."""
        first, period, count, direction = (c.read() for c in self._columns)
        return first, period, count, direction


class ServoSamples:
    """Command and position of one servo at its ticks, in counts."""

    def __init__(self) -> None:
        self._columns = [Spool("q"), Spool("i"), Spool("i"), Spool("H")]

    def add(self, ns: IntArray, command: npt.NDArray[np.int64], position: npt.NDArray[np.int32]) -> None:
        """Append samples: times in ns, command in counts x 65536 (48.16), position in counts."""
        whole, fraction = (command >> 16).astype(np.int32), (command & 0xFFFF).astype(np.uint16)
        samples: tuple[npt.NDArray[Any], ...] = (ns, whole, position, fraction)
        for column, data in zip(self._columns, samples, strict=True):
            column.tail.frombytes(data.tobytes())
            column.settle()

    def __len__(self) -> int:
        return len(self._columns[0])

    def read(self) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Times in ns, commands and positions in whole counts, what the commands are above (counts x 65536)."""
        ns, command, position, fraction = (c.read() for c in self._columns)
        return ns, command, position, fraction


class BusLog:
    """Every byte of one bus at the moment its stop bit ends. The last thousand and more are always in memory."""

    def __init__(self) -> None:
        self._columns = [Spool("q"), Spool("B"), Spool("q"), Spool("B")]
        self.host_ns, self.host_byte, self.status_ns, self.status_byte = (c.tail for c in self._columns)

    def host(self, times_ns: Sequence[int], values: Sequence[int]) -> None:
        """Bytes have reached the modules."""
        self.host_ns.extend(times_ns)
        if isinstance(values, bytes):
            self.host_byte.frombytes(values)
        else:
            self.host_byte.extend(values)
        if len(self.host_ns) >= LIMIT:
            self._columns[0].settle()
            self._columns[1].settle()

    def status(self, time_ns: int, value: int) -> None:
        """A byte has reached the host."""
        self.status_ns.append(time_ns)
        self.status_byte.append(value)
        if len(self.status_ns) >= LIMIT:
            self._columns[2].settle()
            self._columns[3].settle()

    def read(self) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Times and values of the host's bytes, times and values of the modules' bytes."""
        host_ns, host_byte, status_ns, status_byte = (c.read() for c in self._columns)
        return host_ns, host_byte, status_ns, status_byte


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """All arrays of a ``trace.npz``; R runs, A motors, S servo samples, B bus bytes.

    axes: names of the motors. run_axis u1[R], run_first_ns i8[R], run_period_ns f8[R], run_count i4[R], run_dir i1[R]
    (+1 or -1), start_steps i8[A], steps_per_unit f8[A]; servo_axis u1[S], servo_ns i8[S], servo_command i4[S],
    servo_position i4[S], counts_per_unit f8[A]; bus_ns i8[B], bus_line u1[B] (2 * bus + 0 host, 1 status),
    bus_byte u1[B]; plan_start_ns: trace time at which the plan has its time 0. slip_axis u1[K], slip_ns i8[K],
    slip_steps i4[K]: steps (signed) by which a motor slipped, which its pulses do not show. pin_names: output pins as
    ``module.pin``; pin_index u1[P], pin_ns i8[P], pin_value i4[P]: their changes, level 0 or 1, or PWM -255 to 255.
    servo_fraction u2[S]: what the command is above whole counts (counts x 65536), empty if the trace does not know it.
    """

    axes: tuple[str, ...]
    run_axis: npt.NDArray[np.uint8]
    run_first_ns: npt.NDArray[np.int64]
    run_period_ns: npt.NDArray[np.float64]
    run_count: npt.NDArray[np.int32]
    run_dir: npt.NDArray[np.int8]
    start_steps: npt.NDArray[np.int64]
    steps_per_unit: npt.NDArray[np.float64]
    servo_axis: npt.NDArray[np.uint8]
    servo_ns: npt.NDArray[np.int64]
    servo_command: npt.NDArray[np.int32]
    servo_position: npt.NDArray[np.int32]
    counts_per_unit: npt.NDArray[np.float64]
    bus_ns: npt.NDArray[np.int64]
    bus_line: npt.NDArray[np.uint8]
    bus_byte: npt.NDArray[np.uint8]
    plan_start_ns: int = 0
    servo_fraction: npt.NDArray[np.uint16] = field(default_factory=lambda: np.zeros(0, np.uint16))
    slip_axis: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    slip_ns: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    slip_steps: npt.NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))
    pin_names: tuple[str, ...] = ()
    pin_index: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    pin_ns: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    pin_value: npt.NDArray[np.int32] = field(default_factory=lambda: np.zeros(0, np.int32))

    @property
    def commanded(self) -> npt.NDArray[np.int32] | npt.NDArray[np.float64]:
        """Command of the servo samples in counts, [S]: f8 to the last bit, or whole counts if no more is known."""
        if len(self.servo_fraction) < len(self.servo_command):
            return self.servo_command
        exact: npt.NDArray[np.float64] = self.servo_command + self.servo_fraction / 65536.0
        return exact

    def save(
        self,
        path: str | Path,
        steps_per_unit: Mapping[str, float] | None = None,
        plan_start_ns: int | None = None,
        counts_per_unit: Mapping[str, float] | None = None,
    ) -> Trace:
        """Write the arrays to ``path`` with the given scales (by motor name); returns what was written."""
        steps = dict(steps_per_unit or {})
        counts = dict(counts_per_unit or {})
        full = replace(
            self,
            steps_per_unit=np.array(
                [steps.get(a, s) for a, s in zip(self.axes, self.steps_per_unit, strict=True)], "f8"
            ),
            counts_per_unit=np.array(
                [counts.get(a, s) for a, s in zip(self.axes, self.counts_per_unit, strict=True)], "f8"
            ),
            plan_start_ns=self.plan_start_ns if plan_start_ns is None else plan_start_ns,
        )
        rare = (
            *(_SLIPS if len(full.slip_ns) else ()),
            *(_FRACTIONS if len(full.servo_fraction) else ()),
            *(_PINS if len(full.pin_ns) else ()),
        )
        arrays = {name: getattr(full, name) for name in (*_FIELDS, *rare)}
        if len(full.pin_ns):
            arrays["pin_names"] = np.array(full.pin_names, dtype=np.str_)
        with Path(path).open("wb") as file:  # numpy itself would add an ending to the name
            np.savez(
                file,
                allow_pickle=False,
                axes=np.array(full.axes, dtype=np.str_),
                plan_start_ns=np.int64(full.plan_start_ns),
                **arrays,
            )
        return full

    def pulses_ns(self, axis: str) -> npt.NDArray[np.float64]:
        """Times in ns of all pulses of one motor, in order; made on demand."""
        mine = self.run_axis == self.axes.index(axis)
        first, period, count = self.run_first_ns[mine], self.run_period_ns[mine], self.run_count[mine]
        start = np.repeat(np.cumsum(count) - count, count)
        index = np.arange(int(count.sum())) - start
        pulses: npt.NDArray[np.float64] = np.repeat(first.astype("f8"), count) + index * np.repeat(period, count)
        return pulses


def load(path: str | Path) -> Trace:
    """Read a ``trace.npz``. Raises OSError or KeyError if it is not one."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {
            name: file[name] for name in (*_FIELDS, *_SLIPS, *_FRACTIONS, *_PINS) if name in _FIELDS or name in file
        }
        return Trace(
            axes=tuple(str(a) for a in file["axes"]),
            plan_start_ns=int(file["plan_start_ns"]),
            pin_names=tuple(str(name) for name in file["pin_names"]) if "pin_names" in file else (),
            **arrays,
        )


def _column(parts: Sequence[npt.NDArray[np.generic]], dtype: str) -> npt.NDArray[np.generic]:
    return np.concatenate([np.asarray(p, dtype) for p in parts]) if parts else np.zeros(0, dtype)


def collect(
    axes: Sequence[str],
    runs: Mapping[str, StepRuns],
    servos: Mapping[str, ServoSamples],
    buses: Sequence[BusLog],
    slips: Mapping[str, Sequence[tuple[int, int]]] | None = None,
) -> Trace:
    """Put the columns of all motors and buses together, each in order of time. slips: (time in ns, steps) by motor."""
    step: dict[str, list[npt.NDArray[np.generic]]] = {k: [] for k in (*_FIELDS, *_FRACTIONS)}
    for number, name in enumerate(axes):
        if name in runs:
            _add_runs(step, number, runs[name])
        if name in servos:
            step["servo_axis"].append(np.full(len(servos[name]), number, "u1"))
            for field, values in zip(_SERVO, servos[name].read(), strict=True):
                step[field].append(values)
    for number, log in enumerate(buses):
        host_ns, host_byte, status_ns, status_byte = log.read()
        for line, (ns, value) in enumerate([(host_ns, host_byte), (status_ns, status_byte)]):
            step["bus_ns"].append(ns)
            step["bus_line"].append(np.full(len(ns), 2 * number + line, "u1"))
            step["bus_byte"].append(value)
    columns = {k: _column(v, {**_FIELDS, **_FRACTIONS}[k]) for k, v in step.items()}
    for group, key in (("run_", "run_first_ns"), ("servo_", "servo_ns"), ("bus_", "bus_ns")):
        order = np.argsort(columns[key], kind="stable")
        for name in columns:
            if name.startswith(group):
                columns[name] = columns[name][order]
    for name in ("start_steps", "steps_per_unit", "counts_per_unit"):
        columns[name] = np.zeros(len(axes), _FIELDS[name])
    slipped = [(ns, axes.index(name), steps) for name, mine in (slips or {}).items() for ns, steps in mine]
    for place, name in enumerate(("slip_ns", "slip_axis", "slip_steps")):
        columns[name] = np.array([row[place] for row in sorted(slipped)], _SLIPS[name])
    return Trace(axes=tuple(axes), **columns)  # type: ignore[arg-type]  # one dict holds columns of several types


def _add_runs(step: dict[str, list[npt.NDArray[np.generic]]], number: int, runs: StepRuns) -> None:
    clock = runs.clock
    first, period, count, direction = runs.read()
    step["run_axis"].append(np.full(len(runs), number, "u1"))
    step["run_first_ns"].append(np.array([clock.ns_of(t) for t in first.tolist()], "i8"))
    step["run_period_ns"].append(period * clock.span_ns(1))
    step["run_count"].append(count)
    step["run_dir"].append(direction)


def with_pins(trace: Trace, changes: Sequence[OutputChange]) -> Trace:
    """The trace with the changes of output pins, in order of time."""
    names = sorted({f"{change.module}.{change.pin}" for change in changes})
    ordered = sorted(changes, key=lambda change: change.time_ns)
    return replace(
        trace,
        pin_names=tuple(names),
        pin_index=np.array([names.index(f"{change.module}.{change.pin}") for change in ordered], np.uint8),
        pin_ns=np.array([change.time_ns for change in ordered], np.int64),
        pin_value=np.array([change.value for change in ordered], np.int32),
    )
