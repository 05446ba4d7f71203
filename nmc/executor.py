"""Plays a stream of exchanges on a bus, or one a bus on several at once, and stops everything."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence

from nmc.bus import Bus
from nmc.chips import picservo, picstep
from nmc.chips.common import DEFINE_STATUS, READ_STATUS, STOP_MOTOR
from nmc.errors import NmcError, RemoteFault
from nmc.modes import Tracker
from nmc.program import Evidence, Exchange, ExchangeSource
from nmc.talk import Talk
from nmc.together import Together

STREAMING_GROUP = 0x81
PARKED_GROUP = 0x82
STOP_ROUNDS_MAX = 50


def play(bus: Bus | Sequence[Bus], source: ExchangeSource) -> Generator[Evidence, None, None]:
    """Pull exchanges from ``source`` and send each at its time; one Evidence an exchange.

    Of several buses, which share one clock, ``Exchange.bus`` chooses; one exchange is under way at a time
    (``play_together``: one a bus). A bus error leaves the generator as it is: the caller then stops the machine
    (``stop_all``).
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


def play_together(buses: Sequence[Bus], sources: Mapping[int, ExchangeSource]) -> Generator[Evidence, None, None]:
    """Play a source a bus, by number, all at once with one command in flight on each; Evidence as it comes.

    The next exchange of a bus is asked for when its evidence has been looked at; ``Exchange.bus`` is not. Between two
    evidences the commands of the other buses may be in flight: close the generator before the motors are stopped.
    Whatever ends it, an error of one bus or being closed, it leaves each bus when its answer is in, or overdue.
    Raises ValueError for links that cannot be waited on together.
    """
    together = Together[Evidence](buses)
    clock = buses[0].link

    def ask(number: int, told: Evidence | None) -> None:
        exchange = sources[number].next(clock.now_ns(), told)
        if exchange is not None:
            together.begin(number, buses[number].talk(exchange))

    with together:
        for number in sources:
            ask(number, None)
        while together.talking:
            number, said = together.finish_one()
            yield said
            ask(number, said)


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
    return bus.carry_out(_stop_all(bus, groups, amplifier, rounds))


def stop_together(buses: Sequence[Bus], *, amplifier: bool = True, rounds: int = STOP_ROUNDS_MAX) -> int:
    """``stop_all`` on every bus at the same time: what is wrong with one holds up none of the others.

    Returns the most rounds that one took. Raises NmcError, once every bus has been dealt with, naming those of which
    modules could not be stopped.
    """
    if len(buses) == 1:
        return stop_all(buses[0], amplifier=amplifier, rounds=rounds)
    for bus in buses:
        if bus.clear is not None:
            bus.clear()
    together = Together[int](buses)
    for number, bus in enumerate(buses):
        together.begin(number, _stop_all(bus, (STREAMING_GROUP, PARKED_GROUP), amplifier, rounds))
    most = 0
    failed: list[NmcError] = []
    while together.talking:
        try:
            most = max(most, together.finish_one()[1])
        except NmcError as error:
            failed.append(error)
    if failed:
        raise NmcError("; ".join(str(error) for error in failed)) from failed[0]
    return most


def _stop_all(bus: Bus, groups: Sequence[int], amplifier: bool, rounds: int) -> Talk[int]:
    stop = bytes([picstep.STOP_ABRUPTLY | (picstep.STOP_AMP_ENABLE if amplifier else 0)])
    yield from bus.stop_groups(groups, stop)
    left = [module for module in bus.guard.modules.values() if has_motor(module)]
    for turn in range(1, rounds + 1):
        attempts = 1 if turn == 1 else None  # one that is gone must not hold up the others
        moving = []
        for module in left:
            if not (yield from _stands(bus, module, stop, attempts)):
                moving.append(module)
        left = moving
        if not left:
            return turn
    names = ", ".join(str(module.address) for module in left)
    raise RemoteFault(f"could not be stopped: module {names}", address=left[0].address)


def has_motor(module: Tracker) -> bool:
    """Whether a module moves an axis, so that a stop of the motion is for it."""
    return module.moves_axis and module.facts.name in (picstep.FACTS.name, picservo.FACTS.name)


def _stands(bus: Bus, module: Tracker, stop: bytes, attempts: int | None) -> Talk[bool]:
    stopped = yield from _try(bus, Exchange(module.address, STOP_MOTOR, stop), attempts)
    if stopped is None or stopped.status is None:
        # Noise that looked like a Define Status may have changed the length of its answers.
        yield from _try(bus, Exchange(module.address, DEFINE_STATUS, bytes([module.mask or 0])), attempts)
        return False
    if module.facts.name != picstep.FACTS.name:
        return True
    # A PIC-STEP replies before it executes: only the next answer shows the stop. Read Status raises no armed fault: a
    # motor that has lost its power stands as well.
    after = yield from _try(bus, Exchange(module.address, READ_STATUS, b"\x00"), attempts)
    return after is not None and after.status is not None and not after.status & picstep.STATUS_MOVING


def _try(bus: Bus, exchange: Exchange, attempts: int | None) -> Talk[Evidence | None]:
    try:
        return (yield from bus.talk(exchange, attempts=attempts))
    except NmcError:
        return None
