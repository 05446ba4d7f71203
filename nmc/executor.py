"""Plays a stream of exchanges on a bus, and stops everything."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from nmc.bus import Bus
from nmc.chips import picservo, picstep
from nmc.chips.common import DEFINE_STATUS, NOP, STOP_MOTOR
from nmc.errors import NmcError, RemoteFault
from nmc.modes import Tracker
from nmc.program import Evidence, Exchange, ExchangeSource

STREAMING_GROUP = 0x81
PARKED_GROUP = 0x82
STOP_ROUNDS_MAX = 50


def play(bus: Bus | Sequence[Bus], source: ExchangeSource) -> Iterator[Evidence]:
    """Pull exchanges from ``source`` and send each at its time; one Evidence an exchange.

    Several buses share one clock and one stream; ``Exchange.bus`` chooses. A bus error leaves the generator as it is:
    the caller then stops the machine (``stop_all``).
    """
    buses = [bus] if isinstance(bus, Bus) else list(bus)
    clock = buses[0].link
    evidence: Evidence | None = None
    while True:
        exchange = source.next(clock.now_ns(), evidence)
        if exchange is None:
            return
        evidence = buses[exchange.bus].exchange(exchange)
        yield evidence


def stop_all(
    bus: Bus,
    groups: Sequence[int] = (STREAMING_GROUP, PARKED_GROUP),
    *,
    amplifier: bool = True,
    rounds: int = STOP_ROUNDS_MAX,
) -> int:
    """Stop every motor of the bus abruptly: both groups first, then each address until it has said that it stands.

    A PIC-STEP stands when its moving bit is clear. A PIC-SERVO's move_done is set at constant velocity as well, so it
    stands when it has answered a Stop Motor of its own. Lost answers are asked for again; a module whose answers have
    an unexpected length is told again what its status packets are to carry. ``amplifier``: level of AMP_EN afterwards.
    Returns the number of rounds; raises RemoteFault naming the modules that could not be stopped.
    """
    stop = bytes([picstep.STOP_ABRUPTLY | (picstep.STOP_AMP_ENABLE if amplifier else 0)])
    bus.stop_groups(groups, stop)
    left = [module for module in bus.guard.modules.values() if _has_motor(module)]
    for turn in range(1, rounds + 1):
        attempts = 1 if turn == 1 else None  # one that is gone must not hold up the others
        left = [module for module in left if not _stands(bus, module, stop, attempts)]
        if not left:
            return turn
    names = ", ".join(str(module.address) for module in left)
    raise RemoteFault(f"could not be stopped: module {names}", address=left[0].address)


def _has_motor(module: Tracker) -> bool:
    return module.facts.name in (picstep.FACTS.name, picservo.FACTS.name)


def _stands(bus: Bus, module: Tracker, stop: bytes, attempts: int | None) -> bool:
    stopped = _try(bus, Exchange(module.address, STOP_MOTOR, stop), attempts)
    if stopped is None or stopped.status is None:
        # Noise that looked like a Define Status may have changed the length of its answers.
        _try(bus, Exchange(module.address, DEFINE_STATUS, bytes([module.mask or 0])), attempts)
        return False
    if module.facts.name != picstep.FACTS.name:
        return True
    # A PIC-STEP replies before it executes: only the next answer shows the stop.
    after = _try(bus, Exchange(module.address, NOP), attempts)
    return after is not None and after.status is not None and not after.status & picstep.STATUS_MOVING


def _try(bus: Bus, exchange: Exchange, attempts: int | None) -> Evidence | None:
    try:
        return bus.exchange(exchange, attempts=attempts)
    except NmcError:
        return None
