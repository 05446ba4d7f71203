"""A machine at work for commissioning: brought up, watched, and stopped whatever happens.

The verbs that measure a machine move it by a few steps with commands of their own. They do that inside ``at_work``:
the network is up, the watchdogs of ports are armed, and whatever ends the work, every motor is stopped first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from machines import bringup
from machines.bringup import Connection
from machines.diagnosis import explained
from machines.schema import MachineConfig
from machines.session import Session, SessionError
from nmc.bus import Bus
from nmc.errors import NmcError
from nmc.program import Evidence, Exchange

StopRequested = Callable[[], bool]


class StoppedError(Exception):
    """A stop was asked for; ``at_work`` has stopped every motor."""


class UndecidedError(Exception):
    """What was to be measured could not be: in words for whoever stands at the machine."""


def never() -> bool:
    """No stop is ever asked for."""
    return False


@contextmanager
def at_work(config: MachineConfig, port: str | None = None, seed: int | None = None) -> Iterator[Connection]:
    """The machine, ready, parked and watched.

    Raises SessionError where it does not start, or for whatever the bus reports inside; StoppedError and UndecidedError
    pass through. Every motor has been stopped before the exception is seen.
    """
    with Session(config, port=port, seed=seed) as session:
        session.connect()
        bringup.park(session.connection)
        with bringup.armed(session.connection):
            try:
                yield session.connection
            except NmcError as error:
                positions = _stopped(session, error)
                raise SessionError(explained(session.connection, error), positions) from error
            except ValueError as error:
                raise SessionError(str(error), _stopped(session, error)) from error
            except BaseException:
                session.stop()
                raise


def _stopped(session: Session, error: Exception) -> dict[str, int]:
    """Stop everything after ``error``. Raises SessionError with both in words if that fails too."""
    try:
        return session.stop()
    except SessionError as second:
        raise SessionError(f"{second} (after: {error})") from error


class Asker:
    """Exchanges one by one, with a look at the stop request before each. Raises StoppedError where it is set."""

    def __init__(self, bus: Bus, stop_requested: StopRequested = never) -> None:
        self.bus = bus
        self._stop_requested = stop_requested

    @property
    def now_ns(self) -> int:
        """Time of the link."""
        return self.bus.link.now_ns()

    def exchange(self, exchange: Exchange) -> Evidence:
        """Send one exchange."""
        if self._stop_requested():
            raise StoppedError("stopped on request")
        return self.bus.exchange(exchange)


def unguarded(connection: Connection, bus: Bus) -> Bus:
    """The same line without the guard: for questions to a chip that the guard would refuse to send."""
    free = Bus(bus.link, grace_ns=bus.grace_ns, host_latency_ns=bus.host_latency_ns)
    free.set_host_baud(bus.baud)
    return free
