"""Driver of a CY545: one axis on a serial port of its own, moving from stop to stop.

The chip takes no command while it steps (CY545 manual, chapter 16), so the driver knows from its caller how long a
motion lasts, says nothing before that, and then asks for the position: a motion counts as made when the chip has
answered with the register that it must have.

The register has 24 bits; the driver keeps the block, so a position here is a whole number of steps without end:

    position     -1         0         1   ...  16777215   16777216
    register  16777215      0         1   ...  16777215       0
    block        -1    |    0         0   ...      0     |    1

A target in the present block is a P, one in another block N, + or -, G: an absolute move to it would run the long way
round (chapter 5).
"""

from __future__ import annotations

from typing import Protocol

from nmc.chips import cy545 as facts
from nmc.cy545_text import answer_length, encode, encode_query, read_answer
from nmc.errors import LinkTimeout, LocalFault, RemoteFault
from nmc.link import Link

GAP_NS = 5_000_000
"""Rest after a carriage return: the manual says that a command takes some time, not how much."""
ANSWER_NS = 50_000_000
GRACE_NS = 5_000_000
SETTLE_NS = 50_000_000
"""Of a chip that is stopped on the way: the steps in progress, and what the command itself took."""
ENDLESS_NS = 1 << 62
STARTED = 1
"""N of a chip that has been started up: not its power-on value."""
CTS_POLL_NS = 1_000_000
ASK_AGAIN_NS = 100_000_000
ASKS = 5


class ChipLines(Protocol):
    """The wires beside the two data lines, as far as the machine has them."""

    def pull_abort(self, low: bool) -> None:
        """Drive INHIBIT_ABORT low, or let it go."""

    def switch_closed(self) -> bool:
        """The home switch."""

    def clear_to_send(self) -> bool:
        """CTS; True where it is not wired."""


class Cy545:
    """One chip. can_abort: the host can pull INHIBIT_ABORT; use_cts: wait for CTS instead of the reckoned time."""

    def __init__(
        self,
        link: Link,
        lines: ChipLines,
        *,
        name: str = "CY545",
        baud: int = 9600,
        gap_ns: int = GAP_NS,
        can_abort: bool = False,
        use_cts: bool = False,
    ) -> None:
        self.link = link
        self.lines = lines
        self.name = name
        self.baud = baud
        self.gap_ns = gap_ns
        self.can_abort = can_abort
        self.use_cts = use_cts
        self.moving = False
        self.ready_ns = 0
        self.expected: int | None = 0
        """Position that the motion under way must end at; None: it ends where it is stopped."""
        self.position = 0
        self._said: dict[str, int] = {}
        self._wire_free_ns = 0
        self._slowing_ns = 0
        self._continuous = False

    # -- start-up and commands -----------------------------------------------------------------------------------------

    def start_up(self, keep: bool = False) -> bool:
        """Find the chip and reset it (I), so that nothing of an earlier host is left but, with ``keep``, its position.

        The block of a kept position cannot be known: it is that nearest to 0. Returns whether the position was kept:
        a chip that has all its power-on values has lost it. Raises LinkTimeout if nobody answers.
        """
        register = self.find()
        kept = keep and any(self.query(letter) != facts.RESET_VALUES[letter] for letter in "NRFS")
        self.initialize()
        if kept:
            self.set_position(_nearest(register, 0))
        self.command("N", STARTED)
        return kept

    def find(self) -> int:
        """Find the chip and change nothing; returns its position register. Raises LinkTimeout if nobody answers."""
        self.link.set_baud(self.baud)
        self.lines.pull_abort(False)
        for _ in range(2):  # ends whatever an earlier host left unfinished
            self._write(b"\r")
            self._rest()
        self.link.flush_input()
        return self._ask_patiently("P")

    def initialize(self) -> None:
        """I: every parameter to its default, position 0."""
        self.command("I")
        self._said.clear()
        self._continuous = False
        self.position = 0
        if self.use_cts:
            self.command("O", facts.MODE_ASCII | facts.MODE_CTS)
        self._confirm()

    def set_position(self, position: int) -> None:
        """A: call the place where the chip stands ``position`` (steps)."""
        self.command("A", position % facts.BLOCK)
        self.position = position

    def read_position(self) -> int:
        """The position, read back from the chip. Raises LocalFault while it moves."""
        self.position = _nearest(self.query("P"), self.position)
        return self.position

    def command(self, letter: str, *arguments: int) -> None:
        """Send a command that starts no motion and let the chip deal with it. Raises LocalFault; no byte has left."""
        data = encode(letter, *arguments)
        if letter in "GP":
            raise LocalFault("a motion is begun by go or move_to", rule=f"CY545 manual, chapter 5, {letter}")
        self._must_rest()
        self._write(data)
        self._rest()
        if letter == "C":
            self._continuous = True
        elif letter == "A":
            self.position = arguments[0]

    def set_rates(self, first: int, rate: int, slope: int) -> None:
        """F, R and S, those that have changed."""
        for letter, value in (("F", first), ("R", rate), ("S", slope)):
            if self._said.get(letter) != value:
                self.command(letter, value)
                self._said[letter] = value

    def query(self, about: str) -> int:
        """The value of a parameter. Raises LinkTimeout, or RemoteFault for an answer that is none."""
        data = encode_query(about)
        self._must_rest()
        self.link.flush_input()
        self._write(data)
        answer = self.link.read(answer_length(about), self.link.now_ns() + self.wire_ns(20) + ANSWER_NS)
        self._rest()
        try:
            return read_answer(answer, about)
        except ValueError as error:
            if len(answer) < answer_length(about):
                raise LinkTimeout(
                    f"{self.name} does not answer ?{about} at {self.baud} baud", received=answer
                ) from None
            raise RemoteFault(f"{self.name}: {error}") from None

    # -- motion --------------------------------------------------------------------------------------------------------

    def prepare(self, target: int) -> bytes:
        """Send all that a motion to ``target`` (steps) needs beforehand; returns the command that begins it.

        Raises LocalFault for a move of more than 24 bits, and for a relative one after continuous mode.
        """
        away = target - self.position
        if abs(away) > facts.STEPS_MAX:
            raise LocalFault(f"{away} steps are more than one motion has", rule="CY545 manual, chapter 5, N")
        if target // facts.BLOCK == self.position // facts.BLOCK:
            return encode("P", target % facts.BLOCK)
        if self._continuous:
            raise LocalFault("continuous mode may still be on; initialize first", rule="CY545 manual, chapter 5, C")
        self.command("N", abs(away))
        self.command("+" if away > 0 else "-")
        return encode("G")

    def begin(self, data: bytes, target: int, lasts_ns: int, at_ns: int = 0) -> int:
        """Send the command that begins a motion so that its end is heard at ``at_ns``, or at once.

        lasts_ns: how long the motion takes; half of it is what slowing down takes at most. Returns the time at which
        the chip has heard it.
        """
        self._must_rest()
        self.link.sleep_until(at_ns - self.wire_ns(len(data)))
        self._write(data)
        heard_ns = self.link.now_ns() + self.wire_ns(len(data))
        self.moving, self.expected = True, target
        self.ready_ns = heard_ns + lasts_ns + lasts_ns // facts.CRYSTAL_SHARE + GRACE_NS
        self._slowing_ns = lasts_ns // 2
        return heard_ns

    def move_to(self, target: int, lasts_ns: int) -> int:
        """Move to ``target`` (steps), wait, and confirm; the whole move in one call."""
        if target == self.position:
            return target
        data = self.prepare(target)
        self.begin(data, target, lasts_ns)
        return self.finish()

    def run_continuous(self, clockwise: bool, slowing_ns: int) -> None:
        """C and G: step until ``stop``. slowing_ns: how long the ramp down from the top rate takes.

        Raises LocalFault where nothing could stop it.
        """
        if not self.can_abort:
            words = "continuous mode needs a line from the host to INHIBIT_ABORT"
            raise LocalFault(words, rule="CY545 manual, chapter 5, C")
        self.command("+" if clockwise else "-")
        self.command("C")
        self._write(encode("G"))
        self.moving, self.expected, self._slowing_ns = True, None, slowing_ns
        self.ready_ns = ENDLESS_NS

    def stop(self) -> int:
        """Stop a motion under way as soon as can be; returns where the chip stands then."""
        self.begin_stop()
        return self.finish_stop()

    def begin_stop(self) -> None:
        """Pull INHIBIT_ABORT, if the host can: the chip slows down."""
        if self.moving and self.can_abort:
            self.lines.pull_abort(True)
            slowed_ns = self.link.now_ns() + self._slowing_ns + self._slowing_ns // facts.CRYSTAL_SHARE + SETTLE_NS
            self.ready_ns, self.expected = min(self.ready_ns, slowed_ns), None

    def finish_stop(self) -> int:
        """Wait until the chip must stand, and read where. Without a line to stop it, it goes to its target first.

        The block is found from where the motion began: it must not have gone half a block. Raises LinkTimeout.
        """
        if self.moving:
            self.link.sleep_until(self.ready_ns)
            self.moving = False
            self.position = _nearest(self._ask_patiently("P"), self.position)
            self.lines.pull_abort(False)
        return self.position

    def finish(self) -> int:
        """Wait until the motion must be over, and confirm it; returns the position."""
        if self.moving:
            if self.use_cts:
                self._await_cts()
            else:
                self.link.sleep_until(self.ready_ns)
            self.confirm()
        return self.position

    def confirm(self) -> None:
        """Ask for the position. Raises RemoteFault if it is not what the motion must have left."""
        self.moving = False
        if self.expected is not None:
            self.position = self.expected
        self._confirm()

    def _await_cts(self) -> None:
        """CTS goes off a little after the command has been heard, and on again when the chip is ready."""
        self._rest()
        while not self.lines.clear_to_send():
            if self.link.now_ns() > self.ready_ns:
                raise LinkTimeout(f"{self.name} is still not clear to send although its motion must be over")
            self.link.sleep_until(self.link.now_ns() + CTS_POLL_NS)

    def _confirm(self) -> None:
        register = self._ask_patiently("P")
        if register != self.position % facts.BLOCK:
            words = f"{self.name} stands at {register}, not at {self.position % facts.BLOCK}"
            self.position = _nearest(register, self.position)
            raise RemoteFault(words)

    def _ask_patiently(self, about: str) -> int:
        for _ in range(ASKS - 1):
            try:
                return self.query(about)
            except (LinkTimeout, RemoteFault):
                self.link.sleep_until(self.link.now_ns() + ASK_AGAIN_NS)
        return self.query(about)

    # -- the wire ------------------------------------------------------------------------------------------------------

    def _must_rest(self) -> None:
        if self.moving:
            words = f"{self.name} is moving and hears nothing"
            raise LocalFault(words, rule="CY545 manual, chapter 16")

    def _write(self, data: bytes) -> None:
        self._wire_free_ns = self.link.now_ns() + self.wire_ns(len(data))
        self.link.write(data)

    def _rest(self) -> None:
        self.link.sleep_until(self._wire_free_ns + self.gap_ns)

    def wire_ns(self, characters: int) -> int:
        """Time that characters take on the line."""
        return characters * facts.BITS_PER_CHAR * 1_000_000_000 // self.baud


def _nearest(register: int, position: int) -> int:
    """The position with this register that is nearest to ``position``."""
    return position + (register - position + facts.BLOCK // 2) % facts.BLOCK - facts.BLOCK // 2
