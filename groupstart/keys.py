"""Keys of a running program: hold, resume, feed and rapid override, stop.

The terminal gives each key at once (cbreak mode; Ctrl-C stays a signal) from entering to leaving this context, and is
put back as it was however that is left. Keys are read between two exchanges and never waited for.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from types import TracebackType

from machines.control import Control, RateStatus, Request

HELP = "space hold/resume, +/- feed, </> rapids, 0 all 100 %, q stop"
STEP_PERCENT = 10.0
PAUSE_S = 0.05
_CHUNK = 64


class Keys(Control):
    """A ``Control`` whose requests come from a terminal. descriptor: of the terminal, standard input if not given.

    show: told of every change. Where the descriptor is no terminal there are no keys; the methods ask.
    """

    def __init__(self, descriptor: int | None = None, show: Callable[[RateStatus], None] | None = None) -> None:
        super().__init__()
        self._show = show
        self._descriptor = _standard_input() if descriptor is None else descriptor
        self._before: list[object] | None = None
        self._feed = self._rapid = 100.0
        self._held = False

    @property
    def listening(self) -> bool:
        """Keys are being read."""
        return self._before is not None

    def __enter__(self) -> Keys:
        if self._descriptor >= 0 and os.isatty(self._descriptor) and _in_foreground(self._descriptor):
            self._before = termios.tcgetattr(self._descriptor)
            tty.setcbreak(self._descriptor, termios.TCSANOW)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._restore()

    @contextlib.contextmanager
    def aside(self) -> Iterator[None]:
        """The terminal as it was, while somebody is asked something."""
        listening = self.listening
        self._restore()
        try:
            yield
        finally:
            if listening:
                self.__enter__()

    def take(self, time_s: float) -> Request | None:
        """The next request; reads what has been typed since."""
        self._read(0.0)
        return super().take(time_s)

    def told(self, status: RateStatus) -> None:
        """How the run stands: what a key means next depends on it."""
        super().told(status)
        self._held = status.state != "running"
        if self._show is not None:
            self._show(status)

    def pause(self) -> None:
        """The twin is held: wait for a key, a moment at most."""
        self._read(PAUSE_S)

    def press(self, key: str) -> None:
        """What a key asks for; other keys ask for nothing."""
        if key in " hr":
            self._hold_or_resume(key)
        elif key in "+=-_":
            self._feed = self._changed(self._feed, key in "+=", 200.0)
            self.feed(self._feed)
        elif key in "<>,.":
            self._rapid = self._changed(self._rapid, key in ">.", 100.0)
            self.rapid(self._rapid)
        elif key == "0":
            self._feed = self._rapid = 100.0
            self.feed(100.0)
            self.rapid(100.0)
        elif key == "q":
            self.stop()

    def _hold_or_resume(self, key: str) -> None:
        if key == "h" or (key == " " and not self._held):
            self._held = True
            self.hold()
        else:
            self._held = False
            self.resume()

    @staticmethod
    def _changed(percent: float, up: bool, most: float) -> float:
        return min(max(percent + (STEP_PERCENT if up else -STEP_PERCENT), STEP_PERCENT), most)

    def _read(self, patience_s: float) -> None:
        if not self.listening:
            return
        try:
            ready = select.select([self._descriptor], [], [], patience_s)[0]
            if not ready or not _in_foreground(self._descriptor):
                return
            typed = os.read(self._descriptor, _CHUNK)
        except OSError:  # the terminal has gone; the program runs on as one without keys
            typed = b""
        if not typed:
            self._before = None
            return
        for key in typed.decode("latin-1"):
            self.press(key)

    def _restore(self) -> None:
        before, self._before = self._before, None
        if before is not None:
            with contextlib.suppress(OSError, termios.error):
                termios.tcsetattr(self._descriptor, termios.TCSADRAIN, before)  # type: ignore[arg-type]


def _in_foreground(descriptor: int) -> bool:
    """Whether this process may use the terminal: one in the background would be stopped by it, motors and all."""
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:
        return True  # it is not the terminal that controls this process


def _standard_input() -> int:
    """Descriptor of standard input; -1 where there is none."""
    try:
        return sys.stdin.fileno()
    except (OSError, ValueError, AttributeError):
        return -1
