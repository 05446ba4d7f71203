"""One module on a bus, by the names of its data sheet: what PIC-STEP, PIC-SERVO and PIC-I/O have in common."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from nmc.bus import Bus
from nmc.chips.common import GROUP_MIN, MEMBER_BIT, ChipFacts
from nmc.codec import Status, decode_status, encode
from nmc.errors import LocalFault, RemoteFault
from nmc.program import Exchange


@dataclass(frozen=True, slots=True)
class HomeFound:
    """Outcome of a search for home: the captured position and where the motor came to rest, in steps or counts."""

    home_position: int
    rest_position: int


class Module:
    """Commands that every NMC module has (PIC-STEP data sheet section 5.1, PIC-SERVO section 5.2).

    Every method sends one command and returns the status packet in words. All raise LocalFault before an illegal
    command leaves, RemoteFault on a bad answer, LinkTimeout on none.
    """

    facts: ChipFacts

    def __init__(self, bus: Bus, address: int) -> None:
        self.bus = bus
        self.address = address

    def send(self, name: str, values: dict[str, int] | None = None, *, endless: bool = False) -> Status:
        """Encode and send a command by its name; decode the answer."""
        command, data = encode(self.facts, name, values)
        asked = (values or {}).get("items") if name in ("define_status", "read_status") else None
        evidence = self.bus.exchange(Exchange(self.address, command, data, endless=endless))
        mask = self._mask() if asked is None else asked
        return decode_status(self.facts, evidence.status or 0, mask, evidence.extra)

    def _mask(self) -> int:
        tracker = self.bus.guard.modules.get(self.address)
        return 0 if tracker is None or tracker.mask is None else tracker.mask

    def item_mask(self, names: Iterable[str]) -> int:
        """Mask of status items by name, as in ``("position", "inputs")``. Raises LocalFault for an unknown name."""
        bits = {item.name: 1 << item.bit for item in self.facts.status_items}
        mask = 0
        for name in names:
            if name not in bits:
                raise LocalFault(f"{self.facts.name} has no status item {name!r}; it has {', '.join(bits)}")
            mask |= bits[name]
        return mask

    def set_address(self, individual: int, group: int, *, leader: bool = False) -> Status:
        """New individual address and group 128..255; at most one leader a group."""
        if not GROUP_MIN <= group <= 0xFF:
            raise LocalFault(f"group address {group} is outside 128..255", address=self.address, rule="section 3.3")
        group_byte = group & ~MEMBER_BIT if leader else group
        status = self.send("set_address", {"individual": individual, "group_byte": group_byte})
        self.address = individual
        return status

    def define_status(self, *items: str) -> Status:
        """Items that every later status packet carries, by name; none: the status byte alone."""
        return self.send("define_status", {"items": self.item_mask(items)})

    def read_status(self, *items: str) -> Status:
        """Items of this one answer, by name."""
        return self.send("read_status", {"items": self.item_mask(items)})

    def read(self, item: str) -> int:
        """One status item."""
        return self.read_status(item).values[item]

    def type_version(self) -> tuple[int, int]:
        """Device type and version."""
        values = self.read_status("type_version").values
        return values["type"], values["version"]

    def no_operation(self) -> Status:
        """Only the answer."""
        return self.send("no_operation")

    def hard_reset(self) -> None:
        """Back to power-up state; nobody answers. Refused inside a chain, where it would silence the modules behind."""
        self.send("hard_reset")

    def poll(self, interval_ns: int) -> Status:
        """No Operation, sent ``interval_ns`` from now."""
        send_at_ns = self.bus.link.now_ns() + interval_ns
        command, data = encode(self.facts, "no_operation")
        evidence = self.bus.exchange(Exchange(self.address, command, data, send_at_ns=send_at_ns))
        return decode_status(self.facts, evidence.status or 0, self._mask(), evidence.extra)

    def give_up(self, words: str, status: Status | None = None) -> RemoteFault:
        """A fault of this module, for a wait that has ended badly."""
        return RemoteFault(words, address=self.address, status=None if status is None else status.byte)
