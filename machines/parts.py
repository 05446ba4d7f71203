"""A trajectory cut where somebody is waited for: a tool change, a programmed stop, a spindle switched by hand.

Between two parts the axes rest on exact steps and nothing is on the bus, so a wait may last as long as it likes; the
next part is streamed as a run of its own, from the counters where the last one ended.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcode.canon import Command, Spindle, Stop, ToolChange, UserCommand
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

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the planned axes."""
        return self.whole.axes

    @property
    def events(self) -> Sequence[Event]:
        """What happens inside this part."""
        end_s = self.begin_s + self.duration_s
        inside = [event for event in self.whole.events if self.begin_s <= event.time_s < end_s]
        return [Event(event.time_s - self.begin_s, event.command) for event in inside]

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


def waits_for_somebody(command: Command) -> bool:
    """Whether a machine that has no tool changer and no spindle of its own needs a hand at this command."""
    if isinstance(command, Spindle):
        return command.direction != 0
    return isinstance(command, ToolChange | Stop | UserCommand)


def parts_of(trajectory: Trajectory) -> Iterator[Part]:
    """The parts of a trajectory in order; without any wait it is one part, the whole."""
    begin_s = 0.0
    waits: list[Command] = []
    for event in trajectory.events:
        if not waits_for_somebody(event.command):
            continue
        if event.time_s > begin_s:
            yield Part(trajectory, begin_s, event.time_s - begin_s, tuple(waits))
            begin_s, waits = event.time_s, []
        waits.append(event.command)
    if trajectory.duration_s > begin_s or waits or not begin_s:
        yield Part(trajectory, begin_s, trajectory.duration_s - begin_s, tuple(waits))


def request(command: Command, user_commands: Mapping[str, UserCommandTable]) -> str:
    """What somebody is asked to do; ``user_commands``: those of the machine file."""
    if isinstance(command, UserCommand):
        return user_request(command, user_commands)
    if isinstance(command, ToolChange):
        return f"line {command.line}: put tool {command.tool} into the spindle"
    if isinstance(command, Spindle):
        way = "clockwise" if command.direction > 0 else "counter-clockwise"
        return f"line {command.line}: start the spindle {way} at {command.speed_rpm:g} rpm"
    return f"line {command.line}: the program has stopped"
