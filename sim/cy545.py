"""The simulated CY545: its receiver, its command interpreter, its pins.

While a command executes, and that is as long as a motion lasts, three characters are kept and the rest is lost
(CY545 manual, chapter 16). Where the manual is silent the choices are: a following N or I ends continuous mode; a G or
P given while INHIBIT_ABORT is low waits until it rises.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Literal

from nmc.chips import cy545 as facts
from sim.bus import Bus
from sim.clock import ChipClock
from sim.cy545_motion import FOREVER, Motion
from sim.cy545_ramp import Ramp
from sim.cy545_spec import Cy545Port
from sim.cy545_text import Words, read_command
from sim.draws import Draws
from sim.trace import StepRuns

Jog = Literal["cw", "ccw"]
PULSE_NS = 10_000
"""How long PULSE stays low at 12 MHz; the manual says fixed, not how long."""
_NS_PER_MS = 1_000_000
_LINE_MAX = 64


class Cy545:
    """One chip on its own line. Positions in steps; ``register`` is the chip's, ``mechanical`` the shaft's."""

    def __init__(self, spec: Cy545Port, bus: Bus, ppb: int, draws: Draws) -> None:
        self.name = spec.name
        self.spec = spec
        self.bus = bus
        self.world = bus.world
        self.clock = ChipClock(1, ppb)
        self.runs = StepRuns(self.clock)
        self.draws = draws
        self.mechanical = spec.start_steps
        self.abort_low = self.slew_low = self.ccw_pulled_low = False
        self.jog: Jog | None = None
        # as a listener of the line: never idle, so that it hears byte by byte and no packet is made of its bytes
        self.alive, self.idle, self.epoch, self.rx_baud = True, False, 0, float(spec.baud)
        self._reset()

    def _reset(self) -> None:
        """Power-on and I: chapter 10."""
        values = facts.RESET_VALUES
        self.values = {letter: values[letter] for letter in "RFSNO"} | {"D": 0}
        self.register = values["P"]
        self.bits = 0xFFFF
        self.clockwise = True
        self.continuous = False
        self.motion: Motion | None = None
        self.last_step_tick: int | None = None
        self._executing = False
        self._waiting: Callable[[], None] | None = None
        self._kept: deque[int] = deque()
        self._line = bytearray()
        self._ticket = getattr(self, "_ticket", 0) + 1

    # -- pins ----------------------------------------------------------------------------------------------------------

    @property
    def busy(self) -> bool:
        """A command executes; a motion, a delay and a wait last as long as they do."""
        self.settle()
        return self._executing

    @property
    def clear_to_send(self) -> bool:
        """CTS, if the mode register turns it on: ready for more; else always."""
        return not (self.busy and self.values["O"] & facts.MODE_CTS)

    @property
    def ccw_high(self) -> bool:
        """The CCW pin: low for clockwise; pulled low from outside it says clockwise too."""
        return not self.clockwise and not self.ccw_pulled_low

    @property
    def pulse_high(self) -> bool:
        """PULSE: normally high, low at the start of each step."""
        self.settle()
        if self.last_step_tick is None:
            return True
        width = round(PULSE_NS * facts.TABLE_CRYSTAL_MHZ / self.spec.crystal_mhz)
        return self.clock.tick_at(self.world.now_ns) >= self.last_step_tick + width

    @property
    def switch_closed(self) -> bool:
        """The switch on the mechanics, which the chip does not see."""
        self.settle()
        switch = self.spec.switch
        if switch is None:
            return False
        above = switch.from_steps is None or switch.from_steps <= self.mechanical
        below = switch.to_steps is None or self.mechanical <= switch.to_steps
        return (above and below) == switch.active_high

    def set_abort(self, low: bool) -> None:
        """Drive INHIBIT_ABORT."""
        self.settle()
        changed, self.abort_low = low != self.abort_low, low
        if not changed:
            return
        if self.motion is not None and self.jog is None:
            tick = self.clock.tick_at(self.world.now_ns)
            self.motion.abort(tick) if low else self.motion.release(tick)
            self._foresee_end()
        elif not low and self._waiting is not None:
            begin, self._waiting = self._waiting, None
            begin()

    def set_slew(self, low: bool) -> None:
        """Drive SLEW; low at the start of stepping selects continuous mode."""
        self.slew_low = low

    def pull_ccw(self, low: bool) -> None:
        """Pull the CCW pin low from outside, or let it go."""
        if low and self.clockwise is False:
            self.ccw_pulled_low = True
        elif not low:
            self.ccw_pulled_low = False

    def set_jog(self, way: Jog | None) -> None:
        """Move by hand: ground JOG ("cw") or pull it up ("ccw"); None leaves it open. Ignored while a command runs."""
        self.settle()
        if way == self.jog:
            return
        if self.jog is not None and self.motion is not None:
            self.motion.stop_after_step()
            self._foresee_end()
        self.jog = None
        if way is not None and not self._executing:
            self.jog = way
            slow = self._period(self.values["F"]) * facts.JOG_DIVISOR
            self._executing = True
            self._move(Ramp((slow,), self._entry(), 0, 0), None, 1 if way == "cw" else -1)

    # -- the line ------------------------------------------------------------------------------------------------------

    def matches(self, address: int, command: int) -> bool:
        """No packet is for this chip."""
        return False

    def hear_packet(self, address: int, command: int, data: bytes, good: bool) -> None:
        """Never called: see ``matches``."""

    def hear_byte(self, value: int, clean: bool) -> None:
        """One character has arrived."""
        self.settle()
        if not clean:
            self._breach("CE-01", "a character with a framing error is ignored")
            return
        if self._executing:
            self._hear_busy(value)
            return
        self._take(value)

    def _hear_busy(self, value: int) -> None:
        if len(self._kept) < facts.BUFFER_CHARS:
            self._kept.append(value)
            if not self.values["O"] & facts.MODE_CTS:
                self._breach("CE-07", f"{chr(value)!r} came while a command executes; it is kept for later")
        else:
            self._breach("CE-07", f"{chr(value)!r} came while a command executes and is lost")

    def _take(self, value: int) -> None:
        if value != facts.END:
            self._line.append(value)
            if len(self._line) > _LINE_MAX:
                self._line.clear()
                self._breach("CE-01", "a command without end is dropped")
            return
        line, self._line = self._line.decode("latin-1"), bytearray()
        if line:
            self._executing = True
            self.world.call_at(self.world.now_ns + self.spec.execute_ns, partial(self._execute, self._ticket, line))

    def _execute(self, ticket: int, line: str) -> None:
        if ticket != self._ticket:
            return
        try:
            lasts = self._obey(read_command(line))
        except ValueError as error:
            self._breach("CE-01", f"{line!r} is not executed: {error}")
            lasts = False
        if not lasts:
            self._ready()

    def _ready(self) -> None:
        """The command is over: what was kept meanwhile is read now."""
        self._executing = False
        while self._kept and not self._executing:
            self._take(self._kept.popleft())

    # -- commands ------------------------------------------------------------------------------------------------------

    def _obey(self, words: Words) -> bool:
        """Carry out a command; True if it lasts longer. Raises ValueError for one that is refused."""
        letter = words.letter
        fact = facts.COMMANDS.get(letter)
        if fact is None:
            self._breach("CE-02", f"{letter!r} is {'not modelled' if letter in facts.KNOWN_LETTERS else 'no command'}")
            return False
        if len(words.arguments) != len(fact.bits):
            raise ValueError(f"{letter} has {len(fact.bits)} arguments")
        for value, width in zip(words.arguments, fact.bits, strict=True):
            if value >> width:
                raise ValueError(f"{value} has more than {width} bits")
        if letter in "GP":
            return self._start(letter, words)
        if letter == "D":
            self._delay(words.arguments[0])
            return True
        if letter == "?":
            self._answer(words.about)
        else:
            self._set(letter, words)
        return False

    def _set(self, letter: str, words: Words) -> None:
        value = words.arguments[0] if words.arguments else 0
        if letter in "RFS":
            if value == 0:
                rule, what = ("CY-003", "slope") if letter == "S" else ("X-101", "rate")
                self._breach(rule, f"{what} 0 is refused")
                return
            self.values[letter] = value
        elif letter == "N":
            self.values["N"], self.continuous = value, False
        elif letter == "O":
            if not value & facts.MODE_ASCII:
                self._breach("CE-06", "binary mode is not modelled; the mode register stays")
                return
            self.values["O"] = value
        elif letter == "A":
            self.register = value
        elif letter == "C":
            self.continuous = True
        elif letter in "+-":
            self.clockwise = letter == "+"
        elif letter == "B":
            self.bits = facts.bit_command(self.bits, value, negate=words.negate) & 0xFFFF
        elif letter == "I":
            self._reset()

    def _answer(self, about: str) -> None:
        digits = facts.QUERY_DIGITS.get(about)
        if digits is None:
            raise ValueError(f"nothing is known of ?{about}")
        value = {"A": self.register, "P": self.register, "B": self.bits}.get(about, self.values.get(about, 0))
        reply = f"{about}={value:0{digits}d}\r".encode("ascii")
        self.bus.reply(reply, max(self.world.now_ns, self.bus.status.busy_until_ns), self.rx_baud)

    def _delay(self, milliseconds: int) -> None:
        self.values["D"] = milliseconds
        ticks = round(milliseconds * _NS_PER_MS * facts.TABLE_CRYSTAL_MHZ / self.spec.crystal_mhz)
        until_ns = self.world.now_ns + round(self.clock.span_ns(ticks))
        self.world.call_at(until_ns, partial(self._delay_over, self._ticket))

    def _delay_over(self, ticket: int) -> None:
        if ticket == self._ticket:
            self._ready()

    # -- motion --------------------------------------------------------------------------------------------------------

    def _start(self, letter: str, words: Words) -> bool:
        first, top = min(self.values["F"], self.values["R"]), self.values["R"]  # F above R: no ramp
        ramp = Ramp([self._period(index) for index in range(facts.RATES)], self._entry(), first, top)
        if letter == "P":
            away = words.arguments[0] - self.register
            self.clockwise = away > 0 if away else self.clockwise
            steps: int | None = abs(away)
        else:
            steps = None if self.continuous or self.slew_low else self.values["N"]
        direction = -1 if self.ccw_high else 1
        if steps == 0:
            return False
        begin = partial(self._move, ramp, steps, direction)
        if self.abort_low:
            self._waiting = begin
        else:
            begin()
        return True

    def _move(self, ramp: Ramp, steps: int | None, direction: int) -> None:
        start_ns = self.world.now_ns + self.draws.below_ns(self.spec.start_delay_max_ns)
        self.motion = Motion(ramp, steps, direction, self.clock.tick_at(start_ns) + 1)
        self._foresee_end()

    def _foresee_end(self) -> None:
        assert self.motion is not None
        self._ticket += 1
        if self.motion.over_tick < FOREVER:
            self.world.call_at(self.clock.ns_of(self.motion.over_tick), partial(self._motion_over, self._ticket))

    def _motion_over(self, ticket: int) -> None:
        if ticket != self._ticket:
            return
        self.settle()
        self.motion = None
        self._ready()

    def settle(self) -> None:
        """Let out the steps whose time has come."""
        if self.motion is not None:
            self.motion.advance(self.clock.tick_at(self.world.now_ns), self._emit)

    def _emit(self, first: int, period: int, count: int, direction: int) -> None:
        self.runs.add(first, period, count, direction)
        self.last_step_tick = first + (count - 1) * period
        self.mechanical += direction * count
        self.register = (self.register + direction * count) % facts.BLOCK

    def _period(self, index: int) -> int:
        return self.spec.rates.period_ns(index, self.spec.crystal_mhz)

    def _entry(self) -> int:
        return facts.ramp_entry_ns(self.values["S"], self.spec.crystal_mhz)

    def _breach(self, rule: str, consequence: str) -> None:
        self.bus.log.violation(self.world.now_ns, self.name, rule, consequence)
