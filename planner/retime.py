"""A planned trajectory that can be timed anew while it runs: hold, resume and override of a whole plan.

Undisturbed it *is* the plan, sample for sample. The first hold or override puts the plan's path, marks and timeline
into a ``LiveTrajectory``, as if that had planned them, and from then on the live one is asked. So a run that nobody
disturbs costs nothing and sends the same bytes as ever.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from planner.jerk import FilteredTrajectory
from planner.motors import Motor, StepMotor
from planner.paths import cut
from planner.plan import Plan
from planner.steptrain import SHORT_CHUNK_S, StepTrain
from planner.timeline import Timeline, part
from planner.timing import Pieces, Rate
from planner.trajectory import WALK_FROM, PathTrajectory
from planner.types import F8, I4, Event, Trajectory, nobody_asks

if TYPE_CHECKING:
    from planner.live import LiveTrajectory, Rest

SLIVER_S = 1e-9
"""What is left of a piece at a cut, if shorter, is nothing."""


class RetimablePlan:
    """A plan, or the stretch of it that ``undisturbed`` shows; implements ``Trajectory`` and rate control.

    plan: one with a ``setting``. undisturbed: the plan's own trajectory, or a view on its stretch that begins at
    ``begin_s`` at rest. own: the stretch's first event and the first one after it, by number; None: those of its time.
    alive: called between the stages of timing anew.
    Raises ValueError for a plan that cannot be timed anew.
    """

    def __init__(
        self,
        plan: Plan,
        undisturbed: Trajectory | None = None,
        begin_s: float = 0.0,
        own: tuple[int, int] | None = None,
        alive: Callable[[], None] = nobody_asks,
    ) -> None:
        if plan.setting is None:
            raise ValueError("this plan cannot be timed anew")
        self._plan = plan
        self.undisturbed: Trajectory = plan.trajectory if undisturbed is None else undisturbed
        """As it was planned."""
        self._now = self.undisturbed
        self._begin_s = begin_s
        self._own = own
        self._alive = alive
        self._live: LiveTrajectory | None = None
        self.rest: Rest | None = None
        """Where and when the last hold comes to rest, as it was announced."""

    @property
    def disturbed(self) -> bool:
        """A hold or an override has changed its times."""
        return self._live is not None

    def streamed(self) -> PathTrajectory | FilteredTrajectory:
        """What has been streamed: the plan itself, or its path (of a stretch its own) with the times that held."""
        if self._live is None:
            return self._plan.trajectory
        self._live.extend(np.inf)
        return self._live.view()

    # The trajectory

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the planned axes."""
        return self._now.axes

    @property
    def duration_s(self) -> float:
        """Time of the end; while held, of the rest."""
        return self._now.duration_s

    @property
    def events(self) -> Sequence[Event]:
        """What happens on the way, ascending in time."""
        return self._now.events

    def q(self, t_s: F8) -> F8:
        """Positions f8[len(t), A], mm or degrees, machine frame."""
        return self._now.q(t_s)

    def coordinate(self, t_s: F8, column: int) -> F8:
        """Positions f8[len(t)] of one axis."""
        return self._now.q(t_s)[:, column] if self._live is None else self._live.coordinate(t_s, column)

    def v(self, t_s: F8) -> F8:
        """Velocities f8[len(t), A], mm/s."""
        return self._now.v(t_s)

    def a(self, t_s: F8) -> F8:
        """Accelerations f8[len(t), A], mm/s2."""
        return self._now.a(t_s)

    def line(self, t_s: F8) -> I4:
        """Source line i4[len(t)]."""
        return self._now.line(t_s)

    def junctions_s(self) -> F8:
        """Ascending times at which a piece begins or ends."""
        return self._now.junctions_s()

    # Rate control

    def hold(self, sent_s: float) -> Rest:
        """Brake to rest from the state at ``sent_s`` as hard as the axes allow."""
        self.rest = self._retimed().hold(max(sent_s, 0.0))
        return self.rest

    def resume(self, sent_s: float) -> None:
        """Go on after a hold, from rest or while still braking."""
        self._retimed().resume(max(sent_s, 0.0))

    def override(self, sent_s: float, rate: Rate) -> None:
        """Change the rate of everything after ``sent_s``. Raises PlanError outside the ranges of ``LiveTrajectory``."""
        self._retimed().override(max(sent_s, 0.0), rate)

    def _retimed(self) -> LiveTrajectory:
        if self._live is None:
            self._live = live_of(self._plan, self._begin_s, self._begin_s + self._now.duration_s, self._own)
            self._live.alive = self._alive
            self._alive()
            self._now = self._live
        return self._live


def rehearse(plan: Plan, motors: Sequence[Motor] = ()) -> None:
    """Load everything that a hold or an override needs: on a port there is no time for it while something moves.

    motors: their steps are cut once as a stream does.
    """
    if plan.setting is None or not len(plan.timed.intervals):
        return
    trial = RetimablePlan(plan)
    half = trial.duration_s / 2
    trial.override(half, Rate(0.9, 0.9, 0.9))
    rest = trial.hold(half + 0.01)
    trial.resume(rest.time_s + 0.01)
    for many in (3, WALK_FROM):
        times = np.linspace(0.0, trial.duration_s, many)
        trial.q(times)
        trial.line(times)
    for motor in motors:
        if isinstance(motor, StepMotor):
            StepTrain(trial, motor, half, None, SHORT_CHUNK_S).peek()


def live_of(plan: Plan, begin_s: float, end_s: float, own: tuple[int, int] | None = None) -> LiveTrajectory:
    """The stretch [begin_s, end_s] of a plan as a live trajectory that is planned to its end; it begins at rest.

    Marks and events of a plan are the same things in the same order.
    """
    from planner.live import LiveTrajectory

    assert plan.setting is not None
    base = plan.trajectory.base if isinstance(plan.trajectory, FilteredTrajectory) else plan.trajectory
    marks, events = plan.timed.marks, base.events
    if len(marks) != len(events):
        raise ValueError("this plan cannot be timed anew: its marks are not its events")
    if not len(plan.timed.intervals):
        return LiveTrajectory.planned(plan.setting, plan.timed.intervals, marks, Timeline(0.0, base.pieces, (*events,)))
    first, pieces = _stretch(base, begin_s, end_s)
    path = cut(plan.timed.intervals, first, first + int(pieces.interval[-1]) + 1)
    if own is None:
        whole = end_s >= base.duration_s
        times = [begin_s <= event.time_s and (whole or event.time_s < end_s) for event in events]
        own = (times.index(True), len(times) - times[::-1].index(True)) if any(times) else (0, 0)
    inside = slice(*own)
    line = Timeline(0.0, pieces, tuple(replace(event, time_s=event.time_s - begin_s) for event in events[inside]))
    return LiveTrajectory.planned(plan.setting, path, [replace(m, node=m.node - first) for m in marks[inside]], line)


def _stretch(base: PathTrajectory, begin_s: float, end_s: float) -> tuple[int, Pieces]:
    """Number of the first interval, and the pieces of a stretch with interval numbers from its beginning."""
    begins, ends = base.begin_s, np.append(base.begin_s[1:], base.duration_s)
    m = int(np.searchsorted(ends, begin_s + SLIVER_S, side="right"))
    n = max(int(np.searchsorted(begins, end_s - SLIVER_S, side="left")), m + 1)
    pieces = part(base.pieces, m, n)
    duration = pieces.duration_s.copy()
    duration[0] -= max(begin_s - float(begins[m]), 0.0)
    duration[-1] -= max(float(ends[n - 1]) - end_s, 0.0)
    first = int(pieces.interval[0])
    return first, replace(pieces, duration_s=duration, interval=pieces.interval - np.int32(first))
