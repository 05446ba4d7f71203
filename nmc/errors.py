"""The three things that can go wrong on a bus, told apart by whose fault they are.

LocalFault: we asked for something the data sheet forbids; no byte has left. RemoteFault: a module answered, and what
it says is bad. LinkTimeout: nobody answered in time.
"""

from __future__ import annotations


class NmcError(Exception):
    """Base of all bus errors. ``address`` is the module's or group's, -1 if none is meant; ``bus``: of several."""

    def __init__(self, words: str, *, address: int = -1) -> None:
        super().__init__(words)
        self.address = address
        self.bus = ""

    def __str__(self) -> str:
        places = [f"bus {self.bus}"] if self.bus else []
        places += [f"module {self.address}"] if self.address >= 0 else []
        return f"{', '.join(places)}: {self.args[0]}" if places else str(self.args[0])


class LocalFault(NmcError):  # noqa: N818 - the three are called faults throughout
    """An illegal command was refused before a byte left. ``rule``: data sheet and section that forbid it."""

    def __init__(self, words: str, *, address: int = -1, rule: str = "") -> None:
        super().__init__(f"{words} ({rule})" if rule else words, address=address)
        self.rule = rule


class RemoteFault(NmcError):  # noqa: N818
    """A module's answer is damaged or tells of a fault.

    status: its status byte, None if it could not be read. executed: whether the command took effect; None: unknown.
    """

    def __init__(
        self, words: str, *, address: int = -1, status: int | None = None, executed: bool | None = None
    ) -> None:
        super().__init__(words, address=address)
        self.status = status
        self.executed = executed


class LinkTimeout(NmcError):  # noqa: N818
    """No whole answer came in time. ``received``: the bytes that did."""

    def __init__(self, words: str, *, address: int = -1, received: bytes = b"") -> None:
        super().__init__(words, address=address)
        self.received = received
