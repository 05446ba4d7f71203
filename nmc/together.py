"""Several buses carried on at once by one host: one command in flight on each, and one wait for all of them.

    bus 0   [load X]....<ok>[load Y]....<ok>       [start]...
    bus 1      [load Z]....<ok>      [load A]....<ok>
    host    write write  read  write ...                          never blocked by one bus while another has news

All links must be of one kind and one clock (``nmc.link.SharedLink``): ports of one computer, or one simulated world.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from functools import partial
from types import TracebackType
from typing import Generic, TypeVar, cast

from nmc.bus import Bus
from nmc.errors import NmcError
from nmc.link import SharedLink
from nmc.talk import Talk, Wait

T = TypeVar("T")


class _Open(Generic[T]):
    """A talk under way, what it waits for, and the bytes that have come so far."""

    def __init__(self, talk: Talk[T], wait: Wait, link: SharedLink) -> None:
        self.talk, self.wait, self.link = talk, wait, link
        self.data = b""

    @property
    def missing(self) -> int:
        """Bytes that it still waits for."""
        return self.wait.count - len(self.data)

    def ready(self) -> bool:
        """Take what has come in; True once the wait is over. Raises NmcError if the port is gone."""
        self.data += self.link.receive(self.missing)
        return (self.wait.count > 0 and not self.missing) or self.link.now_ns() >= self.wait.until_ns

    def step(self) -> None:
        """Go on after a wait that is over. Raises StopIteration with the value at the end, or what the talk raises."""
        data, self.data = self.data, b""
        self.wait = self.talk.send(data)


class Together(Generic[T]):
    """Talks on several buses. As a context: leaving it gives up every talk that is still under way (``leave``).

    Somebody else's exchange on one of the buses meanwhile lets the answer that is out come in first; what waits to be
    sent waits on.

    Raises ValueError for links that cannot be waited on together.
    """

    def __init__(self, buses: Sequence[Bus]) -> None:
        missing = [bus.link for bus in buses if not hasattr(bus.link, "receive")]
        if missing:
            raise ValueError(f"{type(missing[0]).__name__} cannot be waited on together with other links")
        self._buses = list(buses)
        self._links = [cast("SharedLink", bus.link) for bus in buses]
        self._open: dict[int, _Open[T]] = {}
        self._ended: deque[tuple[int, T | NmcError]] = deque()

    @property
    def talking(self) -> bool:
        """A talk is under way, or has ended and not been told."""
        return bool(self._open or self._ended)

    def begin(self, number: int, talk: Talk[T]) -> None:
        """Begin a talk on a bus; at most one a bus is under way. What goes wrong at once, ``finish_one`` tells."""
        if number in self._open:
            raise ValueError(f"a command is in flight on bus {number}")
        try:
            self._open[number] = _Open(talk, next(talk), self._links[number])
        except StopIteration as end:
            self._ended.append((number, end.value))
        except NmcError as error:
            self._fail(number, error)

    def finish_one(self) -> tuple[int, T]:
        """Let time pass until a talk has ended; its bus and value. Raises NmcError where a talk does."""
        while True:
            self._carry_on()
            if self._ended:
                number, value = self._ended.popleft()
                if isinstance(value, NmcError):
                    raise value
                return number, value
            self._wait()

    def _carry_on(self) -> None:
        """Go on with every talk whose wait is over, oldest first."""
        moved = True
        while moved:
            moved = False
            for number, talk in list(self._open.items()):
                try:
                    if talk.ready():
                        moved = True
                        talk.step()
                except StopIteration as end:
                    del self._open[number]
                    self._ended.append((number, end.value))
                except NmcError as error:
                    self._drop(number)
                    self._fail(number, error)
                except BaseException:
                    del self._open[number]
                    raise

    def _wait(self) -> None:
        """Until something may have come, or a time has. Links that have nothing to say show that their host lives."""
        until_ns = min(talk.wait.until_ns for talk in self._open.values())
        for link in self._links:
            link.receive(0)
            if link.patience_ns:
                until_ns = min(until_ns, link.now_ns() + link.patience_ns)
        wanted = [(talk.link.root, talk.missing) for talk in self._open.values() if talk.missing]
        self._links[0].root.wait_first(wanted, until_ns)

    def leave(self) -> None:
        """Give up every talk: unsent commands are dropped, answers that are out are awaited as long as they may take.

        A talk whose answer does not come leaves its modules unsure. Never raises NmcError.
        """
        self._ended.clear()
        for number, talk in list(self._open.items()):
            if talk.wait.leave_ns:
                talk.wait = Wait(min(talk.wait.leave_ns, talk.wait.until_ns), talk.wait.count)
            else:
                self._drop(number)
        while self._open:
            for number, talk in list(self._open.items()):
                try:
                    if talk.ready():
                        if not talk.missing:
                            talk.step()
                        self._drop(number)
                except (StopIteration, NmcError):
                    self._drop(number)
            if self._open:
                self._wait()

    def _fail(self, number: int, error: NmcError) -> None:
        error.bus = self._buses[number].name
        self._ended.append((number, error))

    def _drop(self, number: int) -> None:
        self._open.pop(number).talk.close()

    def _clear(self, number: int) -> None:
        """Go on until the line of this bus is silent."""
        while number in self._open and self._open[number].wait.leave_ns:
            self._wait()
            self._carry_on()

    def __enter__(self) -> Together[T]:
        for number, bus in enumerate(self._buses):
            bus.clear = partial(self._clear, number)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.leave()
        finally:
            for bus in self._buses:
                bus.clear = None
