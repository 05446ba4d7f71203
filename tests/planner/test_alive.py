"""What a hold or an override makes a host reckon is cut into bounded pieces; between two it shows that it lives."""

import numpy as np
import pytest

from gcode import canon
from nmc.budget import BusTiming
from planner import kernel
from planner.motors import ServoMotor, StepMotor
from planner.plan import plan
from planner.retime import RetimablePlan
from planner.steptrain import COARSE, SAMPLE_S, SHORT_CHUNK_S
from planner.stream import make_source
from planner.stream_track import CHUNK
from planner.timing import Rate
from planner.types import Limits

AXES = ("X", "Y", "Z", "A", "B", "C", "U", "V")
SAMPLES = max(round((1 + 1 / COARSE) * SHORT_CHUNK_S / SAMPLE_S), CHUNK) + 8
"""No piece looks at more places of the plan than one chunk has, the coarse look at it included."""
PASSES = 2
"""No piece goes more often than this over the intervals that are left."""


class Toll:
    """Adds up work, and begins anew whenever the host shows that it lives."""

    def __init__(self) -> None:
        self.beats = 0
        self.most = 0
        self.total = 0
        self._since = 0

    def alive(self) -> None:
        self.beats += 1
        self._since = 0

    def work(self, amount: int) -> None:
        self.total += amount
        self._since += amount
        self.most = max(self.most, self._since)


def program(axes: int, minutes: float) -> list[canon.Feed]:
    """One long straight line of all axes at 10 mm/s: legs of many chunks."""
    end = [600.0 * minutes / np.sqrt(axes)] * axes + [0.0] * (9 - axes)
    return [canon.Feed(1, tuple(end), 10.0), canon.Feed(2, (0.0,) * 9, 10.0)]


def planned(axes: int, minutes: float):
    limits = Limits(AXES[:axes], np.full(axes, 60.0), np.full(axes, 500.0), 0.01)
    return plan(program(axes, minutes), limits, start=np.zeros(axes), solver="kernel")


def counted(trajectory: RetimablePlan, toll: Toll, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("q", "coordinate"):
        ask = getattr(trajectory, name)

        def asked(t_s, *column, ask=ask):
            toll.work(len(t_s))
            return ask(t_s, *column)

        monkeypatch.setattr(trajectory, name, asked)


def motor(axis: str, chip: str, address: int):
    if chip == "servo":
        return ServoMotor(axis, axis, 0, address, 400.0)
    return StepMotor(axis, axis, 0, address, 200.0, 2)


@pytest.mark.parametrize("change", ["hold", "slower"])
@pytest.mark.parametrize("chips", [["step"] * 3, ["step"] * 8, ["servo", "servo", "step"]])
def test_steps_and_tracks_are_looked_up_chunk_by_chunk(chips, change, monkeypatch) -> None:
    toll = Toll()
    made = RetimablePlan(planned(len(chips), 0.1), alive=toll.alive)
    motors = [motor(axis, chip, n + 1) for n, (axis, chip) in enumerate(zip(AXES, chips, strict=False))]
    timing = BusTiming.at(115_200)
    source = make_source(made, motors, timing=timing, start_ns=0, profile="smooth", alive=toll.alive)
    if "servo" not in chips:
        source = make_source(made, motors, timing=timing, start_ns=0, profile="adaptive", alive=toll.alive)
    counted(made, toll, monkeypatch)
    source.passed(1_000_000_000)
    if change == "hold":
        source.hold()
    else:
        source.override(Rate(feed=0.5))
    schedule, _ = source.rate_control()
    schedule._take_new_times()
    for axis in schedule.axes:
        axis.next_leg()
    for servo in schedule.servos:
        servo.track.at(2e9)
    assert toll.beats > len(chips)
    assert toll.most <= SAMPLES
    if change == "slower":
        assert toll.total > 3 * SAMPLES  # so there was something to be cut


@pytest.mark.parametrize("change", ["hold", "resume", "slower", "faster"])
def test_the_path_is_timed_anew_stage_by_stage(change, monkeypatch) -> None:
    toll = Toll()
    trial = RetimablePlan(planned(3, 0.1), alive=toll.alive)
    if change == "resume":
        trial.hold(1.0)
    for name in ("node_caps", "backward", "forward", "fill_pieces"):
        run = getattr(kernel, name)

        def passed(*arguments, run=run):
            toll.work(1)
            return run(*arguments)

        monkeypatch.setattr(kernel, name, passed)
    toll.alive()
    toll.beats = 0
    if change == "hold":
        trial.hold(1.0)
    elif change == "resume":
        trial.resume(1.5)
    else:
        trial.override(1.0, Rate(feed=0.5 if change == "slower" else 2.0))
    assert trial.duration_s > 1.0
    trial.q(np.array([1.5]))
    assert toll.beats >= 3
    assert toll.total >= 1
    assert toll.most <= PASSES
