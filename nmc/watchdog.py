"""A host that dies must not leave a machine running: the watchdog as a state machine without a clock of its own.

    WATCHING --(armed, no heartbeat for timeout_ns)--> SETTLING --> STOPPING --(everybody stands)--> STANDING
                                                       nulls        groups, then each address, again and again

From the moment of expiry it is *fenced*: the host must not send any more, even if it comes back to life. The nulls end
a packet that the host left half sent (PIC-STEP data sheet section 3.4, step 2): with its checksum replaced by zero the
module rejects it, except when zero happens to be right, about one time in 256; then one load or one address change of
the host is carried out as if its missing bytes were zero, and the stop follows it within a few milliseconds.

A PIC-STEP replies before it executes, so its stop shows in the answer to the No Operation after it. A PIC-SERVO's
move_done is also set at constant velocity, so it counts as standing once it has answered a Stop Motor of its own.
Replies may have any length (the host's status items are unknown here): what counts is a right checksum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

from nmc.chips import picservo, picstep
from nmc.chips.common import (
    BITS_PER_BYTE,
    NOP,
    NULL,
    REPLY_DELAY_MAX_NS,
    RESYNC_NULLS,
    STATUS_COMM_ERROR,
    STOP_MOTOR,
)
from nmc.errors import NmcError
from nmc.link import Link, Root
from nmc.wire import checksum, pack

REPLY_MAX_BYTES = 16
STOP_BYTES = 5
LEADER_REPLY_BYTES = 2
"""Status and checksum: what the leader of a group answers to a Stop Motor while no status item is defined."""
DEFAULT_TIMEOUT_NS = 50_000_000
OUTBOUND_NS = 500_000
"""What the host may add before its first byte leaves."""
GUARDED_ROUNDS = 1000


class Phase(Enum):
    """What the watchdog is doing."""

    IDLE = "idle"
    WATCHING = "watching"
    SETTLING = "settling"
    STOPPING = "stopping"
    STANDING = "standing"


@dataclass(frozen=True, slots=True)
class Ward:
    """A module that can move. chip: "pic-step" or "pic-servo"."""

    address: int
    chip: str


@dataclass(frozen=True, slots=True)
class Switch:
    """A module with outputs, such as a spindle or a coolant pump, and the packet that switches them off."""

    address: int
    packet: bytes


class Watchdog:
    """Judges heartbeats and, after expiry, says byte by byte what to send. All times are ns of the link's clock.

    groups: group addresses that get a Stop Motor first. switches: what goes off once every ward has been told to stop.
    baud: rate of the bus. amplifier: level of AMP_EN in the stop.
    timeout_ns: from the last heartbeat until the Stop Motor of the last group leaves; the nulls and the stops of the
    other groups are sent so much earlier.
    latency_ns: what operating system and adapter may add to an answer; an answer that is later still could be taken
    for another module's, so this must not be too small. Raises ValueError if the timeout leaves no room for the nulls.
    """

    def __init__(
        self,
        wards: Sequence[Ward],
        groups: Sequence[int],
        *,
        baud: int,
        switches: Sequence[Switch] = (),
        timeout_ns: int = DEFAULT_TIMEOUT_NS,
        amplifier: bool = True,
        latency_ns: int = 2_000_000,
    ) -> None:
        self.wards = tuple(wards)
        self.groups = tuple(groups)
        self.switches = tuple(switches)
        self.timeout_ns = timeout_ns
        self.phase = Phase.IDLE
        self.rounds = 0
        self.expired_ns: int | None = None
        self.listen_until_ns = 0
        self._byte_ns = BITS_PER_BYTE * 1_000_000_000 // baud + 1
        self._latency_ns = latency_ns
        self._between_ns = (STOP_BYTES + LEADER_REPLY_BYTES) * self._byte_ns + REPLY_DELAY_MAX_NS
        self._ahead_ns = self._between_ns * max(len(self.groups) - 1, 0)
        self._settle_ns = (RESYNC_NULLS + REPLY_MAX_BYTES) * self._byte_ns + REPLY_DELAY_MAX_NS + OUTBOUND_NS
        needed_ns = self._settle_ns + self._ahead_ns
        if timeout_ns <= needed_ns:
            raise ValueError(f"{timeout_ns} ns are too short at {baud} baud: nulls and group stops take {needed_ns} ns")
        self._beat_ns = 0
        control = picstep.STOP_ABRUPTLY | (picstep.STOP_AMP_ENABLE if amplifier else 0)
        self._stop = bytes((control,))
        self._left: list[Ward] = []
        self._on: list[Switch] = []
        self._plan: list[tuple[Ward | Switch | None, bytes]] = []
        self._asked: Ward | Switch | None = None
        self._may_stand: set[int] = set()

    @property
    def fenced(self) -> bool:
        """The bus belongs to the watchdog; the host must not send."""
        return self.phase in (Phase.SETTLING, Phase.STOPPING, Phase.STANDING)

    @property
    def motors_stand(self) -> bool:
        """The bus was taken and every ward has said that it stands; outputs may still be on."""
        return self.phase in (Phase.STOPPING, Phase.STANDING) and not self._left

    @property
    def reaction_ns(self) -> int:
        """Silence of the host after which the take-over begins: the timeout less what comes before the last group."""
        return self.timeout_ns - self._settle_ns - self._ahead_ns

    @property
    def due_ns(self) -> int | None:
        """When the watchdog expires if no further heartbeat comes; None while it is not armed."""
        return self._beat_ns + self.reaction_ns if self.phase is Phase.WATCHING else None

    def arm(self, now_ns: int) -> None:
        """Motion is about to begin. A fenced watchdog is not armed again: start the network up first (``reset``)."""
        if not self.fenced:
            self.phase = Phase.WATCHING
            self._beat_ns = now_ns

    def disarm(self) -> None:
        """Nothing moves any more."""
        if self.phase is Phase.WATCHING:
            self.phase = Phase.IDLE

    def reset(self) -> None:
        """Give the bus back to a host that knows what has happened. Raises NmcError while something may still move."""
        if self.phase in (Phase.SETTLING, Phase.STOPPING):
            raise NmcError("the watchdog is still stopping the machine")
        self.phase = Phase.IDLE
        self.expired_ns = None

    def beat(self, now_ns: int) -> None:
        """The host is alive. Too late is too late: after expiry this does nothing."""
        if self.phase is Phase.WATCHING and not self.check(now_ns):
            self._beat_ns = now_ns

    def check(self, now_ns: int) -> bool:
        """Expire if it is time; True once the watchdog is fenced."""
        due_ns = self.due_ns
        if due_ns is not None and now_ns >= due_ns:
            self.trip(now_ns)
        return self.fenced

    def trip(self, now_ns: int) -> None:
        """Expire at once: the host is known to be dead."""
        if not self.fenced:
            self.phase = Phase.SETTLING
            self.expired_ns = now_ns
            self.rounds = 0
            self._left = list(self.wards)
            self._on = list(self.switches)
            self._may_stand.clear()

    def next_bytes(self, now_ns: int) -> bytes:
        """What to send now; listen until ``listen_until_ns``, then tell ``heard``. Empty once everybody stands."""
        if self.phase is Phase.SETTLING:
            data = bytes((NULL,)) * RESYNC_NULLS
            self.listen_until_ns = now_ns + self._settle_ns
            return data
        if self.phase is not Phase.STOPPING:
            return b""
        self._asked, data = self._plan.pop(0)
        if self._asked is None and self._plan and self._plan[0][0] is None:
            # Nobody needs this answer: the next group waits for its time on the wire only, not for the adapter. Axes of
            # one path may be in both groups, and by as much as one stops before the other they leave it.
            self.listen_until_ns = now_ns + self._between_ns
        else:
            self._listen(now_ns, len(data))
        return data

    def _listen(self, now_ns: int, sent_bytes: int) -> None:
        wire_ns = (sent_bytes + REPLY_MAX_BYTES) * self._byte_ns
        self.listen_until_ns = now_ns + wire_ns + REPLY_DELAY_MAX_NS + self._latency_ns

    def heard(self, received: bytes) -> None:
        """What came in answer to the last ``next_bytes``."""
        if self.phase is Phase.SETTLING:
            self.phase = Phase.STOPPING
            self._plan = [(None, pack(group, STOP_MOTOR, self._stop)) for group in self.groups]
            self._next_round()
            return
        if self.phase is not Phase.STOPPING:
            return
        asked = self._asked
        if isinstance(asked, Switch) and _is_good(received):
            self._on = [other for other in self._on if other is not asked]
        elif isinstance(asked, Ward) and self._stands(asked, received):
            self._left = [other for other in self._left if other is not asked]
        if not self._plan:
            self._next_round()

    def _stands(self, ward: Ward, received: bytes) -> bool:
        """Whether this answer proves that the module stands."""
        if not _is_good(received):
            return False
        if ward.address not in self._may_stand:
            self._may_stand.add(ward.address)
            return ward.chip == picservo.FACTS.name
        return not received[0] & picstep.STATUS_MOVING

    def _next_round(self) -> None:
        if not self._left and not self._on and not self._plan:
            self.phase = Phase.STANDING
            return
        self.rounds += 1
        self._may_stand.clear()
        for ward in self._left:
            self._plan.append((ward, pack(ward.address, STOP_MOTOR, self._stop)))
            if ward.chip == picstep.FACTS.name:
                self._plan.append((ward, pack(ward.address, NOP)))
        self._plan += [(switch, switch.packet) for switch in self._on]


def _is_good(received: bytes) -> bool:
    """Whether this is an answer with a right checksum that reports no communications error."""
    return len(received) >= 2 and checksum(received[:-1]) == received[-1] and not received[0] & STATUS_COMM_ERROR


def patrol(
    watchdog: Watchdog, link: Link, *, rounds: int | None = None, told: Callable[[], None] = lambda: None
) -> None:
    """Carry the take-over through on a link: from expiry until everybody stands.

    rounds: give up after so many and raise NmcError (modules that are gone never answer); None: never.
    told: called after every answer, to pass on what is known then.
    """
    while watchdog.fenced and watchdog.phase is not Phase.STANDING:
        if rounds is not None and watchdog.rounds > rounds:
            raise NmcError(f"after {rounds} rounds the watchdog still hears nothing good from every module")
        link.flush_input()
        data = watchdog.next_bytes(link.now_ns())
        link.write(data)
        link.sleep_until(watchdog.listen_until_ns)
        watchdog.heard(link.read(REPLY_MAX_BYTES * 2, link.now_ns()))
        told()


class GuardedLink:
    """A link under a watchdog in virtual time: the second master on the same wire.

    A host that is inside a call is alive; a host that makes no calls while time passes is not. When it comes back
    after expiry it finds the machine stopped and every write refused with NmcError.
    """

    def __init__(self, link: Link, watchdog: Watchdog) -> None:
        self.inner = link
        self.watchdog = watchdog

    def _alive(self) -> None:
        dog = self.watchdog
        dog.beat(self.inner.now_ns())
        if dog.fenced and dog.phase is not Phase.STANDING:
            patrol(dog, self.inner, rounds=GUARDED_ROUNDS)

    def now_ns(self) -> int:
        """Time of the inner link."""
        return self.inner.now_ns()

    def write(self, data: bytes) -> None:
        """Hand on, unless the watchdog has the bus."""
        self._alive()
        if self.watchdog.fenced:
            raise NmcError("the watchdog has stopped the machine and holds the bus")
        self.inner.write(data)

    def read(self, count: int, deadline_ns: int) -> bytes:
        """Waiting for an answer is being alive."""
        self._alive()
        data = self.inner.read(count, deadline_ns)
        self._woken()
        return data

    def receive(self, count: int) -> bytes:
        """Take what is in; looking is being alive."""
        self._alive()
        data: bytes = self.inner.receive(count)  # type: ignore[attr-defined]  # asked for only where it is shared
        return data

    @property
    def root(self) -> Root:
        """That of the inner link."""
        return self.inner.root  # type: ignore[attr-defined,no-any-return]

    @property
    def patience_ns(self) -> int:
        """A host that waits for several links at once must look here in good time."""
        return self.watchdog.reaction_ns // 4

    def sleep_until(self, time_ns: int) -> None:
        """Waiting for an instant is being alive."""
        self._alive()
        self.inner.sleep_until(time_ns)
        self._woken()

    def _woken(self) -> None:
        if self.watchdog.phase is Phase.WATCHING:
            self.watchdog.arm(self.inner.now_ns())

    def set_baud(self, baud: int) -> None:
        """Change the host's rate."""
        self.inner.set_baud(baud)

    def flush_input(self) -> None:
        """Drop unread bytes."""
        self.inner.flush_input()

    def close(self) -> None:
        """Close the inner link."""
        self.inner.close()
