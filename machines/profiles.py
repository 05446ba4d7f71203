"""Which profile feeds the chips: the one asked for, or what is known of them decides.

``adaptive`` needs to know when a timer count that is loaded while the motor runs takes effect. On the twin ``[sim]``
says it; on a port only what was measured on that module and written into its axis counts (``count_latch``).
"""

from __future__ import annotations

from machines.schema import MachineConfig
from machines.wiring import motor_tables, servo_tables

STEP_PROFILES = ("group", "adaptive")


def choose_profile(config: MachineConfig, wanted: str, simulated: bool) -> str:
    """The profile to stream with. Raises ValueError for one that PIC-STEP axes do not offer."""
    if wanted != "auto":
        if wanted not in STEP_PROFILES:
            raise ValueError(f"profile {wanted} is not offered for PIC-STEP axes; offered: {', '.join(STEP_PROFILES)}")
        return wanted
    latches = (
        {config.sim.count_latch} if simulated else {table.count_latch for _, table in motor_tables(config).values()}
    )
    return "adaptive" if latches == {"rollover"} else "group"


def why_not_streamed(config: MachineConfig) -> str:
    """Why this machine cannot be streamed to by this version, in words; empty if it can."""
    others = [name for name, table in config.axis.items() if table.chip == "cy545"]
    if others:
        return f"axis {', '.join(others)}: programs cannot move a CY545 axis yet"
    servos = servo_tables(config)
    if servos:
        return f"motor {', '.join(servos)}: programs cannot move PIC-SERVO axes yet"
    buses = {table.bus for _, table in motor_tables(config).values()}
    if len(buses) > 1:
        return f"motors on several buses ({', '.join(sorted(buses))}): programs can move those of one bus so far"
    return ""
