"""What a bus can follow: how far from its path a plan will come out of the pins, estimated before anything moves.

Between two loads an axis goes on at one rate (or stands on one Stop Here point), so what it misses follows from
its plan and from the time between two of its loads, its *turn*. A bus with many axes or few baud has long turns:

    q |          .--*        a constant rate over a turn is a chord of q(t): off by a t^2 / 8 in its middle.
      |      .--' .'         The plan itself is asked, so reversals and corners count as they are.
      |   .-'  .'
      | *'--.-'              a point that stands for a turn is off by half of what the plan goes in it
      +--|-------|---- t
          a turn

A turn is taken as one exchange of each axis of the bus that moves just then; of ``exact``, one slice at least. How many
such turns a load really has to serve, and what is left on a bus that has time, was measured: ``benchmarks/busload.py``
prints estimate and simulation side by side.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from machines.profiles import choose_profile, streamed_as
from machines.schema import MachineConfig
from machines.wiring import bus_timing, motors, nmc_buses, scale_of
from nmc.budget import BusTiming
from planner.motors import Motor, ServoMotor
from planner.stream_exact import round_least_ns
from planner.types import Trajectory

F8 = npt.NDArray[np.float64]

BYTES = {"group": 4, "adaptive": 4, "exact": 8, "stop-here": 5, "smooth": 9}
"""Data bytes of a load."""
MOVES_HZ = 1.0
"""An axis moves that is led at more steps or counts a second."""
CHUNK = 50_000
FINEST_S = 5e-4


@dataclass(frozen=True, slots=True)
class Habit:
    """How a profile does on a bus, measured: off by ``floor_steps`` + ``share`` * the error of ``turns`` turns.

    stands: it gives points, not rates.
    """

    turns: float
    share: float
    floor_steps: float
    stands: bool = False


HABITS: Mapping[str, Habit] = {
    "adaptive": Habit(2.0, 1.0, 1.0),
    "group": Habit(2.0, 2.0, 1.0),
    "exact": Habit(1.0, 1.0, 2.0),
    "smooth": Habit(1.0, 1.0, 0.3),
    "stop-here": Habit(1.0, 0.6, 0.3, stands=True),
}


@dataclass(frozen=True, slots=True)
class Drive:
    """A motor as its bus sees it.

    column: of its axis in the plan. exchange_ns: of one load; least_ns: what a turn takes at least.
    """

    motor: Motor
    column: int
    scale: float
    exchange_ns: float
    habit: Habit
    least_ns: float = 0.0


@dataclass(frozen=True, slots=True)
class Load:
    """The worst moment of a plan on the buses.

    moving: axes that move on that bus; turn_ms: time between two loads of each; line: 0 if it is no program's.
    """

    bus: str
    profile: str
    baud: int
    jitter_ms: float
    moving: int
    turn_ms: float
    steps: float
    share: float
    """So much of the accelerations (Stop Here points: of the speeds) would be within the limit; 0: none would."""
    line: int = 0
    limit_steps: float = 0.0

    def words(self) -> str:
        """What will happen, why, and what to do about it."""
        unit = "counts" if self.profile in ("smooth", "stop-here") else "steps"
        where = f" in line {self.line}" if self.line else ""
        far = f"will be about {self.steps:.0f} {unit} off its path"
        axes = f"{self.moving} axes that move at once get a load every {self.turn_ms:.0f} ms each"
        cure = "fewer axes on this bus (a second one), " + ("" if self.baud == 115200 else "a higher baud, ")
        if self.share > 0:
            linear = HABITS[self.profile].stands
            most = int(self.moving * (self.share if linear else self.share**0.5))
            if most > 1:
                cure = cure.replace("fewer axes on this bus (a second one)", f"at most {most} axes on this bus")
            what = "speeds" if linear else "accelerations"
            cure += f"or {what} of at most {max(int(100 * self.share), 1)} % of these"
        else:
            cure += "or a host with less jitter"
        allowed = f" (contour_steps allows {self.limit_steps:g})"
        return (
            f"bus {self.bus} is too slow: the machine {far}{where}{allowed}, for {axes} at {self.baud} baud with "
            f"{self.jitter_ms:g} ms of host jitter, profile {self.profile}; {cure}"
        )


def overload(
    config: MachineConfig, trajectory: Trajectory, profile: str, simulated: bool, share: float = 1.0
) -> Load | None:
    """The worst moment of a plan if it is further off than ``contour_steps`` of ``[verify]``; None if it is not.

    share: of that limit. Raises ValueError for a profile that is not offered.
    """
    drives = _drives(config, profile, simulated, tuple(trajectory.axes))
    step_s = max(min(drive.exchange_ns for drive in drives) / 1e9, FINEST_S)
    worst, at_s = -1.0, 0.0
    for t, first, last in _chunks(trajectory.duration_s, step_s, _longest_s(drives)):
        errors = _errors(trajectory.q(t), np.abs(trajectory.v(t)), drives, step_s)
        steps = np.sqrt(np.sum(errors**2, axis=1))[first:last]
        at = int(np.argmax(steps))
        if steps[at] > worst:
            worst, at_s = float(steps[at]), float(t[first + at])
    floor = max(drive.habit.floor_steps for drive in drives)
    limit = share * config.verify.contour_steps
    if worst + floor <= limit:
        return None
    moving = np.abs(trajectory.v(np.array([at_s])))[0]
    line = int(trajectory.line(np.array([at_s]))[0])
    return _load(config, drives, moving, worst, profile, simulated, line, limit)


def possible_overload(config: MachineConfig, simulated: bool) -> Load | None:
    """As ``overload``, of any program: all axes of the busiest bus at once, as hard or as fast as they may go."""
    if not motors(config):
        return None
    try:
        choose_profile(config, "auto", simulated)
    except ValueError:
        return None  # no program runs on it
    axes = tuple(dict.fromkeys(motor.axis for motor in motors(config)))
    drives = _drives(config, "auto", simulated, axes)
    errors = dict.fromkeys(axes, 0.0)
    for drive in drives:
        axis, habit = config.axis[drive.motor.axis], drive.habit
        turn_s = _turn_ns(drives, drive.motor.bus) * habit.turns / 1e9
        most = axis.max_velocity * turn_s / 2 if habit.stands else axis.max_acceleration * turn_s**2 / 8
        errors[drive.motor.axis] = max(errors[drive.motor.axis], most * abs(drive.scale) * habit.share)
    worst = sum(error**2 for error in errors.values()) ** 0.5 if len(axes) > 1 else 0.0
    if worst + max(drive.habit.floor_steps for drive in drives) <= config.verify.contour_steps:
        return None
    return _load(config, drives, np.full(len(axes), np.inf), worst, "auto", simulated, 0, config.verify.contour_steps)


def _drives(config: MachineConfig, profile: str, simulated: bool, axes: tuple[str, ...]) -> list[Drive]:
    chosen = choose_profile(config, profile, simulated)
    found = []
    for motor in motors(config):
        timing, here = bus_timing(config, motor.bus, simulated), streamed_as(config, motor.bus, chosen, simulated)
        own = here if isinstance(motor, ServoMotor) or here in ("group", "adaptive", "exact") else "adaptive"
        exchange_ns = float(timing.mean_exchange_ns(BYTES[own]))
        least_ns = float(round_least_ns(timing)) if own == "exact" else 0.0
        found.append(Drive(motor, axes.index(motor.axis), scale_of(motor), exchange_ns, HABITS[own], least_ns))
    return found


def _turn_ns(drives: list[Drive], bus: int) -> float:
    here = [drive for drive in drives if drive.motor.bus == bus]
    return max(sum(drive.exchange_ns for drive in here), *(drive.least_ns for drive in here))


def _longest_s(drives: list[Drive]) -> float:
    buses = {drive.motor.bus for drive in drives}
    return max(_turn_ns(drives, bus) * max(habit.turns for habit in HABITS.values()) for bus in buses) / 1e9


def _chunks(duration_s: float, step_s: float, beyond_s: float) -> Iterator[tuple[F8, int, int]]:
    """Even instants in pieces that overlap by a turn on either side; which of them are the piece's own."""
    count, beyond = int(duration_s / step_s) + 2, int(beyond_s / step_s) + 2
    for begin in range(0, count, CHUNK):
        end = min(begin + CHUNK, count)
        t = np.arange(begin - beyond, end + beyond) * step_s  # a trajectory clamps times outside
        yield np.clip(t, 0.0, duration_s), beyond, beyond + end - begin


def _errors(q: F8, v: F8, drives: list[Drive], step_s: float) -> F8:
    """Error in steps f8[N, A] of each axis at each instant.

    An axis that moves alone is late or early at most: no error of a path.
    """
    errors = np.zeros(q.shape)
    several = np.sum(v > 0, axis=1) > 1
    turns_ns: dict[int, F8] = {}
    for drive in drives:
        bus, moves = drive.motor.bus, v[:, drive.column] * abs(drive.scale) > MOVES_HZ
        turns_ns[bus] = turns_ns.get(bus, np.zeros(len(q))) + moves * drive.exchange_ns
    for drive in drives:
        turn_ns = turns_ns[drive.motor.bus]
        turn_ns = np.where(turn_ns > 0, np.maximum(turn_ns, drive.least_ns), 0.0)
        half = np.maximum(np.round(turn_ns * drive.habit.turns / 2e9 / step_s), 1).astype(np.intp)
        counts = q[:, drive.column] * drive.scale
        error = np.where(several & (turn_ns > 0), _off(counts, half, drive.habit.stands), 0.0) * drive.habit.share
        np.maximum(errors[:, drive.column], error, out=errors[:, drive.column])
    return errors


def _off(counts: F8, half: npt.NDArray[np.intp], stands: bool) -> F8:
    """How far a chord, or a point that stands, over ``half`` samples either way is from the plan in its middle."""
    at = np.arange(len(counts))
    before, after = counts[np.maximum(at - half, 0)], counts[np.minimum(at + half, len(counts) - 1)]
    off: F8 = np.abs(after - before) / 2 if stands else np.abs(counts - (before + after) / 2)
    return off


def _load(
    config: MachineConfig,
    drives: list[Drive],
    moving: F8,
    worst: float,
    profile: str,
    simulated: bool,
    line: int,
    limit: float,
) -> Load:
    """The worst moment in figures: of the bus with the longest turn there."""
    turns: dict[int, float] = {}
    for drive in drives:
        if moving[drive.column] * abs(drive.scale) > MOVES_HZ:
            turns[drive.motor.bus] = turns.get(drive.motor.bus, 0.0) + drive.exchange_ns
    bus = max(turns, key=lambda number: turns[number], default=drives[0].motor.bus)
    here = [each for each in drives if each.motor.bus == bus and moving[each.column] * abs(each.scale) > MOVES_HZ]
    name, table = list(nmc_buses(config).items())[bus]
    timing: BusTiming = bus_timing(config, bus, simulated)
    floor = max(drive.habit.floor_steps for drive in drives)
    return Load(
        bus=name,
        profile=streamed_as(config, bus, choose_profile(config, profile, simulated), simulated),
        baud=table.baud,
        jitter_ms=timing.jitter_max_ns / 1e6,
        moving=len(here),
        turn_ms=max(turns.get(bus, 0.0), *(each.least_ns for each in here)) / 1e6 if here else 0.0,
        steps=worst + floor,
        share=max(limit - floor, 0.0) / worst if worst > 0 else 0.0,
        line=line,
        limit_steps=config.verify.contour_steps,
    )
