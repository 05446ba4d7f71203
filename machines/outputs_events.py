"""Events of a trajectory as things to say at their instants: spindle, coolant, outputs.

An instant is a function, because a trajectory that is held or overridden has new times: what has not been said yet
moves with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from gcode.canon import Coolant, Dwell, Output, Spindle
from machines.outputs import Panel, panel_of
from machines.outputs_plan import switch_rest_s, wait_s
from machines.schema import MachineConfig
from machines.spindle import SpindleDrive, wanted_rpm
from machines.spindle_watch import SpindleWatch
from machines.wiring import bus_timing, nmc_buses
from nmc.budget import BusTiming
from nmc.chips import picio, picservo, picstep
from nmc.program import Exchange
from planner.types import Event, Trajectory

NS_PER_S = 1_000_000_000
NEVER = 1 << 62
SWITCH_BYTES, LOAD_BYTES = 2, 9
"""Data bytes of a command that switches pins, and of the longest that changes a speed."""
ACTS_NS = {picstep.FACTS.name: 125_000, picservo.FACTS.name: 256_000, picio.FACTS.name: 0}
"""From a command's last byte to its effect, on average: a PIC-SERVO waits for the end of its servo cycle."""
SAME_S = 1e-9


@dataclass(frozen=True, slots=True)
class Switched:
    """Something that was said. planned_ns: link time at which it should take effect; sent_ns: when it left."""

    name: str
    value: float
    planned_ns: int
    sent_ns: int
    line: int


@dataclass(frozen=True, slots=True)
class Due:
    """Something to say: what makes it, the instant at which it should act, and how long before that it must leave."""

    name: str
    value: float
    at_ns: Callable[[], int]
    lead_ns: int
    make: Callable[[], Exchange]
    line: int
    bus: int
    data_bytes: int = LOAD_BYTES
    follows: bool = False
    """It is one of many small changes of a speed."""
    in_motion: bool = False
    """It belongs to an instant of a motion and may be a little early; otherwise never: the axes have to rest."""


def _nothing(*_told: Any, **_more: Any) -> None:
    return None


@dataclass(slots=True)
class Rig:
    """All that a machine has beside its axes, as one session keeps it. ``said``: of the present run."""

    panel: Panel
    drive: SpindleDrive | None
    watch: SpindleWatch | None
    timings: Sequence[BusTiming]
    switch_rest_ns: int
    """How long the plan rests for an output that is switched while the axes stand."""
    tell: Callable[..., None] = _nothing
    """Told of what was said and of what the spindle does: ``tell(event, time_ns, **fields)``."""
    wanted: dict[str, float] = field(default_factory=dict)
    """What every pin will stand at when all that is known has been said."""
    spindle: Spindle | None = None
    """The command that holds."""
    said: list[Switched] = field(default_factory=list)

    def notify(self, event: str, time_ns: int, **fields: Any) -> None:
        """Tell whoever is told at present."""
        self.tell(event, time_ns, **fields)

    @property
    def buses(self) -> set[int]:
        """Buses on which something is said."""
        pins = [*self.panel.switches.values(), *(value.pin for value in self.panel.values.values())]
        return {pin.bus for pin in pins} | ({self.drive.bus} if self.drive is not None else set())

    @property
    def running(self) -> bool:
        """Whether the spindle has power or a coolant flows."""
        turns = self.drive is not None and self.drive.turning
        return turns or any(self.panel.levels.get(name) for name in ("flood", "mist"))

    @property
    def anything(self) -> bool:
        """Whether there is anything to drive."""
        return self.drive is not None or bool(self.panel.switches or self.panel.values)

    def lead_ns(self, bus: int, chip: str, data_bytes: int) -> int:
        """How long before its effect a command must leave, on average."""
        timing = self.timings[bus]
        return timing.command_ns(data_bytes) + timing.jitter_max_ns // 2 + ACTS_NS[chip]


def rig_of(config: MachineConfig, simulated: bool) -> Rig:
    """The rig of a machine."""
    panel = panel_of(config)
    timings = [bus_timing(config, number, simulated) for number in range(len(nmc_buses(config)))]
    drive = None
    table = config.spindle
    if table is not None:
        bus = panel.switches["spindle on"].bus if table.bus is None else list(nmc_buses(config)).index(table.bus)
        drive = SpindleDrive(table, panel, bus, timings[bus])
    rig = Rig(panel, drive, None, timings, round(switch_rest_s(config) * NS_PER_S))
    if drive is not None:
        rig.watch = SpindleWatch(drive, rig.notify)
    return rig


class Timetable:
    """The events of one trajectory, taken one after the other, and the instants at which they act.

    speaks: to which buses something can be said here; what is for others is theirs to say.
    """

    def __init__(
        self, trajectory: Trajectory, rig: Rig, start_ns: Callable[[], int], speaks: Callable[[int], bool]
    ) -> None:
        self._speaks = speaks
        self.trajectory = trajectory
        self.rig = rig
        self._start_ns = start_ns
        self._planned = tuple(trajectory.events)
        self._duration_s = trajectory.duration_s
        self._next = 0
        self._retimed: Sequence[Event] = ()
        self._times_s: dict[int, float] = {}

    @property
    def surface(self) -> Spindle | None:
        """The command whose surface speed is followed, while one is."""
        command = self.rig.spindle
        return command if command is not None and command.surface_mm_s and command.direction else None

    def instant_ns(self, time_s: float) -> int:
        """Link time of a time of the plan."""
        return NEVER if math.isinf(time_s) else self._start_ns() + round(time_s * NS_PER_S)

    @property
    def ahead(self) -> bool:
        """Whether an event is to come whose time is known."""
        return self._next < len(self._planned) and self._at_ns(self._next) < NEVER

    def take(self, until_ns: int) -> list[Due]:
        """What the events before ``until_ns`` give to say that was not taken yet."""
        found: list[Due] = []
        while self._next < len(self._planned) and self._at_ns(self._next) <= until_ns:
            found += self._dues(self._next, self._planned[self._next])
            self._next += 1
        return found

    def rest(self, now_ns: int) -> list[Due]:
        """What is left when the motion is over: everything else that the program says, now."""
        left = range(self._next, len(self._planned))
        self._next = len(self._planned)
        return [due for number in left for due in self._dues(number, self._planned[number], lambda: now_ns)]

    def _dues(self, number: int, event: Event, at_ns: Callable[[], int] | None = None) -> list[Due]:
        command = event.command
        at_ns = at_ns or partial(self._at_ns, number)
        middle_ns = partial(_later, at_ns, self.rig.switch_rest_ns // 2)
        if isinstance(command, Coolant):
            states = (("flood", command.flood), ("mist", command.mist))
            return [due for name, on in states for due in self.switch(name, float(on), middle_ns, command.line)]
        if isinstance(command, Output):
            name = f"{'analog' if command.analog else 'output'} {command.index}"
            if command.synchronised and not self._motion_follows(number):
                return []
            if not command.synchronised:
                return self.switch(name, command.value, middle_ns, command.line)
            found = self.switch(name, command.value, partial(self._motion_ns, number), command.line)
            return [replace(due, in_motion=True) for due in found]
        drive = self.rig.drive
        if isinstance(command, Spindle) and drive is not None and self._speaks(drive.bus):
            return self._spindle(command, event.time_s, at_ns)
        return []

    def switch(self, name: str, value: float, at_ns: Callable[[], int], line: int) -> list[Due]:
        """One pin, if the machine has it and it will not be there already."""
        rig, panel = self.rig, self.rig.panel
        if name in panel.values:
            pin, number = panel.values[name].pin, panel.values[name].pwm(value)
            value, make = number, partial(panel.set, name, number)
        elif name in panel.switches:
            pin, make = panel.switches[name], partial(panel.switch, name, bool(value))
        else:
            return []
        if rig.wanted.get(name, 0.0) == value or not self._speaks(pin.bus):
            return []
        rig.wanted[name] = value
        return [
            Due(name, value, at_ns, rig.lead_ns(pin.bus, pin.chip, SWITCH_BYTES), make, line, pin.bus, SWITCH_BYTES)
        ]

    def _spindle(self, command: Spindle, time_s: float, at_ns: Callable[[], int]) -> list[Due]:
        drive, watch = self.rig.drive, self.rig.watch
        assert drive is not None
        assert watch is not None
        x_mm = self.x_mm(time_s)
        rpm = wanted_rpm(drive.table, command, x_mm)
        wait_ns = round(wait_s(drive.table, self.rig.spindle, command, x_mm) * NS_PER_S)
        self.rig.spindle = command
        watch.follows = self.surface is not None
        if wait_ns == 0:
            return []  # it turns so already, or G96 brings it there
        found = self.spindle_dues(rpm, at_ns, command.line)
        watch.began(at_ns, lambda: at_ns() + wait_ns, command.line)
        return found

    def spindle_dues(self, rpm: float, at_ns: Callable[[], int], line: int) -> list[Due]:
        """What brings the spindle to ``rpm`` from ``at_ns`` on."""
        drive = self.rig.drive
        assert drive is not None
        pins = drive.table.drive == "output"
        chip = self.rig.panel.switches["spindle on"].chip if pins else picservo.FACTS.name
        data_bytes = SWITCH_BYTES if pins else LOAD_BYTES
        lead_ns = self.rig.lead_ns(drive.bus, chip, data_bytes)
        return [
            Due(
                say.name,
                say.value,
                partial(_later, at_ns, say.after_ns),
                lead_ns,
                say.make,
                line,
                drive.bus,
                data_bytes,
            )
            for say in drive.change(rpm)
        ]

    def x_mm(self, time_s: float) -> float:
        """Machine X at a time of the plan; 0 without an X axis."""
        if "X" not in self.trajectory.axes:
            return 0.0
        return float(self.trajectory.q(np.array([time_s]))[0][self.trajectory.axes.index("X")])

    def _time_s(self, number: int) -> float:
        """When an event happens; infinite while nobody knows, because a hold has taken back the times after it."""
        planned = self._planned[number]
        if not getattr(self.trajectory, "disturbed", False):
            return planned.time_s
        events = self.trajectory.events
        if events is not self._retimed:
            self._retimed = events
            self._times_s = {id(event.command): event.time_s for event in events}
        return self._times_s.get(id(planned.command), math.inf)

    def _at_ns(self, number: int) -> int:
        return self.instant_ns(self._time_s(number))

    def _motion_ns(self, number: int) -> int:
        """When the motion after a synchronised output begins."""
        return self.instant_ns(self._time_s(number) + self._rests_s(number))

    def _rests_s(self, number: int) -> float:
        """How long the dwells that follow an event last before anything moves."""
        begin_s = end_s = self._planned[number].time_s
        for event in self._planned[number + 1 :]:
            if event.time_s > end_s + SAME_S:
                break
            if isinstance(event.command, Dwell):
                end_s = max(end_s, event.time_s + event.command.seconds)
        return end_s - begin_s

    def _motion_follows(self, number: int) -> bool:
        """A synchronised output waits for a motion; behind the program's last one it never comes (as in LinuxCNC)."""
        end_s = self._planned[number].time_s + self._rests_s(number)
        return end_s < self._duration_s - SAME_S


def _later(at_ns: Callable[[], int], offset_ns: int) -> int:
    return at_ns() + offset_ns
