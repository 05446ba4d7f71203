"""The watchdog on a port: a child process that holds the same open port and takes over when its host dies or hangs.

    host process                              child process
    SupervisedLink --- bytes --> port <-- (only after expiry) --- patrol
          |                                        ^
          +- heartbeat, armed, fenced, ... in shared words --+

The heartbeat is a time in shared memory, written at every call of the link, and by ``beat`` between two bounded pieces
of a longer reckoning: never by a thread of its own, for a host that hangs has to be noticed. Fencing is exact: the host
looks at the fence and hands its bytes over under one lock, and the child takes that lock before it raises the fence. A
killed host loses its lock; a host that hangs inside a write is waited for ``LOCK_PATIENCE_NS`` only.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import mmap
import os
import select
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence

from nmc.chips.common import DEFAULT_BAUD
from nmc.errors import NmcError
from nmc.serial_link import DescriptorLink, SerialLink
from nmc.watchdog import DEFAULT_TIMEOUT_NS, Phase, Switch, Ward, Watchdog, patrol

PERIOD_NS = 2_000_000
"""How often the child looks; also the longest sleep of the host between two heartbeats is five of these."""
LOCK_PATIENCE_NS = 20_000_000
PORT_LATENCY_NS = 20_000_000
"""An answer over a USB adapter may come this late (16 ms latency timer)."""
WORDS_BYTES = 40
_BEAT, _ARMED, _FENCED, _MOTORS_STAND, _STANDING = range(5)


class SharedWords:
    """64-bit words between two processes, and a lock that a dead process loses.

    A word is aligned and copied as one machine word, so the other process never sees half of it. (``struct`` would
    clear it first: a child that looks just then sees a heartbeat of the year zero and stops a healthy machine.)
    """

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self._memory = mmap.mmap(descriptor, WORDS_BYTES)
        self._words = memoryview(self._memory).cast("q")

    def get(self, word: int) -> int:
        """One word, read whole."""
        return self._words[word]

    def put(self, word: int, value: int) -> None:
        """Write one word, whole."""
        self._words[word] = value

    @contextlib.contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the lock; waits for it."""
        fcntl.lockf(self.descriptor, fcntl.LOCK_EX)
        try:
            yield
        finally:
            fcntl.lockf(self.descriptor, fcntl.LOCK_UN)

    def try_lock(self) -> bool:
        """Take the lock if it is free."""
        try:
            fcntl.lockf(self.descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True

    def unlock(self) -> None:
        """Give the lock back."""
        fcntl.lockf(self.descriptor, fcntl.LOCK_UN)

    def close(self) -> None:
        """Forget the memory."""
        self._words.release()
        self._memory.close()


class SupervisedLink:
    """A serial port whose host is watched by a child process from ``arm`` to ``disarm``.

    Raises NmcError on every write once the watchdog has taken over, and if the watchdog itself has died while armed.
    ``wards`` and ``groups`` are what ``Watchdog`` wants; call ``watch`` when the network is up.
    """

    def __init__(self, port: str, baud: int = DEFAULT_BAUD) -> None:
        self._link = SerialLink(port, baud)
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the link
        self._file.truncate(WORDS_BYTES)
        self._words = SharedWords(self._file.fileno())
        self._child: subprocess.Popen[bytes] | None = None
        self._armed = False

    def watch(
        self,
        wards: Sequence[Ward],
        groups: Sequence[int],
        *,
        baud: int,
        timeout_ns: int = DEFAULT_TIMEOUT_NS,
        switches: Sequence[Switch] = (),
    ) -> None:
        """Start the child process; it knows from here on what to stop and to switch off.

        Raises NmcError if it does not come up.
        """
        self._end_child()
        port = self._link.descriptor
        task = {
            "port": port,
            "words": self._words.descriptor,
            "wards": [[ward.address, ward.chip] for ward in wards],
            "groups": list(groups),
            "switches": [[switch.address, switch.packet.hex()] for switch in switches],
            "baud": baud,
            "timeout_ns": timeout_ns,
        }
        self._child = subprocess.Popen(
            [sys.executable, "-c", "from nmc.watchdog_process import main; main()", json.dumps(task)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(port, self._words.descriptor),
            start_new_session=True,  # Ctrl-C of the terminal is the host's business
        )
        assert self._child.stdout is not None
        if self._child.stdout.readline().strip() != b"ready":
            raise NmcError("the watchdog process did not come up")

    def arm(self) -> None:
        """Motion is about to begin. Raises NmcError without a living watchdog."""
        if not self.watchdog_alive():
            raise NmcError("there is no watchdog process")
        self._words.put(_BEAT, self._link.now_ns())
        self._words.put(_ARMED, 1)
        self._armed = True

    def disarm(self) -> None:
        """Nothing moves any more."""
        self._words.put(_ARMED, 0)
        self._armed = False

    def watchdog_alive(self) -> bool:
        """Whether the child process runs."""
        return self._child is not None and self._child.poll() is None

    @property
    def watchdog_pid(self) -> int:
        """Process number of the child; 0 without one."""
        return 0 if self._child is None else self._child.pid

    @property
    def fenced(self) -> bool:
        """The watchdog has taken the bus."""
        return bool(self._words.get(_FENCED))

    @property
    def motors_stand(self) -> bool:
        """The watchdog has taken the bus and every motor has said that it stands."""
        return bool(self._words.get(_MOTORS_STAND))

    @property
    def standing(self) -> bool:
        """The watchdog has taken the bus, every motor has said that it stands, and what it switches off is off."""
        return bool(self._words.get(_STANDING))

    def now_ns(self) -> int:
        """The monotonic clock."""
        return self._link.now_ns()

    def beat(self) -> None:
        """The host lives: it has come to the end of a bounded piece of work."""
        if self._armed:
            self._words.put(_BEAT, self._link.now_ns())

    def write(self, data: bytes) -> None:
        """Hand bytes over, unless the watchdog holds the bus."""
        if self._armed and not self.watchdog_alive():
            raise NmcError("the watchdog process has died; stop the machine")
        with self._words.locked():
            if self.fenced:
                raise NmcError("the watchdog has stopped the machine and holds the bus")
            self.beat()
            self._link.write(data)

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Wait for bytes; waiting is being alive."""
        data = b""
        while True:
            self.beat()
            step_ns = min(deadline_ns, self._link.now_ns() + 5 * PERIOD_NS)
            data += self._link.read(count - len(data), step_ns)
            if len(data) >= count or self._link.now_ns() >= deadline_ns:
                return data

    def receive(self, count: int) -> bytes:
        """Take what is in; looking is being alive."""
        self.beat()
        return self._link.receive(count)

    @property
    def root(self) -> DescriptorLink:
        """The port."""
        return self._link

    @property
    def patience_ns(self) -> int:
        """As ``read`` and ``sleep_until`` beat."""
        return 5 * PERIOD_NS

    def sleep_until(self, time_ns: int) -> None:
        """Sleep; sleeping here is being alive."""
        while (now := self._link.now_ns()) < time_ns:
            self.beat()
            self._link.sleep_until(min(time_ns, now + 5 * PERIOD_NS))

    def set_baud(self, baud: int) -> None:
        """Change the host's rate."""
        self._link.set_baud(baud)

    def flush_input(self) -> None:
        """Drop unread bytes."""
        self._link.flush_input()

    def close(self) -> None:
        """End the child and close the port."""
        self._end_child()
        self._link.close()
        self._words.close()
        self._file.close()

    def _end_child(self) -> None:
        if self._child is not None:
            assert self._child.stdin is not None
            assert self._child.stdout is not None
            self._child.stdin.close()
            self._child.wait()
            self._child.stdout.close()
            self._child = None


def main() -> None:
    """Body of the child: look at the heartbeat until the host ends in order, or until the machine stands."""
    task = json.loads(sys.argv[1])
    link = DescriptorLink(task["port"])
    words = SharedWords(task["words"])
    wards = [Ward(address, chip) for address, chip in task["wards"]]
    switches = [Switch(address, bytes.fromhex(packet)) for address, packet in task["switches"]]
    timing = {"baud": task["baud"], "timeout_ns": task["timeout_ns"], "latency_ns": PORT_LATENCY_NS}
    dog = Watchdog(wards, task["groups"], switches=switches, **timing)
    print("ready", flush=True)
    if _watch(dog, link, words):
        _fence(link, words)
        patrol(dog, link, told=lambda: words.put(_MOTORS_STAND, dog.motors_stand))
        words.put(_STANDING, 1)
        while select.select([sys.stdin], [], [], None)[0] and os.read(sys.stdin.fileno(), 1):
            pass


def _watch(dog: Watchdog, link: DescriptorLink, words: SharedWords) -> bool:
    """True when the watchdog has expired, False when the host has ended in order."""
    while True:
        ended, _, _ = select.select([sys.stdin], [], [], PERIOD_NS / 1e9)
        now_ns = link.now_ns()
        if not words.get(_ARMED):
            dog.disarm()
            if ended:
                return False
            continue
        if dog.phase is Phase.IDLE:
            dog.arm(now_ns)
        if ended:
            dog.trip(now_ns)  # the host is gone: its end of the pipe is closed
        elif words.get(_BEAT) + dog.reaction_ns <= now_ns:
            dog.trip(now_ns)
        if dog.fenced:
            return True


def _fence(link: DescriptorLink, words: SharedWords) -> None:
    """Shut the host out, after a write that it is in the middle of."""
    patience_ns = link.now_ns() + LOCK_PATIENCE_NS
    held = words.try_lock()
    while not held and link.now_ns() < patience_ns:
        link.sleep_until(link.now_ns() + 200_000)
        held = words.try_lock()
    words.put(_FENCED, 1)
    if held:
        words.unlock()
