"""Taking over a network that an earlier session has left ready: nothing is reset, so the counters still hold.

Whoever homed a machine, or jogged it to its work zero, must find it there with the next command. A network is taken
over only if every module answers at the working rate under its own address, is of the expected type, rests, and has its
amplifier on: an amplifier that was off may have let its axis move unseen.
"""

from __future__ import annotations

from collections.abc import Sequence

from nmc.bus import Bus
from nmc.chips import picservo, picstep
from nmc.chips.common import READ_STATUS
from nmc.errors import LinkTimeout, RemoteFault
from nmc.program import Exchange
from nmc.setup import CHIPS, ITEM_TYPE_VERSION, ModuleExpectation, ModuleInfo, assign_groups, make_tracker

_READY: dict[str, tuple[int, int]] = {
    picstep.FACTS.name: (picstep.STATUS_MOVING, picstep.STATUS_AMP_ENABLED | picstep.STATUS_POWER),
    picservo.FACTS.name: (picservo.STATUS_POSITION_ERROR, picservo.STATUS_MOVE_DONE | picservo.STATUS_POWER_ON),
}
"""Status bits that must be clear, and that must be set."""


def found_ready(bus: Bus, expected: Sequence[ModuleExpectation], baud: int) -> bool:
    """Whether this network can be taken over. Disturbs nothing: it only asks."""
    bus.guard.forget_all()
    bus.set_host_baud(baud)
    bus.resync()
    try:
        return all(_is_ready(bus, address, module) for address, module in enumerate(expected, start=1))
    except (LinkTimeout, RemoteFault):
        return False


def take_over(bus: Bus, expected: Sequence[ModuleExpectation]) -> list[ModuleInfo]:
    """Guard the modules of a network that ``found_ready`` has found, and park them all."""
    found = [_identity(bus, address) for address in range(1, len(expected) + 1)]
    for info, module in zip(found, expected, strict=True):
        bus.guard.enrol(make_tracker(info))
        bus.guard.modules[info.address].moves_axis = module.moves
    assign_groups(bus, expected)
    return found


def _identity(bus: Bus, address: int) -> ModuleInfo:
    exchange = Exchange(address, READ_STATUS, bytes([ITEM_TYPE_VERSION]), reply_extra=2)
    answer = bus.exchange(exchange)
    device_type, version = answer.extra
    facts = CHIPS.get(device_type)
    return ModuleInfo(address, device_type, version, facts.name if facts else "unknown", answer.status or 0)


def _is_ready(bus: Bus, address: int, module: ModuleExpectation) -> bool:
    found = _identity(bus, address)
    clear, needed = _READY.get(found.chip, (0, 0)) if module.moves else (0, 0)
    return found.chip == module.chip and not found.status & clear and found.status & needed == needed
