"""The door to a real port and to the wall clock: the only file that imports ``serial`` and ``time``.

Waiting is done by the operating system (select and sleep), never by spinning. USB adapters add up to their latency
timer to every answer; on Linux the low-latency flag is asked for and its absence is no error.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import termios
import time  # noqa: TID251 - this is the door
from collections.abc import Sequence

import serial  # noqa: TID251 - this is the door

from nmc.chips.common import DEFAULT_BAUD
from nmc.errors import NmcError

WRITE_PATIENCE_S = 1.0


class DescriptorLink:
    """An open serial port by its file descriptor, at the rate it has, and the monotonic clock."""

    def __init__(self, descriptor: int, name: str = "port") -> None:
        self.descriptor = descriptor
        self.name = name

    def now_ns(self) -> int:
        """The monotonic clock; the same in all processes of a machine."""
        return time.monotonic_ns()

    def write(self, data: bytes) -> None:
        """Hand the bytes to the driver, waiting while its buffer is full."""
        try:
            while data:
                if not select.select([], [self.descriptor], [], WRITE_PATIENCE_S)[1]:
                    raise NmcError(f"{self.name}: the driver takes no more bytes")
                data = data[os.write(self.descriptor, data) :]
        except OSError as error:
            raise NmcError(f"{self.name}: {error}") from None

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Wait for ``count`` bytes, at most until ``deadline_ns``."""
        data = b""
        try:
            while len(data) < count:
                left_ns = deadline_ns - time.monotonic_ns()
                ready, _, _ = select.select([self.descriptor], [], [], max(0, left_ns) / 1e9)
                if not ready:
                    break
                part = os.read(self.descriptor, count - len(data))
                if not part:
                    raise NmcError(f"{self.name}: the port is gone")
                data += part
        except OSError as error:
            raise NmcError(f"{self.name}: {error}") from None
        return data

    def receive(self, count: int) -> bytes:
        """What the driver has already, at most ``count`` bytes."""
        return self.read(count, 0) if count else b""

    @property
    def root(self) -> DescriptorLink:
        """A port waits for itself."""
        return self

    @property
    def patience_ns(self) -> int:
        """Nobody is impatient."""
        return 0

    def wait_first(self, wanted: Sequence[tuple[DescriptorLink, int]], until_ns: int) -> None:
        """Wait until a byte has come on one of the ports, at most until ``until_ns``: one select over all of them."""
        left_ns = until_ns - time.monotonic_ns()
        # A port that is gone is found by whoever reads it: there it can be named.
        with contextlib.suppress(OSError):
            select.select([link.descriptor for link, _ in wanted], [], [], max(0, left_ns) / 1e9)

    def sleep_until(self, time_ns: int) -> None:
        """Sleep; returns at once if the time is past."""
        while (left_ns := time_ns - time.monotonic_ns()) > 0:
            time.sleep(left_ns / 1e9)

    def set_baud(self, baud: int) -> None:
        """The rate belongs to whoever opened the port; a descriptor keeps it."""

    def flush_input(self) -> None:
        """Drop what nobody has read."""
        try:
            termios.tcflush(self.descriptor, termios.TCIFLUSH)
        except (OSError, termios.error) as error:
            raise NmcError(f"{self.name}: {error}") from None

    def close(self) -> None:
        """Nothing: whoever opened the port closes it."""


class SerialLink(DescriptorLink):
    """A serial port, 8 data bits, no parity, 1 stop bit, and the monotonic clock. POSIX only.

    Raises NmcError if the port cannot be opened, or when it vanishes.
    """

    def __init__(self, port: str, baud: int = DEFAULT_BAUD) -> None:
        try:
            self._port = serial.Serial(port, baud, timeout=0, write_timeout=1.0, exclusive=True)
        except (serial.SerialException, ValueError, OSError) as error:
            raise NmcError(f"cannot open {port}: {_why(error)}") from None
        super().__init__(self._port.fileno(), port)
        with contextlib.suppress(Exception):  # a pty and many drivers have no such flag
            self._port.set_low_latency_mode(True)

    def set_baud(self, baud: int) -> None:
        """Let what was written leave at the old rate, then change it."""
        if baud == self._port.baudrate:
            return
        try:
            self._port.flush()
            self._port.baudrate = baud
        except (serial.SerialException, ValueError, OSError) as error:
            raise NmcError(f"{self.name}: cannot run at {baud} baud: {error}") from None

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def _why(error: Exception) -> str:
    """What the system says, once: pyserial puts port and number in front of it, and again."""
    number = error.errno if isinstance(error, OSError) else None
    if number == errno.EAGAIN:
        return "another program has it open"
    return os.strerror(number) if number else str(error)
