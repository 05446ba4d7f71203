"""A trajectory that is planned while it runs: bounded memory, and rate control at any moment.

The picture: behind lies what was sent; from there to ``settled_s`` the timing is final at the present rate; beyond it
the path is read chunk by chunk when a later time is asked for. Hold, resume and override name the time up to which
motion has been sent: everything after it is timed again at once, from the present state, over the same intervals, so
the path never changes and no axis limit is broken. Slower than now: brake as hard as the axes allow until the new
caps are met. The rest of a hold is known before it happens.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gcode.canon import Command, MoveBlock
from planner import kernel, timeline
from planner.braking import hardest, where_met
from planner.easing import Stretch
from planner.errors import PlanError
from planner.jerk import FilteredTrajectory
from planner.kinematics import Kinematics
from planner.paths import cut, divide, join_intervals, resting
from planner.plan import BATCH_MOVES, Setting, setting_of
from planner.reader import switch_of
from planner.rotary_table import RotaryTable
from planner.stages import Chunk, chunks
from planner.timeline import Timeline
from planner.timing import NodeMark, Pieces, Rate, Timed, schedule
from planner.trajectory import PathTrajectory, path_trajectory
from planner.types import F8, I4, Event, Intervals, Limits, nobody_asks

SNAP_MM = 1e-9
"""a state nearer than this to a node is at the node."""


@dataclass(frozen=True, slots=True, eq=False)
class Rest:
    """Where and when a hold comes to rest: time, path length from the moment of the hold, position f8[A]."""

    time_s: float
    distance_mm: float
    q: F8


class LiveTrajectory:
    """A program in motion; implements ``planner.types.Trajectory`` and takes hold, resume and override.

    commands: read only as far as time is asked for. moves: about how many are read at once. Raises PlanError when it
    comes to a command that cannot be planned.
    """

    def __init__(self, commands: Iterable[Command | MoveBlock], setting: Setting, moves: int = BATCH_MOVES) -> None:
        self._setting = setting
        self._source: Iterator[tuple[Chunk, bool]] = chunks(commands, setting.start, setting.rules, moves)
        self._path = resting(setting.start)
        self._marks: list[NodeMark] = []
        self._scheduled = -1
        self._node, self._x = 0, 0.0
        self._ended = False
        self._line = Timeline(0.0, timeline.no_pieces())
        self._held = False
        self._pending: tuple[Pieces, list[Event]] = (timeline.no_pieces(), [])
        self._view: PathTrajectory | FilteredTrajectory | None = None
        self._fixed_before = False
        self.rate = Rate()
        self.alive: Callable[[], None] = nobody_asks  # between stages, each some 0.03 us an interval

    @classmethod
    def planned(cls, setting: Setting, path: Intervals, marks: Sequence[NodeMark], line: Timeline) -> LiveTrajectory:
        """One that has been planned to its end elsewhere: intervals, marks and timeline of a finished plan."""
        made = cls((), setting)
        made._source = iter(())
        made._path, made._marks, made._line = path, list(marks), line
        made._node = made._scheduled = len(path)
        made._ended = True
        return made

    # What is planned

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the planned axes."""
        return self._setting.limits.axes

    @property
    def settled_s(self) -> float:
        """Up to here q(t) is final unless the rate changes."""
        return self._line.end_s

    @property
    def complete(self) -> bool:
        """The program is planned to its end."""
        return self._ended and self._node == len(self._path) and self._scheduled == self._node and not self._held

    @property
    def held(self) -> bool:
        """A hold is on: the axes rest from its ``Rest.time_s`` until ``resume``."""
        return self._held

    @property
    def duration_s(self) -> float:
        """Time of the end; plans the program to it. While held: time of the rest."""
        self.extend(np.inf)
        return self._line.end_s

    @property
    def events(self) -> Sequence[Event]:
        """Events settled so far, ascending in time."""
        return self._line.events

    def extend(self, until_s: float) -> None:
        """Settle at least up to ``until_s``, or the end, or the rest of a hold."""
        while self._line.end_s < until_s and not self.complete and not self._held:
            self._extend()

    def q(self, t_s: F8) -> F8:
        """Positions f8[len(t), A], mm or degrees, machine frame."""
        return self._at(t_s).q(t_s)

    def coordinate(self, t_s: F8, column: int) -> F8:
        """Positions f8[len(t)] of one axis."""
        return self._at(t_s).coordinate(t_s, column)

    def v(self, t_s: F8) -> F8:
        """Velocities f8[len(t), A], mm/s."""
        return self._at(t_s).v(t_s)

    def a(self, t_s: F8) -> F8:
        """Accelerations f8[len(t), A], mm/s2."""
        return self._at(t_s).a(t_s)

    def line(self, t_s: F8) -> I4:
        """Source line i4[len(t)]."""
        return self._at(t_s).line(t_s)

    def junctions_s(self) -> F8:
        """Ascending times at which a settled piece begins or ends."""
        return self._at(np.zeros(1)).junctions_s()

    def forget(self, before_s: float) -> None:
        """Drop what lies before ``before_s``; earlier times read as the first position kept."""
        before_s -= self._setting.rules.tau_s
        count = int(np.searchsorted(self._line.ends(), before_s, side="left"))
        count = min(count, len(self._line.pieces) - 1)
        if count <= 0:
            return
        first = int(self._line.pieces.interval[count])
        self._line = self._line.without(count, first)
        self._fixed_before = self._switched(first)
        self._path = cut(self._path, first, len(self._path))
        self._marks = [replace(m, node=m.node - first) for m in self._marks if m.node >= first]
        self._node -= first
        self._scheduled -= first
        self._view = None

    def view(self) -> PathTrajectory | FilteredTrajectory:
        """What is settled, as a trajectory of its own that later changes leave alone."""
        return self._at(np.zeros(1))

    # Rate control

    def override(self, sent_s: float, rate: Rate) -> None:
        """Change the rate of everything after ``sent_s``. Raises PlanError outside feed 0..2, rapid 0..1."""
        if not (0.01 <= rate.feed <= 2 and min(rate.rapid, rate.bus) >= 0.01 and max(rate.rapid, rate.bus) <= 1):
            raise PlanError(0, "", f"override {rate.feed:g}, rapids {rate.rapid:g}: outside 0.01..2 and 0.01..1")
        if not self._held:
            self._rewind(sent_s)
        self.rate = rate

    def hold(self, sent_s: float) -> Rest:
        """Brake to rest from the state at ``sent_s`` as hard as the axes allow."""
        if self._held:
            return Rest(self._line.end_s, 0.0, self.q(np.array([self._line.end_s]))[0])
        rest = self._rewind(sent_s)
        travelled = 0.0
        if rest is not None:
            self._suspend(sent_s, rest)
        elif self._x > 0:
            travelled = self._brake()
        tau = self._setting.rules.tau_s
        if tau > 0 and travelled > 0:
            self._append(timeline.rest_piece(tau, *self._place()), [], 0)
        self._held, self._view = True, None
        end = self._line.end_s
        return Rest(end, travelled, self.q(np.array([end]))[0])

    def rest_if_held(self, sent_s: float) -> Rest:
        """What ``hold`` would say, without holding."""
        self.extend(sent_s)
        return copy.copy(self).hold(sent_s)

    def resume(self, sent_s: float) -> None:
        """Go on after a hold, from rest or while still braking."""
        if not self._held:
            return
        self._held, self._view = False, None
        if sent_s < self._line.end_s and not len(self._pending[0]):
            self._rewind(sent_s)
        elif sent_s > self._line.end_s:
            self._append(timeline.rest_piece(sent_s - self._line.end_s, *self._place()), [], 0)
        if len(self._pending[0]) or self._pending[1]:
            self._append(*self._pending, 0)
        self._pending = (timeline.no_pieces(), [])

    # Inside

    def _at(self, t_s: F8) -> PathTrajectory | FilteredTrajectory:
        self.extend(float(np.max(t_s, initial=0.0)))
        if self._view is None:
            limits, start = self._setting.limits, self._setting.start
            line = self._line
            self.alive()
            base = path_trajectory(limits.axes, self._path, line.pieces, line.events, start, line.origin_s)
            tau = self._setting.rules.tau_s
            self._view = FilteredTrajectory(base, tau) if tau > 0 else base
        return self._view

    def _append(self, pieces: Pieces, events: list[Event], first_interval: int) -> None:
        self.alive()
        self._line = self._line.extended(pieces, events, first_interval)
        self._view = None

    def _place(self) -> tuple[int, float]:
        """The present node as interval and offset of a rest."""
        if self._node == 0:
            return 0, 0.0
        return self._node - 1, float(self._path.length[self._node - 1])

    def _extend(self) -> None:
        """Read what the commit rule needs, solve, and settle what the future cannot change."""
        waiting = len(self._path) - self._node
        target = len(self._path) + max(waiting, 1)
        while not self._ended and len(self._path) < target:
            chunk, self._ended = next(self._source)
            self._marks += [replace(m, node=m.node + len(self._path)) for m in chunk.marks]
            self._path = join_intervals([self._path, chunk.intervals])
        if self._x > 0:
            self._divide_where_braking_ends()
        self.alive()
        p = cut(self._path, self._node, len(self._path))
        x, cap, commit, ease = self._solve(p)
        self.alive()
        marks = [replace(m, node=m.node - self._node) for m in self._marks if m.node > self._scheduled]
        marks = [m for m in marks if m.node <= commit]
        tau = self._setting.rules.tau_s
        timed = Timed(cut(p, 0, commit), x[: commit + 1], cap[:commit], marks, tau, ease)
        pieces, events = schedule(timed, self._setting.constraints)
        self._append(pieces, events, self._node)
        self._node += commit
        self._scheduled = self._node
        self._x = float(x[commit])

    def _divide_where_braking_ends(self) -> None:
        """A motion too fast for its cap brakes as hard as it can; a long line is divided where it meets the cap."""
        p, c = cut(self._path, self._node, len(self._path)), self._setting.constraints
        if not len(p):
            return
        ahead = self._stretch(p)
        cap = ahead.caps(ahead.ease(0.0))[0]
        self.alive()
        met = where_met(p, c, hardest(p, c, self._x)[0], cap)
        if met is not None and SNAP_MM < met[1] < p.length[met[0]] - SNAP_MM:
            self._divide(self._node + met[0], met[1])

    def _stretch(self, p: Intervals) -> Stretch:
        """Intervals from the present node on, at the present rate."""
        return Stretch(p, self._setting.constraints, self.rate, self._fixed(len(p)), self.alive)

    def _solve(self, p: Intervals) -> tuple[F8, F8, int, F8 | None]:
        """x at the nodes of ``p``, caps, how many intervals the future cannot change, and the ease of those."""
        n, c = len(p), self._setting.constraints
        x = np.zeros(n + 1)
        if n == 0:
            return x, np.empty(0), 0, None
        ahead = self._stretch(p)
        ease = ahead.ease(self._x)
        self.alive()
        tangents = ahead.tangents(ease)
        self.alive()
        cap, node_cap = ahead.caps(ease)
        self.alive()
        if self._x > 0:
            # too fast for the new caps: they give way to the hardest braking
            slow = hardest(p, c, self._x)[0]
            node_cap = np.where(p.stop & (np.arange(n + 1) > 0), 0.0, np.maximum(node_cap, slow))
        safe, hopeful = np.empty(n + 1), np.empty(n + 1)
        self.alive()
        kernel.backward(p.length, *tangents, c.acceleration, node_cap, 0.0, safe)
        commit = n
        if not self._ended and node_cap[n] > 0:
            kernel.backward(p.length, *tangents, c.acceleration, node_cap, node_cap[n], hopeful)
            commit = int(kernel.commit_point(safe, hopeful))
        self.alive()
        kernel.forward(p.length, *tangents, c.acceleration, safe, self._x, x)
        return x, cap, commit, None if ease is None else ease[:commit]

    def _switched(self, node: int) -> bool:
        """Whether the program forbids overrides from ``node`` on."""
        before = [m for m in self._marks if m.node <= node and switch_of(m.command) is not None]
        return not switch_of(before[-1].command) if before else self._fixed_before

    def _fixed(self, count: int) -> npt.NDArray[np.bool_] | None:
        """Which of the ``count`` intervals from the present node on nobody may override; None: all are free."""
        ahead = [m for m in self._marks if m.node > self._node and switch_of(m.command) is not None]
        fixed = np.full(count, self._switched(self._node))
        for m in ahead:
            fixed[m.node - self._node :] = not switch_of(m.command)
        return fixed if fixed.any() else None

    def _rewind(self, sent_s: float) -> int | None:
        """Undo everything after ``sent_s``: node and x become the state there. In a rest, that piece's number: the
        rest is kept to its end.
        """
        self.alive()
        self.extend(sent_s)
        line = self._line
        m = int(np.searchsorted(line.ends(), sent_s, side="right"))
        if m >= len(line.pieces):
            return None
        p, self._view = line.pieces, None
        i, speed, accel = int(p.interval[m]), float(p.speed_mm_s[m]), float(p.accel_mm_s2[m])
        if speed == 0 and accel == 0:
            last = m
            while last + 1 < len(p) and p.speed_mm_s[last + 1] == 0 and p.accel_mm_s2[last + 1] == 0:
                last += 1
            node = i if p.offset_mm[m] == 0 else i + 1
            self._back_to(node, 0.0, node)
            self._line = replace(self._line, pieces=timeline.part(p, 0, last + 1))
            return m
        tau = sent_s - (float(line.ends()[m]) - float(p.duration_s[m]))
        offset = float(p.offset_mm[m]) + (speed + accel * tau / 2) * tau
        self._back_to(i, max(speed + accel * tau, 0.0) ** 2, i)
        self._line = self._line.upto(m + 1, tau)
        self._node_at(i, offset)
        return None

    def _back_to(self, node: int, x: float, scheduled: int) -> None:
        undone = sum(scheduled < m.node <= self._scheduled for m in self._marks)
        self._line = replace(self._line, events=self._line.events[: len(self._line.events) - undone])
        self._node, self._x, self._scheduled = node, x, scheduled

    def _node_at(self, i: int, offset_mm: float) -> None:
        """Make the point of interval ``i`` at ``offset_mm`` the present node."""
        if offset_mm < SNAP_MM:
            self._node = i
        elif self._path.length[i] - offset_mm < SNAP_MM:
            self._node = i + 1
        else:
            self._divide(i, offset_mm)
            self._node = self._scheduled = i + 1
            p = self._path
            if p.stop[i + 2] and not np.array_equal(p.tangent_in[i + 1], p.tangent_out[i + 1]):
                # from rest to rest: a parabola alone has one s'', and cannot begin and end with nothing
                self._divide(i + 1, float(p.length[i + 1]) / 2)

    def _divide(self, i: int, offset_mm: float) -> None:
        self._path = divide(self._path, i, offset_mm)
        self._marks = [m if m.node <= i else replace(m, node=m.node + 1) for m in self._marks]

    def _suspend(self, sent_s: float, m: int) -> None:
        """Interrupt the rest that piece ``m`` began; what is left of it waits for ``resume``."""
        line = self._line
        left = float(line.ends()[m]) - sent_s
        rest = timeline.part(line.pieces, m, len(line.pieces))
        duration = rest.duration_s.copy()
        duration[0] = left
        later = [replace(e, time_s=e.time_s - sent_s) for e in line.events if e.time_s > sent_s]
        self._pending = (replace(rest, duration_s=duration), later)
        kept = tuple(e for e in line.events if e.time_s <= sent_s)
        self._line = replace(line.upto(m + 1, float(line.pieces.duration_s[m]) - left), events=kept)

    def _brake(self) -> float:
        """Append the hardest braking from the present state; the distance to rest."""
        p, c = cut(self._path, self._node, len(self._path)), self._setting.constraints
        x, j, offset = hardest(p, c, self._x)
        self.alive()
        first, self._x = self._node, 0.0
        marks = [replace(m, node=m.node - first) for m in self._marks if self._scheduled < m.node <= first + j]
        pieces, events = schedule(Timed(cut(p, 0, j), x[: j + 1], np.zeros(j), marks), c)
        self._append(pieces, events, first)
        self._scheduled = max(self._scheduled, first + j)
        if offset > 0:
            speed = float(np.sqrt(x[j]))
            duration = np.array([2 * offset / speed])
            last = Pieces(duration, np.zeros(1, np.int32), np.zeros(1), np.array([speed]), -speed / duration)
            self._append(last, [], first + j)
        self._node_at(first + j, offset)
        return float(p.length[:j].sum() + offset)


def live(
    commands: Iterable[Command | MoveBlock],
    limits: Limits,
    *,
    start: F8,
    moves: int = BATCH_MOVES,
    kinematics: Kinematics | RotaryTable | None = None,
    filter_s: float | None = None,
) -> LiveTrajectory:
    """A trajectory of ``commands`` that is planned while it runs; arguments as in ``planner.plan.plan``."""
    return LiveTrajectory(commands, setting_of(limits, start, kinematics, filter_s), moves)
