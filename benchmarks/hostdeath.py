"""The host dies in the middle of a stream: how far the machine runs on, how far it leaves the path, and where it ends.

    PYTHONPATH=. python -m benchmarks.hostdeath [--instants 20] [--only circle] [--seen]

Each run is killed at a random instant and byte of a packet, or right behind a Set Address. The watchdog's stop leaves
50 ms after the last byte, as for a host that hangs; --seen: the end of the process is seen, as it is when the pipe to
the watchdog process closes, and the take-over begins 2 ms after the last byte.

A chip goes on with its last rate, so off the path it may be hypot(R, v t) - R for a local radius R and a speed v, and
run on v t. Allowed beside: two steps (or what the profile's commands are off anyway); where the path speeds up or slows
down, what one axis's rate is older than another's, for each has a load of its own; and what one tick of the step timer
makes in that time, for a rate between two counts is made of both in turn. What is more than the radius term alone, of
the path from the death on, is printed as "beyond".
With the watchdog dead as well a PIC-STEP still stops on the stop position that it holds, and a Stop Here stream stands.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt

from benchmarks.planning_jobs import text as job_text
from benchmarks.rig import Conditions, bring_up, pins_of
from benchmarks.streaming import NAMED, trajectory
from nmc.budget import BusTiming
from nmc.executor import play
from nmc.link import Link
from nmc.watchdog import Phase, Ward, Watchdog, patrol
from planner.motors import ServoMotor
from planner.stream import Profile, lead_in_ns, make_source
from planner.types import Trajectory
from sim.build import Simulation

F8 = npt.NDArray[np.float64]
TIMEOUT_NS = 50_000_000
EXCHANGE_NS = 1_500_000
SEEN_NS = 2_000_000
"""A watchdog process notices the end of its host within this (``nmc.watchdog_process.PERIOD_NS``), if not at once."""
GROUPS = (0x81, 0x82)
SET_ADDRESS = 0x1
AFTERWARDS_NS = 300_000_000
RUN_OUT_NS = 30_000_000_000
ALLOWED_MM = {"smooth": 0.010, "stop-here": 0.065}
"""Beside the bounds: two steps of 5 um, or what the profile is off on a living host."""
STEPS_ALLOWED_MM = 0.010
STALE_S = 0.03
"""A rate that still holds may have been loaded this long ago: it is renewed when it is worth it."""
TICK_S = 0.8e-6
"""One tick of the step timer in speed mode 2x (PIC-STEP data sheet, section 4.1)."""


class HostDiedError(Exception):
    """The end of the host."""


class MortalLink:
    """A host's link that ends at an instant, after some bytes of the packet that it is writing then.

    behind_set_address: it ends with the first Set Address after that instant, which leaves whole.
    """

    def __init__(self, link: Link, dies_at_ns: int, last_bytes: int, behind_set_address: bool) -> None:
        self._link = link
        self._dies_at_ns = dies_at_ns
        self._last_bytes = last_bytes
        self._behind_set_address = behind_set_address
        self.last_call_ns = 0

    def __getattr__(self, name: str) -> object:
        return getattr(self._link, name)

    def write(self, data: bytes) -> None:
        """Hand on, or die."""
        self.last_call_ns = self._link.now_ns()
        if self.last_call_ns < self._dies_at_ns:
            self._link.write(data)
            return
        if not self._behind_set_address:
            self._link.write(data[: self._last_bytes])
            raise HostDiedError
        self._link.write(data)
        if data[2] & 0x0F == SET_ADDRESS:
            raise HostDiedError


@dataclass(frozen=True)
class Death:
    """What came of one death. Lengths mm, times ms; beyond_mm: off the path by more than the radius term alone."""

    off_mm: float
    beyond_mm: float
    off_bound_mm: float
    run_on_mm: float
    run_on_bound_mm: float
    rest_ms: float
    stands: bool
    inside: bool

    @property
    def good(self) -> bool:
        """Within its bounds, at rest, in the job's box."""
        within = self.off_mm <= self.off_bound_mm and self.run_on_mm <= self.run_on_bound_mm
        return within and self.stands and self.inside


@dataclass(frozen=True)
class Case:
    """A death to come: what is streamed, when the host dies and how, whether the watchdog lives."""

    path: Trajectory
    conditions: Conditions
    profile: Profile
    at_s: float
    last_bytes: int = 5
    behind_set_address: bool = False
    watchdog: bool = True
    seen: bool = False


def die(case: Case) -> Death | None:
    """One death; None if the stream ended before (no Set Address came any more)."""
    path, conditions = case.path, case.conditions
    simulation, bus, motors = bring_up(path.axes, conditions)
    timing = BusTiming.at(
        115200,
        jitter_max_ns=round(conditions.jitter_ms * 1e6),
        start_delay_max_ns=round(conditions.start_delay_ms * 1e6),
    )
    link = bus.link
    start_ns = link.now_ns() + lead_in_ns(motors, timing)
    source = make_source(path, motors, timing=timing, start_ns=start_ns, profile=case.profile)
    mortal = MortalLink(link, start_ns + round(case.at_s * 1e9), case.last_bytes, case.behind_set_address)
    bus.link = mortal  # type: ignore[assignment]
    try:
        for _ in play(bus, source):
            pass
        return None
    except HostDiedError:
        pass
    if case.watchdog:
        chips = ["pic-servo" if isinstance(motor, ServoMotor) else "pic-step" for motor in motors]
        wards = [Ward(motor.address, chip) for motor, chip in zip(motors, chips, strict=True)]
        dog = Watchdog(wards, GROUPS, baud=115200, timeout_ns=TIMEOUT_NS, latency_ns=1_000_000)
        dog.arm(mortal.last_call_ns)
        assert dog.due_ns is not None
        begins_ns = mortal.last_call_ns + SEEN_NS if case.seen else dog.due_ns
        within_ns = begins_ns - mortal.last_call_ns + dog.timeout_ns - dog.reaction_ns
        link.sleep_until(begins_ns)
        dog.trip(link.now_ns())
        patrol(dog, link, rounds=20)
        stands = dog.phase is Phase.STANDING
    else:
        stands, within_ns = True, TIMEOUT_NS
    world = simulation.world
    world.run_until(world.now_ns + (AFTERWARDS_NS if case.watchdog else RUN_OUT_NS))
    scale = np.array([m.counts_per_unit if isinstance(m, ServoMotor) else m.steps_per_unit for m in motors])
    return _judged(case, simulation, scale, start_ns, mortal.last_call_ns, within_ns, stands)


def _judged(
    case: Case, simulation: Simulation, scale: F8, start_ns: int, died_ns: int, within_ns: int, stands: bool
) -> Death:
    """within_ns: from the last byte to the last group's Stop Motor."""
    path = case.path
    out = pins_of(simulation.trace())
    after = int(np.searchsorted(out.time_ns, died_ns))
    places = out.position[max(after - 1, 0) :] / scale
    changes = np.flatnonzero((np.abs(np.diff(places, axis=0)) > 0.6 / np.abs(scale)).any(axis=1))
    time_ns = out.time_ns[max(after - 1, 0) :]
    last_ns = float(time_ns[changes[-1] + 1]) if len(changes) else float(died_ns)
    stands = stands and last_ns < simulation.world.now_ns - AFTERWARDS_NS // 2
    died_s = (died_ns - start_ns) * 1e-9
    reach_s = (within_ns + EXCHANGE_NS) * 1e-9
    speed, radius, change = _around(path, died_s, reach_s, STALE_S)
    allowed = ALLOWED_MM.get(case.profile, 0.0)
    if not allowed:
        rates = np.abs(path.v(np.array([died_s]))[0])
        tick = float(np.linalg.norm(rates**2 * np.abs(scale))) * TICK_S * reach_s
        allowed = STEPS_ALLOWED_MM + change * len(path.axes) * EXCHANGE_NS * 1e-9 * reach_s + tick
    run = speed * reach_s
    near = path.q(np.arange(max(died_s - 0.2, 0.0), died_s + reach_s + 0.2, 2e-4))
    whole = path.q(np.linspace(0.0, path.duration_s, 20_001))
    slack = 1.01 / np.abs(scale)
    inside = (places >= whole.min(axis=0) - slack).all() and (places <= whole.max(axis=0) + slack).all()
    if not case.watchdog:
        return Death(0.0, 0.0, 0.0, 0.0, 0.0, (last_ns - died_ns) / 1e6, stands, bool(inside))
    later_speed, later_radius, _ = _around(path, died_s, reach_s, 0.0)
    off = _off(places, near)
    return Death(
        off_mm=off,
        beyond_mm=off - _tangent_mm(later_radius, later_speed * reach_s),
        off_bound_mm=_tangent_mm(radius, run) + allowed,
        run_on_mm=float(np.linalg.norm(places - places[0], axis=1).max()),
        run_on_bound_mm=run + allowed,
        rest_ms=(last_ns - died_ns) / 1e6,
        stands=stands,
        inside=True,
    )


def _tangent_mm(radius: float, run: float) -> float:
    """How far the end of a tangent of that length is from its circle."""
    return float(np.hypot(radius, run) - radius) if np.isfinite(radius) else 0.0


def _around(path: Trajectory, died_s: float, reach_s: float, stale_s: float) -> tuple[float, float, float]:
    """Greatest speed, least radius, greatest change of speed around a death: where the machine may still get to."""
    t = np.arange(max(died_s - stale_s, 0.0), died_s + reach_s, 5e-4)
    v, a = path.v(t), path.a(t)
    speed = np.linalg.norm(v, axis=1)
    moving = speed > 0.2
    if not moving.any():
        return float(speed.max()), np.inf, 0.0
    direction = v[moving] / speed[moving, None]
    along = np.sum(a[moving] * direction, axis=1)
    bend = np.linalg.norm(a[moving] - direction * along[:, None], axis=1) / speed[moving] ** 2
    just_before = t[moving] <= died_s + 1e-3
    change = float(np.abs(along[just_before]).max(initial=0.0))
    return float(speed.max()), float(1.0 / max(bend.max(), 1e-9)), change


def _off(places: F8, polyline: F8) -> float:
    """Largest distance of places from a polyline."""
    begin, step = polyline[:-1], np.diff(polyline, axis=0)
    length = np.maximum(np.sum(step**2, axis=1), 1e-18)
    worst = 0.0
    for place in places:
        share = np.clip(np.sum((place - begin) * step, axis=1) / length, 0.0, 1.0)
        worst = max(worst, float(np.linalg.norm(begin + step * share[:, None] - place, axis=1).min()))
    return worst


@cache
def bench_job(letter: str) -> Trajectory:
    """A reference job of planning on a small mill, as it is streamed."""
    from gcode.interp import interpret
    from gcode.setup import Setup
    from planner.plan import plan
    from planner.types import Limits

    limits = Limits(("X", "Y", "Z"), np.array([60.0, 60.0, 20.0]), np.array([500.0, 500.0, 200.0]), 0.010)
    commands = interpret(job_text(letter), Setup(file=letter)).commands
    return plan(commands, limits, start=np.zeros(3), solver="kernel").trajectory


JOBS: dict[str, Callable[[int], Trajectory]] = {
    **{name: (lambda _seed, name=name: NAMED[name]()) for name in NAMED},  # type: ignore[misc]
    "random 20": lambda seed: trajectory("random 20 3", seed % 10),
    "random 60": lambda seed: trajectory("random 60 3", seed % 10),
}
BENCH = "abcdef"
FIRST_S = 6.0
"""Bench jobs are killed within their first seconds: what comes before has to be streamed."""


def deaths(
    make: Callable[[int], Trajectory], profile: Profile, servos: bool, instants: int, seen: bool = False
) -> Iterator[Case]:
    """The deaths of a row: by the watchdog at random bytes, behind a Set Address, and without a watchdog."""
    for seed in range(instants):
        path = make(seed)
        dice = np.random.default_rng([seed, 7])
        conditions = Conditions(0.2, seed=300 + seed, servos=("X", "Y", "Z") if servos else ())
        at_s = float(dice.uniform(0.05, min(path.duration_s, FIRST_S) - 0.05))
        yield Case(path, conditions, profile, at_s, int(dice.integers(0, 12)), seen=seen)
        if not servos and seed % 4 == 0:
            yield Case(path, conditions, profile, at_s, behind_set_address=True, seen=seen)
        if seed % 4 == 1 and profile != "smooth":
            yield Case(path, conditions, profile, at_s, int(dice.integers(0, 12)), watchdog=False)


def row(name: str, cases: Iterator[Case]) -> str:
    """One line of the table."""
    found = [(case, death) for case in cases if (death := die(case)) is not None]
    watched = [death for case, death in found if case.watchdog]
    alone = [death for case, death in found if not case.watchdog]
    off = max(watched, key=lambda death: death.off_mm / death.off_bound_mm)
    run = max(watched, key=lambda death: death.run_on_mm / death.run_on_bound_mm)
    bad = sum(not death.good for _, death in found)
    words = (
        f"{name:34s} off {max(d.off_mm for d in watched):6.3f} mm"
        f" (tightest {off.off_mm:6.3f} of {off.off_bound_mm:6.3f}, beyond {max(d.beyond_mm for d in watched):6.3f})"
        f"  run on {run.run_on_mm:5.2f} of {run.run_on_bound_mm:5.2f} mm"
        f"  rest after {max(d.rest_ms for d in watched):5.1f} ms"
    )
    if alone:
        words += f"  no watchdog: {sum(d.stands and d.inside for d in alone)} of {len(alone)} stand inside"
    return f"{words}  deaths {len(found)}  bad {bad}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instants", type=int, default=20)
    parser.add_argument("--only", default="", help="only rows that contain this")
    parser.add_argument("--seen", action="store_true", help="the watchdog sees the host's process end")
    options = parser.parse_args()
    rows: list[tuple[str, Callable[[int], Trajectory], Profile, bool]] = []
    for name, make in JOBS.items():
        rows.append((f"adaptive  {name}", make, "adaptive", False))
    for name in ("circle 50 mm, 20", "circle 50 mm, 60", "random 60"):
        rows.append((f"group  {name}", JOBS[name], "group", False))
        rows.append((f"stop-here  {name}", JOBS[name], "stop-here", True))
        rows.append((f"smooth  {name}", JOBS[name], "smooth", True))
    for letter in BENCH:
        rows.append((f"adaptive  bench {letter}", lambda _seed, letter=letter: bench_job(letter), "adaptive", False))
    for name, make, profile, servos in rows:
        if options.only in name:
            print(row(name, deaths(make, profile, servos, options.instants, options.seen)), flush=True)


if __name__ == "__main__":
    main()
