"""The bus: one command in flight, its answer read to the byte, and nothing repeated that must not be.

Replies carry no address, so the only proof of who speaks is the order of things: the next command leaves after the
whole answer to the one before is in (PIC-STEP data sheet section 3.1), and after any doubt the line is brought back to
silence with nulls (section 3.4 step 2) before anything else is sent.

Every rule is written once, as a *talk* (``nmc/talk.py``): steps with waits between them. Alone, a bus waits on its own
link; several buses wait together (``nmc/together.py``), each with one command in flight.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from nmc.chips.common import (
    BAUD_DIVISORS,
    BITS_PER_BYTE,
    DEFAULT_BAUD,
    DEFAULT_GROUP,
    DEFINE_STATUS,
    HARD_RESET,
    NOP,
    NULL,
    PACKET_MAX_BYTES,
    READ_STATUS,
    REPLY_DELAY_MAX_NS,
    RESYNC_NULLS,
    RESYNC_WAIT_NS,
    SET_BAUD,
    SILENT_WAIT_NS,
    STATUS_COMM_ERROR,
    STOP_MOTOR,
    true_baud,
)
from nmc.errors import LinkTimeout, LocalFault, NmcError, RemoteFault
from nmc.guard import Guard
from nmc.link import Link
from nmc.modes import Tracker
from nmc.program import Evidence, Exchange
from nmc.talk import Talk, Wait
from nmc.wire import Reply, pack, unpack_reply

T = TypeVar("T")
ADAPTER_NS = 20_000_000
"""By default a USB adapter keeps an answer back for up to 16 ms: who leaves a bus waits so long for one that is out."""
_STATELESS = (NOP, READ_STATUS, DEFINE_STATUS)


@dataclass(slots=True)
class Counters:
    """What has happened on a bus since it was opened. late: exchanges that left after their ``send_at_ns``.

    expired: exchanges that did not leave at all, because their ``not_after_ns`` had passed.
    """

    packets: int = 0
    bytes_out: int = 0
    bytes_in: int = 0
    retries: int = 0
    timeouts: int = 0
    damaged_replies: int = 0
    rejected_commands: int = 0
    resyncs: int = 0
    late: int = 0
    latest_ns: int = 0
    expired: int = 0


class Bus:
    """One NMC network seen from its host.

    grace_ns: what operating system and adapter may add to an answer beyond the data sheet's time. host_latency_ns:
    what they may add before the first byte leaves (waited out where nobody answers). attempts: how often a repeatable
    command is sent before its failure is reported. name: of one of several buses, for errors.
    """

    def __init__(
        self,
        link: Link,
        *,
        grace_ns: int = 40_000_000,
        host_latency_ns: int = 1_000_000,
        attempts: int = 3,
        name: str = "",
    ) -> None:
        self.link = link
        self.name = name
        self.guard = Guard()
        self.counters = Counters()
        self.grace_ns = grace_ns
        self.host_latency_ns = host_latency_ns
        self.attempts = attempts
        self.clear: Callable[[], None] | None = None
        """Lets a talk that somebody else has under way on this bus come to where the line is silent."""
        self.baud = 0
        self._byte_ns = 0
        self._host_baud(DEFAULT_BAUD)

    def _host_baud(self, baud: int) -> None:
        self.link.set_baud(baud)
        self.baud = baud
        slowest = baud
        if baud in BAUD_DIVISORS:
            slowest = min(baud, int(true_baud(BAUD_DIVISORS[baud])))
        self._byte_ns = -(-BITS_PER_BYTE * 1_000_000_000 // slowest)

    def exchange(self, exchange: Exchange, *, attempts: int | None = None) -> Evidence:
        """Send one command, not before its time, and read its answer. ``attempts``: instead of the bus's own number.

        Raises LocalFault before any byte leaves; RemoteFault if the answer is damaged, tells of a communications error
        or of an armed fault bit; LinkTimeout if no whole answer comes. Repeatable commands are tried again first.
        """
        return self.carry_out(self.talk(exchange, attempts=attempts))

    def carry_out(self, talk: Talk[T]) -> T:
        """Lead a talk to its end, waiting on this bus's own link; what is in flight on it comes to its end before."""
        link = self.link
        if self.clear is not None:
            self.clear()
        try:
            wait = next(talk)
            while True:
                if wait.count:
                    wait = talk.send(link.read(wait.count, wait.until_ns))
                else:
                    link.sleep_until(wait.until_ns)
                    wait = talk.send(b"")
        except StopIteration as end:
            result: T = end.value
            return result
        except NmcError as error:
            error.bus = self.name
            raise

    def talk(self, exchange: Exchange, *, attempts: int | None = None) -> Talk[Evidence]:
        """The steps of ``exchange``; a talk that is closed while its answer is out leaves the modules unsure."""
        guard = self.guard
        guard.check(exchange)
        replier = guard.replier(exchange.address)
        command, data = exchange.command, exchange.data
        if replier is not None:
            if command == STOP_MOTOR and replier.mask is None:
                return (yield from self._stop_blindly(exchange))
            extra_bytes: int | None = replier.reply_extra(command, data)
        elif guard.members(exchange.address):
            extra_bytes = None
        else:
            extra_bytes = exchange.reply_extra
        if command == HARD_RESET:
            extra_bytes = None
        packet = pack(exchange.address, command, data)
        yield from self._wait_for_turn(exchange, replier)
        if extra_bytes is None:
            return (yield from self._send_silent(exchange, packet))
        attempt = 1
        while True:
            sent_ns = self.link.now_ns()
            if self._expired(exchange, sent_ns):
                return Evidence(exchange, sent_ns, sent_ns, None, sent=False)
            try:
                reply = yield from self._once(exchange, packet, extra_bytes)
                break
            except GeneratorExit:
                guard.lost(exchange)
                raise
            except (LinkTimeout, RemoteFault) as error:
                known = guard.repeatable(exchange) if guard.modules else command in _STATELESS
                if not known or attempt >= (self.attempts if attempts is None else attempts):
                    if not (isinstance(error, RemoteFault) and error.executed is False):
                        guard.lost(exchange)
                    raise
                attempt += 1
                self.counters.retries += 1
        evidence = Evidence(exchange, sent_ns, self.link.now_ns(), reply.status, reply.extra)
        guard.settle(exchange, replier, reply.status, reply.extra)
        return evidence

    def _wait_for_turn(self, exchange: Exchange, replier: Tracker | None) -> Talk[None]:
        wanted = exchange.send_at_ns
        now = self.link.now_ns()
        if wanted and now > wanted:
            self.counters.late += 1
            self.counters.latest_ns = max(self.counters.latest_ns, now - wanted)
        if replier is not None:
            interval = replier.facts.command_interval_ns
            if interval:
                wanted = max(wanted, replier.last_sent_ns + interval)
                replier.last_sent_ns = max(now, wanted)
        if wanted > now:
            yield Wait(wanted)

    def _expired(self, exchange: Exchange, now_ns: int) -> bool:
        """The last look at the clock: a host that was held up must not send what may not be safe any more."""
        late = 0 < exchange.not_after_ns < now_ns
        self.counters.expired += late
        return late

    def _once(self, exchange: Exchange, packet: bytes, extra_bytes: int) -> Talk[Reply]:
        link, counters = self.link, self.counters
        link.flush_input()
        link.write(packet)
        counters.packets += 1
        counters.bytes_out += len(packet)
        wanted = extra_bytes + 2
        wire_ns = (len(packet) + wanted) * self._byte_ns
        expected_ns = link.now_ns() + wire_ns + REPLY_DELAY_MAX_NS + self.host_latency_ns
        raw = yield Wait(expected_ns + self.grace_ns, wanted, expected_ns + min(self.grace_ns, ADAPTER_NS))
        counters.bytes_in += len(raw)
        if len(raw) < wanted:
            counters.timeouts += 1
            yield from self._resync(RESYNC_NULLS)
            raise LinkTimeout(
                f"{len(raw)} of {wanted} bytes came in answer to command 0x{exchange.command:X}",
                address=exchange.address,
                received=raw,
            )
        reply = unpack_reply(raw, extra_bytes)
        if reply is None:
            counters.damaged_replies += 1
            yield from self._resync(RESYNC_NULLS)
            raise RemoteFault(f"its answer {raw.hex(' ')} has a wrong checksum", address=exchange.address)
        if reply.status & STATUS_COMM_ERROR:
            # Whoever speaks here may be another module whose address a flipped bit hit: nothing it says counts.
            counters.rejected_commands += 1
            yield from self._resync(RESYNC_NULLS)
            raise RemoteFault(
                f"a module reports a communications error in answer to command 0x{exchange.command:X}",
                address=exchange.address,
                status=reply.status,
                executed=False if exchange.address in self.guard.modules else None,
            )
        return reply

    def _send_silent(self, exchange: Exchange, packet: bytes) -> Talk[Evidence]:
        link = self.link
        link.flush_input()
        sent_ns = link.now_ns()
        if self._expired(exchange, sent_ns):
            return Evidence(exchange, sent_ns, sent_ns, None, sent=False)
        link.write(packet)
        self.counters.packets += 1
        self.counters.bytes_out += len(packet)
        over_ns = sent_ns + len(packet) * self._byte_ns + self.host_latency_ns + SILENT_WAIT_NS
        yield Wait(over_ns, leave_ns=over_ns)
        self.guard.settle(exchange, None, None, b"")
        return Evidence(exchange, sent_ns, link.now_ns(), None)

    def stop_groups(self, groups: Sequence[int], data: bytes) -> Talk[None]:
        """Stop Motor to several groups at once: no late or missing answer of one holds up the stop of the next.

        What was not answered in time leaves the members unsure; their own Stop Motor settles that.
        """
        link = self.link
        silent = True
        for group in groups:
            exchange = Exchange(group, STOP_MOTOR, data)
            replier = self.guard.replier(group)
            packet = pack(group, STOP_MOTOR, data)
            known = replier is not None and replier.mask is not None
            wanted = replier.reply_extra(STOP_MOTOR, data) + 2 if replier is not None and known else PACKET_MAX_BYTES
            link.flush_input()
            link.write(packet)
            self.counters.packets += 1
            self.counters.bytes_out += len(packet)
            wire_ns = (len(packet) + wanted) * self._byte_ns
            raw = yield Wait(link.now_ns() + wire_ns + REPLY_DELAY_MAX_NS + self.host_latency_ns, wanted)
            reply = unpack_reply(raw, wanted - 2) if known else None
            if reply is not None and not reply.status & STATUS_COMM_ERROR:
                self.guard.settle(exchange, replier, reply.status, reply.extra)
            else:
                silent = silent and replier is None
                self.guard.lost(exchange)
        if not silent:
            yield Wait(link.now_ns() + self.grace_ns)
            link.flush_input()

    def _stop_blindly(self, exchange: Exchange) -> Talk[Evidence]:
        """A stop is never held back: with the length of the answer unknown it is sent and its answer dropped."""
        link = self.link
        sent_ns = link.now_ns()
        packet = pack(exchange.address, exchange.command, exchange.data)
        link.write(packet)
        self.counters.packets += 1
        self.counters.bytes_out += len(packet)
        quiet_ns = (len(packet) + PACKET_MAX_BYTES) * self._byte_ns + REPLY_DELAY_MAX_NS
        over_ns = sent_ns + quiet_ns + self.host_latency_ns
        yield Wait(over_ns + self.grace_ns, leave_ns=over_ns)
        link.flush_input()
        self.guard.lost(exchange)
        return Evidence(exchange, sent_ns, link.now_ns(), None)

    def resync(self, nulls: int = RESYNC_NULLS) -> None:
        """Bring the line back to silence: nulls fill any half-received packet, then everything that came is dropped.

        Once modules have addresses, a stray header followed by nulls is a command to nobody (address 0).
        """
        self.carry_out(self._resync(nulls))

    def _resync(self, nulls: int) -> Talk[None]:
        self.counters.resyncs += 1
        self.link.write(bytes([NULL]) * nulls)
        self.counters.bytes_out += nulls
        quiet_ns = (nulls + PACKET_MAX_BYTES) * self._byte_ns + REPLY_DELAY_MAX_NS + RESYNC_WAIT_NS
        over_ns = self.link.now_ns() + quiet_ns + self.host_latency_ns
        yield Wait(over_ns, leave_ns=over_ns)
        self.link.flush_input()

    def set_baud(self, baud: int, divisor: int | None = None) -> None:
        """Change the rate of all modules and of the host (section 3.4 steps 6 and 7); nobody answers.

        All modules must be in one group without a leader. Raises LocalFault otherwise, or for a rate that no divisor
        gives within 4 %. ``divisor``: another BRD than the data sheet's sample for this rate.
        """
        divisor = BAUD_DIVISORS.get(baud) if divisor is None else divisor
        if divisor is None or abs(true_baud(divisor) / baud - 1) > 0.04:
            raise LocalFault(f"no baud rate divisor for {baud} baud", rule="section 5.1 Set Baud Rate")
        groups = {module.group for module in self.guard.modules.values()} or {DEFAULT_GROUP}
        if len(groups) > 1:
            raise LocalFault("the modules are in several groups", rule="section 5.1 Set Baud Rate")
        self.exchange(Exchange(groups.pop(), SET_BAUD, bytes([divisor]), reply_extra=None))
        self._host_baud(baud)
        slowest = min(baud, int(true_baud(divisor)))
        self._byte_ns = -(-BITS_PER_BYTE * 1_000_000_000 // slowest)

    def set_host_baud(self, baud: int) -> None:
        """Change the host's rate only (start-up and baud search)."""
        self._host_baud(baud)

    def arm_faults(self, address: int, *, high: int = 0, low: int = 0) -> None:
        """From now on raise RemoteFault when a reply of this module has a ``high`` bit set or a ``low`` bit clear."""
        module = self.guard.modules[address]
        module.faults_high, module.faults_low = high, low
