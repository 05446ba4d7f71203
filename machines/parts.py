"""A trajectory cut where somebody is waited for: a tool change, a programmed stop, a spindle switched by hand.

Between two parts the axes rest on exact steps and nothing is on the bus, so a wait may last as long as it likes; the
next part is streamed as a run of its own, from the counters where the last one ended.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcode.canon import Command, Coolant, Output, Spindle, Stop, ToolChange, UserCommand
from machines.usercommands import UserCommandTable, user_request
from planner.types import F8, I4, Event, Trajectory


@dataclass(frozen=True, eq=False)
class Part:
    """The stretch [begin_s, begin_s + duration_s] of ``whole`` with a clock of its own; implements ``Trajectory``."""

    whole: Trajectory
    begin_s: float
    duration_s: float
    waits: tuple[Command, ...] = ()
    """What to wait for before this part begins."""
    own: tuple[int, int] | None = None
    """Its first event and the first one after it, by number; None: those of its time."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the planned axes."""
        return self.whole.axes

    @property
    def events(self) -> Sequence[Event]:
        """What happens inside this part."""
        end_s = self.begin_s + self.duration_s
        if self.own is None:
            inside = [event for event in self.whole.events if self.begin_s <= event.time_s < end_s]
        else:
            inside = list(self.whole.events[slice(*self.own)])
        return [Event(event.time_s - self.begin_s, event.command) for event in inside]

    @property
    def is_last(self) -> bool:
        """Whether the program ends with it."""
        return self.begin_s + self.duration_s >= self.whole.duration_s and (
            self.own is None or self.own[1] >= len(self.whole.events)
        )

    def q(self, t_s: F8) -> F8:
        """Positions f8[len(t), A]."""
        return self.whole.q(self._inner(t_s))

    def v(self, t_s: F8) -> F8:
        """Velocities f8[len(t), A]."""
        return self.whole.v(self._inner(t_s))

    def a(self, t_s: F8) -> F8:
        """Accelerations f8[len(t), A]."""
        return self.whole.a(self._inner(t_s))

    def line(self, t_s: F8) -> I4:
        """Source lines i4[len(t)]."""
        return self.whole.line(self._inner(t_s))

    def junctions_s(self) -> F8:
        """Piece ends on this part's clock, its own two ends included."""
        inner = self.whole.junctions_s() - self.begin_s
        inside = inner[(inner > 0) & (inner < self.duration_s)]
        return np.concatenate(([0.0], inside, [self.duration_s]))

    def _inner(self, t_s: F8) -> F8:
        return np.clip(np.asarray(t_s, dtype=np.float64), 0.0, self.duration_s) + self.begin_s


def waits_for_somebody(command: Command, own_spindle: bool = False) -> bool:
    """Whether a machine that has no tool changer, and unless ``own_spindle`` no spindle, needs a hand at this."""
    if isinstance(command, Spindle):
        return command.direction != 0 and not own_spindle
    return isinstance(command, ToolChange | Stop | UserCommand)


def parts_of(trajectory: Trajectory, own_spindle: bool = False) -> Iterator[Part]:
    """The parts of a trajectory in order; without any wait it is one part, the whole.

    What the program does before a wait belongs to the part before it, even if that takes no time: a coolant that is
    switched off at the place of a tool change is off when the hand comes.
    """
    begin_s, first = 0.0, 0
    waits: list[Command] = []
    for number, event in enumerate(trajectory.events):
        if not waits_for_somebody(event.command, own_spindle):
            continue
        if event.time_s > begin_s or any(_acts(each.command, own_spindle) for each in trajectory.events[first:number]):
            yield Part(trajectory, begin_s, event.time_s - begin_s, tuple(waits), (first, number))
            begin_s, first, waits = event.time_s, number, []
        waits.append(event.command)
    if trajectory.duration_s > begin_s or waits or not begin_s:
        end = len(trajectory.events)
        yield Part(trajectory, begin_s, trajectory.duration_s - begin_s, tuple(waits), (first, end))


def _acts(command: Command, own_spindle: bool) -> bool:
    """Whether a machine may switch something at this command."""
    return isinstance(command, Coolant | Output) or (own_spindle and isinstance(command, Spindle))


def request(command: Command, user_commands: Mapping[str, UserCommandTable]) -> str:
    """What somebody is asked to do; ``user_commands``: those of the machine file."""
    if isinstance(command, UserCommand):
        return user_request(command, user_commands)
    if isinstance(command, ToolChange):
        return f"line {command.line}: put tool {command.tool} into the spindle"
    if isinstance(command, Spindle):
        way = "clockwise" if command.direction > 0 else "counter-clockwise"
        speed = f"{command.speed_rpm:g} rpm"
        if command.surface_mm_s:
            speed = f"{command.surface_mm_s * 0.06:g} m/min"
        return f"line {command.line}: start the spindle {way} at {speed}"
    return f"line {command.line}: the program has stopped"
