"""The door to a real port and to the wall clock: the only file that imports ``serial`` and ``time``.

Waiting is done by the operating system (select and sleep), never by spinning. USB adapters add up to their latency
timer to every answer; on Linux the low-latency flag is asked for and its absence is no error.
"""

from __future__ import annotations

import contextlib
import os
import select
import time  # noqa: TID251 - this is the door

import serial  # noqa: TID251 - this is the door

from nmc.chips.common import DEFAULT_BAUD
from nmc.errors import NmcError


class SerialLink:
    """A serial port, 8 data bits, no parity, 1 stop bit, and the monotonic clock. POSIX only.

    Raises NmcError if the port cannot be opened, or when it vanishes.
    """

    def __init__(self, port: str, baud: int = DEFAULT_BAUD) -> None:
        try:
            self._port = serial.Serial(port, baud, timeout=0, write_timeout=1.0, exclusive=True)
        except (serial.SerialException, ValueError, OSError) as error:
            raise NmcError(f"cannot open {port}: {error}") from None
        self.name = port
        self._descriptor = self._port.fileno()
        with contextlib.suppress(Exception):  # a pty and many drivers have no such flag
            self._port.set_low_latency_mode(True)

    def now_ns(self) -> int:
        """The monotonic clock."""
        return time.monotonic_ns()

    def write(self, data: bytes) -> None:
        """Hand the bytes to the driver."""
        try:
            self._port.write(data)
        except (serial.SerialException, OSError) as error:
            raise NmcError(f"{self.name}: {error}") from None

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Wait for ``count`` bytes, at most until ``deadline_ns``."""
        data = b""
        try:
            while len(data) < count:
                left_ns = deadline_ns - time.monotonic_ns()
                ready, _, _ = select.select([self._descriptor], [], [], max(0, left_ns) / 1e9)
                if not ready:
                    break
                part = os.read(self._descriptor, count - len(data))
                if not part:
                    raise NmcError(f"{self.name}: the port is gone")
                data += part
        except OSError as error:
            raise NmcError(f"{self.name}: {error}") from None
        return data

    def sleep_until(self, time_ns: int) -> None:
        """Sleep; returns at once if the time is past."""
        while (left_ns := time_ns - time.monotonic_ns()) > 0:
            time.sleep(left_ns / 1e9)

    def set_baud(self, baud: int) -> None:
        """Let what was written leave at the old rate, then change it."""
        if baud == self._port.baudrate:
            return
        try:
            self._port.flush()
            self._port.baudrate = baud
        except (serial.SerialException, ValueError, OSError) as error:
            raise NmcError(f"{self.name}: cannot run at {baud} baud: {error}") from None

    def flush_input(self) -> None:
        """Drop what nobody has read."""
        try:
            self._port.reset_input_buffer()
        except (serial.SerialException, OSError) as error:
            raise NmcError(f"{self.name}: {error}") from None

    def close(self) -> None:
        """Close the port."""
        self._port.close()
