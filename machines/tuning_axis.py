"""``tune`` of one motor of a machine: its bench with the gains of the file, and the gains that are written back."""

from __future__ import annotations

from collections.abc import Callable

from machines.bringup import Connection, bus_of
from machines.commission import Asker, StopRequested, never
from machines.gains import gains_of
from machines.probing import table_of
from machines.schema import MachineConfig
from machines.servobench import ServoBench
from machines.tomledit import set_values
from machines.tuning import Attempt, Tuned, Tuner
from machines.wiring import servo_tables
from nmc.picservo import Gains, PicServo


def tune_motor(
    connection: Connection,
    motor: str,
    *,
    step: int,
    room: int,
    stop_requested: StopRequested = never,
    tell: Callable[[Attempt], None] = lambda attempt: None,
) -> Tuned:
    """Search the gains of one motor; step, room: counts. Raises UndecidedError, and what ``at_work`` expects."""
    table = servo_tables(connection.config)[motor][1]
    bus = bus_of(connection, table.bus)
    bench = ServoBench(PicServo(bus, table.address), gains_of(table), room, Asker(bus, stop_requested))
    return Tuner(bench, step, tell).tune()


def with_gains(text: str, config: MachineConfig, motor: str, gains: Gains) -> str:
    """The text of the machine file with new gains of a motor. Raises ValueError where it cannot be changed safely."""
    return set_values(
        text,
        (*table_of(config, motor), "servo"),
        {
            "kp": gains.position_gain,
            "kd": gains.velocity_gain,
            "ki": gains.integral_gain,
            "integration_limit": gains.integration_limit,
        },
    )
