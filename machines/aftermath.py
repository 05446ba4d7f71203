"""After a stop that failed: what is true of the motors, where watchdogs may have taken the buses and stopped them.

A host that hung finds its writes refused: nothing can be asked any more, but the watchdog that refuses them hears from
every motor whether it stands, and says so. A bus that no watchdog took is the host's own to stop.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from machines.bringup import Connection, supervised
from machines.wiring import nmc_buses
from nmc.errors import NmcError
from nmc.executor import stop_all

if TYPE_CHECKING:
    from nmc.watchdog_process import SupervisedLink

WITHIN_NS = 3_000_000_000
"""So long a watchdog is given to hear from everybody."""
POLL_NS = 10_000_000
MAY_MOVE = "MOTORS MAY STILL BE MOVING, use the emergency stop"


def told_of(connection: Connection, error: NmcError) -> str:
    """What is to be told after a stop of everything has failed with ``error``. Waits while watchdogs are at it."""
    guards = [supervised(link) for link in connection.links]
    if not any(guard is not None and guard.fenced for guard in guards):
        return f"{MAY_MOVE}: {error}"
    names = list(nmc_buses(connection.config))
    taken: dict[str, SupervisedLink] = {}
    doubts: list[str] = []
    for name, bus, guard in zip(names, connection.buses, guards, strict=True):
        if guard is None or not guard.fenced:
            try:
                stop_all(bus)
                continue
            except NmcError as again:
                if guard is None or not guard.fenced:  # else it was taken just now
                    doubts.append(str(again))
                    continue
        taken[name] = guard
    _wait(connection, list(taken.values()))
    doubts += [
        f"the watchdog holds {'the bus' if len(names) == 1 else f'bus {name}'}, and not every motor has told it yet "
        "that it stands"
        for name, guard in taken.items()
        if not guard.motors_stand
    ]
    if doubts:
        return f"{MAY_MOVE}: {'; '.join(doubts)}"
    stopped = "every motor" if len(taken) == len(names) else f"bus {', '.join(taken)}, and every other motor stands"
    words = f"the watchdog has stopped {stopped}; where they stand is not known"
    return words if all(guard.standing for guard in taken.values()) else f"{words}; SPINDLE OR OUTPUTS MAY STILL BE ON"


def _wait(connection: Connection, guards: list[SupervisedLink]) -> None:
    """Until every one of these watchdogs is done, or has had its time."""
    clock = connection.links[0]
    until_ns = clock.now_ns() + WITHIN_NS
    while not all(guard.standing for guard in guards) and clock.now_ns() < until_ns:
        clock.sleep_until(clock.now_ns() + POLL_NS)
