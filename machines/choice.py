"""Which profile a run is streamed with, chosen once before anything moves, and the words that say why.

``auto`` gives PIC-SERVO axes ``smooth`` where that is safe and the host keeps its time, else ``stop-here``:

    no watchdog? --yes--> stop-here          smooth has no stop position: only a watchdog ends it
    file or twin says more than 2 ms? -----> stop-here
    on a port: measured more than 2 ms? ---> stop-here
    --------------------------------------> smooth

What was asked for by name is taken or refused, never replaced without a word.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from machines.profiles import choose_profile, kinds_of, profiles_used, step_profile, unwatched
from machines.schema import MachineConfig
from machines.wiring import bus_timing, motors, nmc_buses, servo_tables
from planner.motors import ServoMotor
from planner.stream import Profile

NS_PER_MS = 1_000_000
SMOOTH_JITTER_NS = 2 * NS_PER_MS
"""What ``smooth`` is good for: the command within 4.5 um of the plan (docs/streaming.md)."""


@dataclass(frozen=True, slots=True)
class Choice:
    """The profile to stream with, never ``auto``, and what is to be told of it."""

    profile: Profile
    notes: tuple[str, ...] = ()


def choose(config: MachineConfig, wanted: str, simulated: bool, measure: Callable[[], int]) -> Choice:
    """What a run is streamed with.

    measure: the longest delay of the host on a port, ns; asked only where it decides. Raises ValueError for a profile
    that this machine does not offer, and what ``measure`` raises.
    """
    chosen = choose_profile(config, wanted, simulated)
    if wanted != "auto":
        return Choice(chosen, _replaced(config, chosen, simulated))
    if not servo_tables(config):
        return Choice(step_profile(config, simulated))
    against = _against_smooth(config, simulated)
    if against:
        return Choice("stop-here", (f"profile stop-here: {against}",))
    if simulated:
        return Choice("smooth")
    delay_ns = measure()
    words = f"the host was up to {delay_ns / NS_PER_MS:.2f} ms late before the run"
    if delay_ns > SMOOTH_JITTER_NS:
        return Choice("stop-here", (f"profile stop-here: {words}, smooth wants {SMOOTH_JITTER_NS / NS_PER_MS:g} ms",))
    return Choice("smooth", (f"profile smooth: {words}, and a watchdog is on",))


def _against_smooth(config: MachineConfig, simulated: bool) -> str:
    """Why ``smooth`` is not taken whatever is measured, in words; empty if nothing is against it."""
    named = list(nmc_buses(config))
    if not simulated and (bare := unwatched(config)):
        return f"bus {', '.join(bare)} has no watchdog (watchdog_ms = 0), which smooth needs"
    buses = sorted({motor.bus for motor in motors(config) if isinstance(motor, ServoMotor)})
    for bus in buses:
        jitter_ns = bus_timing(config, bus, simulated).jitter_max_ns
        if simulated:
            jitter_ns = max(jitter_ns, round(config.sim.host_jitter_ms * NS_PER_MS))
        if jitter_ns > SMOOTH_JITTER_NS:
            most = f"{SMOOTH_JITTER_NS / NS_PER_MS:g} ms"
            return f"host_jitter_ms of bus {named[bus]} is {jitter_ns / NS_PER_MS:g} ms, smooth wants {most}"
    return ""


def _replaced(config: MachineConfig, chosen: Profile, simulated: bool) -> tuple[str, ...]:
    """What is taken beside or instead of the profile asked for, bus by bus."""
    found = []
    for bus, used in profiles_used(config, chosen, simulated).items():
        steppers, servos = kinds_of(config, bus)
        if steppers and servos and chosen != used:
            found.append(
                f"profile {chosen}: on bus {bus} servos ({', '.join(servos)}) get {used}, and steppers beside them "
                f"({', '.join(steppers)}) are led as in adaptive"
            )
        elif chosen != used:
            found.append(f"profile {chosen}: bus {bus} ({', '.join(steppers or servos)}) gets {used}")
    return tuple(found)
