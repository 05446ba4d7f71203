"""Who is on the bus: finds the rate at which modules answer and says what each of them is.

A network that is already addressed is read without being disturbed; only if nobody answers at any rate, or if asked
to, the start-up procedure gives out addresses (PIC-STEP data sheet section 3.4).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from nmc.bus import Bus
from nmc.chips.common import BAUD_DIVISORS, DEFAULT_BAUD, MODULES_MAX, READ_STATUS
from nmc.codec import Status, decode_status
from nmc.errors import LinkTimeout, NmcError, RemoteFault
from nmc.program import Exchange
from nmc.setup import CHIPS, ITEM_TYPE_VERSION, identify, reset_network

SEARCH_ORDER = (DEFAULT_BAUD, 115_200, 57_600, 9_600)


@dataclass(frozen=True, slots=True)
class Found:
    """One module: where it is, what it says it is, all its status items in words."""

    address: int
    device_type: int
    version: int
    chip: str
    status: Status

    def text(self) -> str:
        """One line for people."""
        flags = ", ".join(sorted(self.status.flags)) or "no flag"
        values = self.status.values
        items = ", ".join(
            f"{name} {value}" for name, value in values.items() if "." not in name and name not in ("type", "version")
        )
        return f"{self.address:3d}  {self.chip} (type {self.device_type}) version {self.version}: {flags}; {items}"

    def as_json(self) -> dict[str, object]:
        """The same for programs."""
        return {
            "address": self.address,
            "type": self.device_type,
            "version": self.version,
            "chip": self.chip,
            "status": self.status.byte,
            "flags": sorted(self.status.flags),
            "items": dict(self.status.values),
        }


@dataclass(frozen=True, slots=True)
class ScanResult:
    """The rate at which modules were found, and the modules in order of address."""

    baud: int
    modules: tuple[Found, ...]


def find_baud(bus: Bus, rates: Sequence[int] = SEARCH_ORDER, addresses: Iterable[int] = (0, 1)) -> int | None:
    """First of ``rates`` at which a module answers at one of ``addresses``; the host is left at that rate.

    Address 0 answers after power-up, address 1 once addresses are given out. None if nobody answers anywhere; the host
    is then back at 19200. What modules at another rate make of the question is noise to them; nulls end it.
    """
    for baud in rates:
        if baud not in BAUD_DIVISORS:
            continue
        bus.set_host_baud(baud)
        bus.resync()
        for address in addresses:
            if _identity(bus, address) is not None:
                return baud
    bus.set_host_baud(DEFAULT_BAUD)
    return None


def scan(bus: Bus, *, reset: bool = False, at_most: int = MODULES_MAX) -> ScanResult:
    """Find rate and modules. Raises LinkTimeout if nobody answers at any rate.

    reset: put the whole network back to power-up state first. Modules that still have address 0 are given addresses;
    an addressed network is only read.
    """
    bus.guard.forget_all()
    if reset:
        reset_network(bus)
    baud = find_baud(bus)
    if baud is None:
        raise LinkTimeout("nobody answers at " + ", ".join(str(rate) for rate in SEARCH_ORDER) + " baud")
    if _identity(bus, 0) is not None:
        if _identity(bus, 1) is not None:
            # Half of the chain has addresses: giving out more would make two modules share one.
            reset_network(bus)
        baud = DEFAULT_BAUD
        identify(bus, at_most)
    found = []
    for address in range(1, at_most + 1):
        identity = _identity(bus, address)
        if identity is None:
            break
        found.append(_describe(bus, address, *identity))
    return ScanResult(baud, tuple(found))


def _identity(bus: Bus, address: int) -> tuple[int, int] | None:
    """Type and version at an address, None if nobody gives a clear answer."""
    try:
        answer = bus.exchange(Exchange(address, READ_STATUS, bytes([ITEM_TYPE_VERSION]), reply_extra=2))
    except (LinkTimeout, RemoteFault):
        return None
    return answer.extra[0], answer.extra[1]


def _describe(bus: Bus, address: int, device_type: int, version: int) -> Found:
    facts = CHIPS.get(device_type)
    if facts is None:
        return Found(address, device_type, version, f"type {device_type}", Status(0, frozenset(), {}))
    mask = 0x3F
    try:
        exchange = Exchange(address, READ_STATUS, bytes([mask]), reply_extra=facts.status_bytes[mask])
        answer = bus.exchange(exchange)
    except NmcError:
        return Found(address, device_type, version, facts.name, Status(0, frozenset({"no whole status"}), {}))
    status = decode_status(facts, answer.status or 0, mask, answer.extra)
    return Found(address, device_type, version, facts.name, status)
