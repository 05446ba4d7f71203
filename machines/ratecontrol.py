"""Hold, resume, override on a running stream, and what host and bus can carry: what is done between two exchanges.

    running --hold--> holding --every axis at rest, read back--> held --resume--> running
                         \\----------------------resume------------------------------/

A hold is announced with its time and distance when it is asked for, and measured when the machine stands: the time
until then, and how far the counters read back are from the announced place.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from machines.control import Control, RateStatus, Request
from machines.governor import Advice, Governor
from machines.ratecontrolled import Assuming, Planned, RateControlled
from machines.strain import Strain
from nmc.program import Evidence
from planner.errors import PlanError
from planner.stream import Progress, StreamSource
from planner.stream_strain import strain_steps
from planner.timing import Rate
from planner.types import F8, Trajectory

NS_PER_S = 1_000_000_000
SAMPLE_S = 5e-4


@dataclass(frozen=True, slots=True)
class HoldRecord:
    """One hold. Times s from the request, lengths mm. off_mm: the place read back from the announced one.

    announced_mm: along the path from where the plan was at the request. measured_s is None if it was resumed, or the
    program stopped, before the machine stood.
    """

    line: int
    asked_s: float
    announced_s: float
    announced_mm: float
    measured_s: float | None = None
    off_mm: float | None = None


class Floor(Protocol):
    """What rate control needs of the session that it serves."""

    def note(self, event: str, time_ns: int, **fields: Any) -> None:
        """Tell the journal."""

    def stand(self, stands: bool) -> None:
        """The machine is held, or runs again."""

    def expect(self, host_delay_ns: int) -> None:
        """The host may take so long before a packet leaves."""

    def places(self) -> Mapping[str, float]:
        """Where the axes are, read back from the chips."""


class RateController:
    """Serves the control of one run. ``stop_asked``: somebody wants it to end.

    ``recall``: takes back what waits to be sent; called before times change. ``strain``: how far off the path the axes
    are believed to be; None: nobody looks.
    """

    def __init__(
        self,
        source: object,
        control: Control,
        governor: Governor | None,
        floor: Floor,
        recall: Callable[[], None],
        strain: Strain | None = None,
    ) -> None:
        self._whole = source
        self._begins_ns = source.plan_start_ns if isinstance(source, Planned) else 0
        self._source = source if isinstance(source, RateControlled) else None
        self._control = control
        self._governor = governor
        self._strain = strain
        self._host_share = 1.0
        self._floor = floor
        self._recall = recall
        self._rate = Rate()
        self._whole_s: float | None = None
        self._hold_ns = 0
        self._place: F8 = np.empty(0)
        self.holds: list[HoldRecord] = []
        self.changes = 0
        self.unheeded = ""
        self.least_share = 1.0
        """Of the programmed speed, what host and bus could carry at the least."""
        self.stop_asked = False
        self._told = RateStatus()
        control.told(self._told)

    @property
    def held(self) -> bool:
        """The machine stands in a hold."""
        return self._told.state == "held"

    def after(self, evidence: Evidence) -> None:
        """What is to be done after an exchange."""
        if isinstance(self._source, StreamSource):
            self._source.passed(evidence.replied_ns)
        if self._governor is not None and (advice := self._governor.observe(evidence)) is not None:
            self._heed(advice, evidence)
        if self._strain is not None and self._source is not None and self._strain.due(evidence.replied_ns):
            self._look(self._strain, self._source, evidence)
        if self._told.state == "holding" and self._source is not None and self._source.holding:
            self._stands(evidence)
        request = self._control.take(self._time_s(evidence.replied_ns))
        if request is not None:
            self._serve(request, evidence)

    def shown(self, progress: Progress) -> Progress:
        """Progress in terms of the whole program: a held trajectory ends at its rest."""
        if self._source is None or not self._source.held or self._whole_s is None:
            return progress
        return replace(progress, duration_s=max(self._whole_s, progress.time_s))

    def _time_s(self, time_ns: int) -> float:
        return (time_ns - self._begins_ns) / NS_PER_S

    def _serve(self, request: Request, evidence: Evidence) -> None:
        if request.kind == "stop":
            self.stop_asked = True
            return
        if self._source is None:
            self._refuse("a program with index moves cannot be held or overridden, only stopped", evidence)
            return
        try:
            if request.kind == "hold":
                self._hold(self._source, evidence)
            elif request.kind == "resume":
                self._resume(self._source, evidence)
            else:
                self._override(self._source, request, evidence)
        except (ValueError, PlanError) as error:
            self._refuse(str(error), evidence)

    def _hold(self, source: RateControlled, evidence: Evidence) -> None:
        if source.held:
            return
        trajectory, now_ns = source.trajectory, evidence.replied_ns
        now_s, whole_s = self._time_s(now_ns), trajectory.duration_s
        self._recall()
        rest_s = source.hold()
        self.changes += 1
        self._whole_s, self._hold_ns = whole_s, now_ns
        self._place = trajectory.q(np.array([rest_s]))[0]
        line, way_mm = evidence.exchange.line, _path_mm(trajectory, now_s, rest_s)
        self.holds.append(HoldRecord(line, now_s, max(rest_s - now_s, 0.0), way_mm))
        rest_in_s = self.holds[-1].announced_s
        self._floor.note("hold", now_ns, line=line, rest_s=round(rest_in_s, 6), rest_mm=round(way_mm, 4))
        self._tell(state="holding", rest_s=rest_in_s, rest_mm=way_mm, refused="")

    def _stands(self, evidence: Evidence) -> None:
        """Every axis has come to rest and been read by the stream: measure, and say where."""
        assert self._source is not None
        measured_s = (evidence.replied_ns - self._hold_ns) / NS_PER_S
        places = self._floor.places()
        axes = self._source.trajectory.axes
        off = np.array([places.get(axis, place) for axis, place in zip(axes, self._place, strict=True)]) - self._place
        off_mm = float(np.linalg.norm(off))
        self.holds[-1] = replace(self.holds[-1], measured_s=measured_s, off_mm=off_mm)
        self._floor.note(
            "held", evidence.replied_ns, after_s=round(measured_s, 6), off_mm=round(off_mm, 4), places=dict(places)
        )
        self._floor.stand(True)
        self._tell(state="held")

    def _resume(self, source: RateControlled, evidence: Evidence) -> None:
        if not source.held:
            return
        source.resume()
        self._whole_s = None
        self._floor.note("resume", evidence.replied_ns)
        if self.held:
            self._floor.stand(False)
        self._tell(state="running", refused="")

    def _override(self, source: RateControlled, request: Request, evidence: Evidence) -> None:
        share = request.percent / 100
        rate = replace(self._rate, feed=share) if request.kind == "feed" else replace(self._rate, rapid=share)
        if rate == self._rate:
            return
        self._apply(source, rate, evidence)
        feed, rapid = round(100 * rate.feed), round(100 * rate.rapid)
        self._floor.note("override", evidence.replied_ns, feed_percent=feed, rapid_percent=rapid)
        self._tell(feed_percent=100 * rate.feed, rapid_percent=100 * rate.rapid, refused="")

    def _heed(self, advice: Advice, evidence: Evidence) -> None:
        """The host is slower than assumed, or quiet again."""
        jitter_ms = round(advice.jitter_max_ns / 1e6, 3)
        self._floor.expect(advice.jitter_max_ns)
        try:
            if isinstance(self._whole, Assuming):
                self._whole.assume(advice.jitter_max_ns)
            if self._source is None and advice.share < 1.0:
                raise ValueError("a program with index moves cannot be slowed")
            self._host_share = advice.share
            if self._source is not None:
                self._carry(self._source, evidence)
        except (ValueError, PlanError) as error:
            self.unheeded = str(error)
        line, percent = evidence.exchange.line, round(100 * self._rate.bus)
        self._floor.note("host_delays", evidence.replied_ns, line=line, jitter_ms=jitter_ms, speed_percent=percent)
        self._tell(bus_percent=100 * self._rate.bus)

    def _look(self, strain: Strain, source: RateControlled, evidence: Evidence) -> None:
        """How far the axes are off the path; more than the bus should let them be slows the motion."""
        if self._told.state != "running":
            strain.pause(evidence.replied_ns)
            return
        offs = source.offs()
        if not any(off.rate for off in offs):
            strain.skip(evidence.replied_ns)
            return
        if not strain.look(strain_steps(offs), evidence.replied_ns, self._rate.bus):
            return
        try:
            self._carry(source, evidence)
        except (ValueError, PlanError) as error:
            self._refuse(str(error), evidence)
            strain.slows = False  # what could not be slowed is not asked again
        share, steps = round(100 * self._rate.bus), round(strain.steps, 1)
        self._floor.note(
            "bus_strain", evidence.replied_ns, line=evidence.exchange.line, steps=steps, speed_percent=share
        )
        self._tell(bus_percent=100 * self._rate.bus)

    def _carry(self, source: RateControlled, evidence: Evidence) -> None:
        """As fast as host and bus can carry."""
        share = self._host_share if self._strain is None else min(self._host_share, self._strain.share)
        if share != self._rate.bus:
            self._apply(source, replace(self._rate, bus=share), evidence)
            self.least_share = min(self.least_share, share)

    def _apply(self, source: RateControlled, rate: Rate, evidence: Evidence) -> None:
        self._recall()
        source.override(rate)
        self._rate = rate
        self.changes += 1
        if self._strain is not None:
            self._strain.pause(evidence.replied_ns)

    def _refuse(self, words: str, evidence: Evidence) -> None:
        self._floor.note("refused", evidence.replied_ns, message=words)
        self._tell(refused=words)

    def _tell(self, **changes: Any) -> None:
        self._told = replace(self._told, **changes)
        self._control.told(self._told)


def _path_mm(trajectory: Trajectory, from_s: float, to_s: float) -> float:
    """Length of the path between two times."""
    if to_s <= max(from_s, 0.0):
        return 0.0
    q = trajectory.q(np.linspace(max(from_s, 0.0), to_s, int((to_s - max(from_s, 0.0)) / SAMPLE_S) + 2))
    return float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum())
