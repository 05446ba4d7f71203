"""Which profile feeds the chips: the one asked for, or what is known of them decides.

``adaptive`` needs to know when a timer count that is loaded while the motor runs takes effect. On the twin ``[sim]``
says it; on a port only what was measured on that module and written into its axis counts (``count_latch``).
PIC-SERVO axes get ``smooth`` (velocity and acceleration a slice) on the twin, whose host keeps its time; on a port they
get Stop Here points, which leave the axis standing when the host dies, unless ``smooth`` is asked for.
"""

from __future__ import annotations

from typing import cast

from machines.cy545 import cy545_tables
from machines.schema import TWIN, MachineConfig
from machines.wiring import motor_tables, motors, servo_tables
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
    if wanted != "auto":
        return cast("Profile", wanted)
    if servos:
        return "smooth" if simulated else "stop-here"
    return "adaptive" if _timers_known(config, simulated) else "group"


def profile_of_bus(config: MachineConfig, bus: int, chosen: Profile, simulated: bool) -> Profile:
    """The profile of one of several buses: the machine's, unless that is one of servos and this bus has only steppers.

    Beside servos on a bus of their own, steppers get what they would get alone.
    """
    has_servos = any(isinstance(motor, ServoMotor) for motor in motors(config) if motor.bus == bus)
    if has_servos or chosen not in ("stop-here", "smooth"):
        return chosen
    return "adaptive" if _timers_known(config, simulated) else "group"


def _timers_known(config: MachineConfig, simulated: bool) -> bool:
    """Whether every step timer is known to do what the twins of the stream do. Of a port the twin tells nothing."""
    if simulated:
        return config.sim.count_latch == "rollover" and config.sim.first_step == "period"
    return all(
        table.count_latch == "rollover"
        and table.first_step != "immediate"
        and (table.probed is None or not table.probed.measured_on.startswith(TWIN))
        for _, table in motor_tables(config).values()
    )


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
