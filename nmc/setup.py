"""Start-up of an NMC network: the nine steps of PIC-STEP data sheet section 3.4, checked one by one.

Address 1 is the module farthest from the host (section 3.2). If the network does not answer as after power-up (an
earlier session left it addressed, or at another rate) it is reset at every rate and the steps are run again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from nmc.bus import Bus
from nmc.chips import picio, picservo, picstep
from nmc.chips.common import (
    BAUD_DIVISORS,
    DEFAULT_ADDRESS,
    DEFAULT_BAUD,
    DEFAULT_GROUP,
    HARD_RESET,
    MEMBER_BIT,
    MODULES_MAX,
    NOP,
    READ_STATUS,
    SET_ADDRESS,
    ChipFacts,
)
from nmc.errors import LinkTimeout, LocalFault, RemoteFault
from nmc.executor import PARKED_GROUP, STREAMING_GROUP
from nmc.modes import StepTracker, Tracker
from nmc.program import Exchange
from nmc.servo_modes import ServoTracker

ITEM_TYPE_VERSION = picstep.ITEM_TYPE_VERSION
RESCUE_ADDRESS = 200
ANSWER_NS = 5_000_000
CHIPS: dict[int, ChipFacts] = {facts.device_type: facts for facts in (picstep.FACTS, picservo.FACTS, picio.FACTS)}


@dataclass(frozen=True, slots=True)
class ModuleExpectation:
    """One module of a machine, in chain order: the first is the farthest from the host.

    chip: "pic-step", "pic-servo" or "pic-io". version: None accepts any. group: group address after start-up;
    None: parked, a PIC-I/O in no group of ours (a group Stop Motor would be Set Synch Output to it).
    leader: True, False, or None: lead if nobody before it in this group does. moves: it moves an axis; a module that
    does not is in no group of ours and may be found in any state.
    """

    chip: str
    version: int | None = None
    group: int | None = None
    leader: bool | None = None
    name: str = ""
    moves: bool = True


@dataclass(frozen=True, slots=True)
class ModuleInfo:
    """A module that was found: its address, what it says it is, and the status byte of its last answer."""

    address: int
    device_type: int
    version: int
    chip: str
    status: int
    group: int = DEFAULT_GROUP
    leader: bool = False


def start_up(
    bus: Bus,
    expected: Sequence[ModuleExpectation],
    baud: int = 115_200,
    *,
    reached_stop_is_stopped: bool = True,
    recover: bool = True,
) -> list[ModuleInfo]:
    """Bring the network from power-up to its working baud rate and groups; every module is then guarded.

    Raises RemoteFault if number, types or versions differ from ``expected``, LinkTimeout if a module is silent at the
    new rate. ``recover``: on a mismatch reset the network at all rates and try again, at last the hard way.
    """
    if len(expected) > MODULES_MAX:
        raise LocalFault(f"at most {MODULES_MAX} modules on one network", rule="section 1")
    found = _find(bus, expected, recover)
    for info in found:
        bus.guard.enrol(make_tracker(info, reached_stop_is_stopped=reached_stop_is_stopped))
    if baud != DEFAULT_BAUD and found:
        bus.set_baud(baud)  # steps 6 and 7
    for info, module in zip(found, expected, strict=True):
        bus.guard.modules[info.address].moves_axis = module.moves
    answers = [bus.exchange(Exchange(info.address, NOP)).status or 0 for info in found]  # step 8
    assign_groups(bus, expected)  # step 9
    trackers = bus.guard.modules
    return [
        ModuleInfo(
            i.address, i.device_type, i.version, i.chip, s, trackers[i.address].group, trackers[i.address].leader
        )
        for i, s in zip(found, answers, strict=True)
    ]


def _find(bus: Bus, expected: Sequence[ModuleExpectation], recover: bool) -> list[ModuleInfo]:
    """Steps 1 to 5 and the comparison, with up to two recoveries in between."""
    remedies: list[Callable[[], None]] = []
    if recover:
        remedies = [partial(reset_network, bus), partial(rescue_network, bus, len(expected) + 1)]
    for remedy in remedies:
        try:
            return _identify_expected(bus, expected)
        except (RemoteFault, LinkTimeout):
            remedy()
    return _identify_expected(bus, expected)


def _identify_expected(bus: Bus, expected: Sequence[ModuleExpectation]) -> list[ModuleInfo]:
    found = identify(bus, len(expected) + 1)
    _compare(found, expected)
    return found


def identify(bus: Bus, at_most: int = MODULES_MAX) -> list[ModuleInfo]:
    """Steps 1 to 5: addresses 1, 2, 3 ... along the chain, then type and version of each. Nothing is guarded yet."""
    bus.guard.forget_all()
    bus.set_host_baud(DEFAULT_BAUD)  # step 1
    bus.resync()  # step 2
    count = 0
    while count < min(at_most, MODULES_MAX):  # steps 3 and 4
        data = bytes([count + 1, DEFAULT_GROUP])
        try:
            bus.exchange(Exchange(DEFAULT_ADDRESS, SET_ADDRESS, data))
        except LinkTimeout as silence:
            if silence.received:
                raise
            break
        count += 1
    found = []
    for address in range(1, count + 1):  # step 5
        answer = bus.exchange(Exchange(address, READ_STATUS, bytes([ITEM_TYPE_VERSION]), reply_extra=2))
        device_type, version = answer.extra
        facts = CHIPS.get(device_type)
        name = facts.name if facts else f"type {device_type}"
        found.append(ModuleInfo(address, device_type, version, name, answer.status or 0))
    return found


def make_tracker(info: ModuleInfo, *, reached_stop_is_stopped: bool = True) -> Tracker:
    """The tracker of a module that has just been reset. Raises RemoteFault for an unknown type."""
    tracker: Tracker
    if info.device_type == picstep.DEVICE_TYPE:
        tracker = StepTracker(info.address, reached_stop_is_stopped=reached_stop_is_stopped)
    elif info.device_type == picservo.DEVICE_TYPE:
        tracker = ServoTracker(info.address)
    elif info.device_type == picio.DEVICE_TYPE:
        tracker = Tracker(info.address, picio.FACTS)
    else:
        raise RemoteFault(f"unknown device type {info.device_type}", address=info.address)
    tracker.version = info.version
    return tracker


def assign_groups(bus: Bus, expected: Sequence[ModuleExpectation]) -> None:
    """Step 9: group addresses and leaders. Raises LocalFault for a second leader in a group."""
    motors = [(address, module) for address, module in enumerate(expected, start=1) if _group(module) != DEFAULT_GROUP]
    led: set[int] = {_group(module) for _, module in motors if module.leader}
    for address, module in motors:
        leads = bool(module.leader)
        if module.leader is None and _group(module) not in led:
            leads = True
            led.add(_group(module))
        set_group(bus, address, _group(module), leader=leads)


def _group(module: ModuleExpectation) -> int:
    if module.group is not None:
        return module.group
    return DEFAULT_GROUP if module.chip == picio.FACTS.name or not module.moves else PARKED_GROUP


def set_group(bus: Bus, address: int, group: int, *, leader: bool = False) -> None:
    """Put one module into a group (section 3.3); its individual address stays."""
    group_byte = group & ~MEMBER_BIT if leader else group | MEMBER_BIT
    bus.exchange(Exchange(address, SET_ADDRESS, bytes([address, group_byte])))


def change_baud(bus: Bus, baud: int, divisor: int | None = None) -> None:
    """Another rate for a network that is up: all groups are given up for the moment (section 5.1, Set Baud Rate).

    Raises LinkTimeout if a module is silent at the new rate.
    """
    before = [(module.address, module.group, module.leader) for module in bus.guard.modules.values()]
    for address, _, _ in before:
        set_group(bus, address, DEFAULT_GROUP)
    bus.set_baud(baud, divisor)
    for address, _, _ in before:
        bus.exchange(Exchange(address, NOP))
    for address, group, leader in before:
        set_group(bus, address, group, leader=leader)


def reset_network(bus: Bus, groups: Sequence[int] = (STREAMING_GROUP, PARKED_GROUP, DEFAULT_GROUP)) -> None:
    """Hard Reset of everything, whatever rate and groups an earlier session has left.

    A PIC-STEP obeys a Hard Reset to 0xFF always, a PIC-SERVO only in its own group (section 5.1), so every individual
    address is reset first, the highest first: a module that is reset raises ADDR_OUT and makes those behind it deaf
    (section 3.2), and addresses grow towards the host.
    """
    _reset_at_all_rates(bus, (*range(MODULES_MAX, -1, -1), *groups))


def rescue_network(bus: Bus, modules: int) -> None:
    """The hard way back to power-up state, for a chain in which deaf modules keep old addresses and rates.

    Module k can be deaf only while module k - 1 has its ADDR_OUT high. So the chain is opened from its far end: in
    pass k everybody but the first k modules is reset at every rate and address, module k, which hears all of that,
    is then at address 0 and is given an address out of the way, which opens module k + 1. Further modules that happen
    to hear may take the same address; that does no harm, for in the end all of them hear, at 19200 baud and in group
    0xFF, one last Hard Reset. Takes about 4 s a module.
    """
    kept: list[int] = []
    for _ in range(modules):
        _reset_at_all_rates(bus, [address for address in range(DEFAULT_GROUP) if address not in kept])
        kept.append(RESCUE_ADDRESS + len(kept))
        bus.resync()
        bus.exchange(Exchange(DEFAULT_ADDRESS, SET_ADDRESS, bytes([kept[-1], DEFAULT_GROUP]), reply_extra=None))
        bus.link.sleep_until(bus.link.now_ns() + ANSWER_NS)  # one answer, or several on top of each other
    bus.resync()
    bus.exchange(Exchange(DEFAULT_GROUP, HARD_RESET, reply_extra=None))


def _reset_at_all_rates(bus: Bus, addresses: Sequence[int]) -> None:
    for baud in sorted(BAUD_DIVISORS, reverse=True):
        bus.guard.forget_all()
        bus.set_host_baud(baud)
        bus.resync()
        for address in addresses:
            bus.exchange(Exchange(address, HARD_RESET, reply_extra=None))
    bus.guard.forget_all()
    bus.set_host_baud(DEFAULT_BAUD)


def _compare(found: Sequence[ModuleInfo], expected: Sequence[ModuleExpectation]) -> None:
    if len(found) != len(expected):
        more = "at least " if len(found) > len(expected) else ""
        raise RemoteFault(f"{more}{len(found)} modules on the bus, {len(expected)} expected")
    for info, wanted in zip(found, expected, strict=True):
        if info.chip != wanted.chip:
            raise RemoteFault(f"it is a {info.chip}, a {wanted.chip} was expected", address=info.address)
        if wanted.version is not None and info.version != wanted.version:
            raise RemoteFault(
                f"it is a {info.chip} version {info.version}, version {wanted.version} was expected",
                address=info.address,
            )
