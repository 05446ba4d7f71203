"""Which profile feeds the chips: the one asked for, or what is known of them decides.

``adaptive`` needs to know when a timer count that is loaded while the motor runs takes effect. On the twin ``[sim]``
says it; on a port only what was measured on that module and written into its axis counts (``count_latch``).
PIC-SERVO axes get ``smooth`` (velocity and acceleration a slice) or Stop Here points, which leave the axis standing
when the host dies. What ``auto`` gives them hangs on the host as well (``machines.choice``); here, where nothing is
measured, it is ``smooth`` on the twin and Stop Here points on a port.
"""

from __future__ import annotations

from typing import cast

from machines.cy545 import cy545_tables
from machines.schema import SHORTEST_WATCHDOG_MS, TWIN, MachineConfig, StepMotorTable
from machines.wiring import motor_tables, motors, nmc_buses, servo_tables
from planner.motors import ServoMotor
from planner.stream import PROFILES, Profile


def choose_profile(config: MachineConfig, wanted: str, simulated: bool) -> Profile:
    """The profile to stream with. Raises ValueError for one that the machine's chips do not offer."""
    steppers, servos = motor_tables(config), servo_tables(config)
    if wanted not in PROFILES:
        raise ValueError(f"profile {wanted} is not offered; offered: {', '.join(PROFILES)}")
    if wanted in ("group", "adaptive") and not steppers:
        raise ValueError(f"profile {wanted} is one of PIC-STEP axes, this machine has none")
    if wanted in ("stop-here", "smooth") and not servos:
        raise ValueError(f"profile {wanted} is one of PIC-SERVO axes, this machine has none")
    _refuse_counts_beside_servos(config, simulated)
    if wanted == "smooth" and not simulated and (bare := unwatched(config)):
        keys = ", ".join(f"watchdog_ms of [bus.{bus}]" for bus in bare)
        raise ValueError(
            f"profile smooth needs a watchdog, for a PIC-SERVO in it runs on without end if this program dies: {keys} "
            f"is 0; set it to {SHORTEST_WATCHDOG_MS} or more, or take --profile stop-here"
        )
    if wanted != "auto":
        return cast("Profile", wanted)
    if servos:
        return "smooth" if simulated else "stop-here"
    return step_profile(config, simulated)


def kinds_of(config: MachineConfig, bus: str) -> tuple[list[str], list[str]]:
    """Names of the PIC-STEP and of the PIC-SERVO motors on a bus."""
    steppers = [name for name, (_, table) in motor_tables(config).items() if table.bus == bus]
    return steppers, [name for name, (_, table) in servo_tables(config).items() if table.bus == bus]


def unwatched(config: MachineConfig) -> list[str]:
    """Buses with PIC-SERVO motors that no watchdog would stop on a port."""
    return [name for name, table in nmc_buses(config).items() if kinds_of(config, name)[1] and not table.watchdog_ms]


def _refuse_counts_beside_servos(config: MachineConfig, simulated: bool) -> None:
    """Beside servos steppers are led by counts in motion that wait for the roll-over: raise ValueError where not."""
    tables = motor_tables(config)
    for bus in nmc_buses(config):
        steppers, servos = kinds_of(config, bus)
        at_once = [
            name
            for name in steppers
            if (config.sim.count_latch if simulated else _measured(tables[name][1])[0]) == "immediate"
        ]
        if not at_once or not servos:
            continue
        sections = [f"[{'axis' if name in config.axis else 'motor'}.{name}]" for name in at_once]
        where = "[sim]" if simulated else ", ".join(sections)
        raise ValueError(
            f'axis {", ".join(at_once)} on bus {bus}: count_latch = "immediate" ({where}), and beside servos '
            f"({', '.join(servos)}) a stepper is led by counts that wait for the roll-over; put it on a bus of its "
            "own, where exact is taken, or measure again (groupstart probe-latch) if that is not what the chip does"
        )


def profile_of_bus(config: MachineConfig, bus: int, chosen: Profile, simulated: bool) -> Profile:
    """The profile of one of several buses: the machine's, unless that is one of servos and this bus has only steppers.

    Beside servos on a bus of their own, steppers get what they would get alone.
    """
    has_servos = any(isinstance(motor, ServoMotor) for motor in motors(config) if motor.bus == bus)
    if has_servos or chosen not in ("stop-here", "smooth"):
        return chosen
    return step_profile(config, simulated)


def streamed_as(config: MachineConfig, bus: int, chosen: Profile, simulated: bool) -> Profile:
    """What the stream of a bus makes of a profile: that of its servos, beside which steppers are led ``adaptive``.

    One of a kind that the bus has none of leaves those that it has at their default.
    """
    here = profile_of_bus(config, bus, chosen, simulated)
    if any(isinstance(motor, ServoMotor) for motor in motors(config) if motor.bus == bus):
        return "smooth" if here == "smooth" else "stop-here"
    return here if here in ("adaptive", "exact") else "group"


def profiles_used(config: MachineConfig, wanted: str, simulated: bool) -> dict[str, str]:
    """The profile that feeds each bus with motors, by its name. Raises ValueError as ``choose_profile``."""
    chosen = choose_profile(config, wanted, simulated)
    driven = {motor.bus for motor in motors(config)}
    return {
        name: streamed_as(config, number, chosen, simulated)
        for number, name in enumerate(nmc_buses(config))
        if number in driven
    }


def step_profile(config: MachineConfig, simulated: bool) -> Profile:
    """What is taken for steppers: ``adaptive`` if their timers do what the twins of the stream do, ``exact`` if not.

    Of a port the simulated machine tells nothing, and where nothing is known ``group`` is taken.
    """
    known: set[tuple[str, str]]
    if simulated:
        known = {(config.sim.count_latch, config.sim.first_step)}
    else:
        known = {_measured(table) for _, table in motor_tables(config).values()}
    if any("immediate" in latch_and_first for latch_and_first in known):
        return "exact"
    return "adaptive" if all(latch == "rollover" for latch, _ in known) else "group"


def _measured(table: StepMotorTable) -> tuple[str, str]:
    """``count_latch`` and ``first_step``, unless they were measured on the twin."""
    if table.probed is not None and table.probed.measured_on.startswith(TWIN):
        return "unknown", "unknown"
    return table.count_latch, table.first_step


def why_not_streamed(config: MachineConfig) -> str:
    """Why this machine cannot be streamed to by this version, in words; empty if it can."""
    if not motors(config):
        return "programs need at least one axis on an NMC bus"
    divided = [name for name, (_, table) in servo_tables(config).items() if table.servo.servo_rate_divisor != 1]
    if divided:
        return f"motor {', '.join(divided)}: programs need servo_rate_divisor = 1"
    if cy545_tables(config) and len({motor.bus for motor in motors(config)}) > 1:
        return "axes on CY545s beside motors on several buses: programs can move either, not both"
    return ""
