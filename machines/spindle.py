"""A spindle: what is said to bring it from one speed to another, how long that takes, and how fast it really turns.

    rpm ^        ______________       the plan rests from the command until the speed has settled:
        |       /              .      ramp_time * |change| / max_rpm + settle_time
        |      /               .
        |_____/________________.___
              | ramp  | settle |      at the end the measured speed must be within at_speed

Speeds are signed: positive is M3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from gcode.canon import Spindle
from machines.outputs import PWM_FULL, Panel
from machines.outputs_schema import SpindleTable
from nmc.budget import BusTiming
from nmc.chips import picservo
from nmc.chips.common import SERVO_TICK_NS
from nmc.codec import encode
from nmc.program import Evidence, Exchange

NS_PER_S = 1_000_000_000
STEP_NS = 20_000_000
"""In PWM mode the chip has no profile: the value is raised once in this time."""
POSITION_ITEM = picservo.ITEM_POSITION
POSITION_BYTES = 4
SMALL_RADIUS_MM = 1e-3


@dataclass(frozen=True, slots=True)
class Saying:
    """Something to say ``after_ns`` of the beginning of a change; the words are found when it is said.

    name: the pin that changes, or ``spindle``. value: what it changes to, of ``spindle`` the speed.
    """

    after_ns: int
    make: Callable[[], Exchange]
    name: str = "spindle"
    value: float = 0.0


def wanted_rpm(table: SpindleTable, command: Spindle, x_mm: float) -> float:
    """The signed speed that a command asks for with the tool at machine X ``x_mm``; under G96 within all limits."""
    if command.direction == 0:
        return 0.0
    rpm = command.speed_rpm
    if command.surface_mm_s:
        radius_mm = max(abs(x_mm - command.axis_x_mm), SMALL_RADIUS_MM)
        rpm = command.surface_mm_s / (2 * math.pi * radius_mm) * 60
        rpm = min(max(rpm, table.min_rpm), table.max_rpm, command.limit_rpm)
    return command.direction * rpm


def change_s(table: SpindleTable, old_rpm: float, new_rpm: float) -> float:
    """How long the plan rests for a change of speed, s; 0 if nothing changes."""
    if old_rpm == new_rpm or (table.drive == "output" and table.speed is None and old_rpm * new_rpm > 0):
        return 0.0
    return ramp_s(table, old_rpm, new_rpm) + table.settle_time


def ramp_s(table: SpindleTable, old_rpm: float, new_rpm: float) -> float:
    """The ramp alone, s. A spindle that only switches runs at its greatest speed or stands."""
    if table.drive == "output" and table.speed is None:
        old_rpm, new_rpm = (float(np.sign(rpm)) * table.max_rpm for rpm in (old_rpm, new_rpm))
    return table.ramp_time * abs(new_rpm - old_rpm) / table.max_rpm


@dataclass(slots=True)
class Reading:
    """One position of the spindle's encoder: at the end of which servo tick, in link time."""

    time_ns: int
    counts: int


class SpindleDrive:
    """One spindle. It keeps what it was told last and what was measured; somebody else sends the exchanges."""

    def __init__(self, table: SpindleTable, panel: Panel, bus: int, timing: BusTiming) -> None:
        self.table = table
        self.panel = panel
        self.bus = bus
        self.address = table.address or 0
        self.said_rpm = 0.0
        self.powered = False
        self.measured_rpm: float | None = None
        self._timing = timing
        self._reading: Reading | None = None

    @property
    def measures(self) -> bool:
        """Whether the speed can be read."""
        return self.table.counts_per_rev is not None

    @property
    def turning(self) -> bool:
        """Whether it was told to turn, or has power still."""
        return self.powered or self.said_rpm != 0

    def change(self, rpm: float) -> Iterator[Saying]:
        """What to say, and when, to bring the spindle to ``rpm``."""
        old, self.said_rpm = self.said_rpm, rpm
        self._reading = self.measured_rpm = None
        if self.table.drive == "output":
            yield from self._switch(old, rpm)
            return
        if not self.powered and rpm:
            self.powered = True
            yield from self._power_up()
        if self.table.drive == "velocity":
            yield Saying(0, partial(self._velocity, rpm), value=rpm)
        else:
            yield from self._ramp_pwm(old, rpm)
        if not rpm:
            yield Saying(round(ramp_s(self.table, old, rpm) * NS_PER_S), self.power_down)

    def follow(self, rpm: float) -> Exchange:
        """A small change of a speed that follows X, without a ramp of its own."""
        self.said_rpm = rpm
        if self.table.drive == "velocity":
            return self._velocity(rpm)
        if self.table.drive == "pwm":
            return self._pwm(rpm)
        return self.panel.set("spindle speed", self.pwm_of(rpm))

    def power_down(self) -> Exchange:
        """Motor off, amplifier off: from any speed it coasts."""
        self.powered = False
        return self._say("stop_motor", {"motor_off": 1})

    def off(self) -> Iterator[Exchange]:
        """Whatever it does: no power to it at once. Pins are switched off by the panel."""
        self.said_rpm = 0.0
        if self.table.drive != "output":
            yield self.power_down()

    def prepare(self) -> Iterator[Exchange]:
        """What its module must be told before the first change."""
        if self.table.drive != "output":
            yield self.power_down()
        if self.table.servo is not None:
            servo = self.table.servo
            names = {"position_gain": servo.kp, "velocity_gain": servo.kd, "integral_gain": servo.ki}
            same = servo.model_dump(exclude={"kp", "kd", "ki"})
            yield self._say("set_gain", names | same)

    # --- how fast it turns -------------------------------------------------------------------------------------------

    def poll(self) -> Exchange:
        """Ask where the encoder is."""
        command, data = encode(picservo.FACTS, "read_status", {"items": POSITION_ITEM})
        return Exchange(self.address, command, data, reply_extra=POSITION_BYTES, bus=self.bus)

    def heard(self, evidence: Evidence) -> float | None:
        """The mean signed speed since the poll before, rpm; None at the first."""
        time_ns = evidence.replied_ns - self._timing.reply_ns(POSITION_BYTES)  # answered at the end of the servo cycle
        counts = int.from_bytes(evidence.extra, "little", signed=True)
        before, self._reading = self._reading, Reading(time_ns, counts)
        if before is None or time_ns <= before.time_ns or self.table.counts_per_rev is None:
            return None
        moved = (counts - before.counts + (1 << 31)) % (1 << 32) - (1 << 31)  # the counter has 32 bits and goes round
        turns = moved / self.table.counts_per_rev
        sign = 1 if self.table.clockwise == "forward" else -1
        self.measured_rpm = sign * turns / ((time_ns - before.time_ns) / NS_PER_S) * 60
        return self.measured_rpm

    def off_by(self) -> float:
        """By which share of the wanted speed the measured one differs; of ``max_rpm`` where it should stand."""
        wanted, measured = self.said_rpm, self.measured_rpm or 0.0
        return abs(measured - wanted) / (abs(wanted) or self.table.max_rpm)

    # --- in the chips' words -----------------------------------------------------------------------------------------

    def pwm_of(self, rpm: float) -> int:
        """The PWM value of a speed, linear between the two that the file gives."""
        table = self.table
        if rpm == 0:
            return 0
        share = (abs(rpm) - table.min_rpm) / (table.max_rpm - table.min_rpm)
        value = table.pwm_at_min + share * (table.pwm_at_max - table.pwm_at_min)
        return min(max(round(value), 0), PWM_FULL)

    def _power_up(self) -> Iterator[Saying]:
        if self.table.drive == "pwm":
            yield Saying(0, partial(self._say, "stop_motor", {"amplifier_enable": 1}))
            return
        hold = {"amplifier_enable": 1, "stop_abruptly": 1}  # the servo holds where it stands
        yield Saying(0, partial(self._say, "stop_motor", hold))
        yield Saying(0, partial(self._say, "clear_sticky_bits", {}))

    def _velocity(self, rpm: float) -> Exchange:
        table = self.table
        assert table.counts_per_rev is not None
        divisor = table.servo.servo_rate_divisor if table.servo is not None else 1
        tick_s = SERVO_TICK_NS * divisor / NS_PER_S
        per_tick = table.counts_per_rev / 60 * tick_s * picservo.FRACTION
        acceleration = max(round(table.max_rpm * per_tick * tick_s / table.ramp_time), 1)
        values = {"velocity": round(abs(rpm) * per_tick), "acceleration": acceleration}
        values |= {"servo_mode": 1, "velocity_mode": 1, "reverse": int(self._reverse(rpm)), "start_now": 1}
        return self._say("load_trajectory", values)

    def _ramp_pwm(self, old: float, new: float) -> Iterator[Saying]:
        ramp_ns = round(ramp_s(self.table, old, new) * NS_PER_S)
        steps = max(-(-ramp_ns // STEP_NS), 1)
        for step in range(1, steps + 1):
            rpm = old + (new - old) * step / steps
            yield Saying(ramp_ns * (step - 1) // steps, partial(self._pwm, rpm), value=rpm)

    def _pwm(self, rpm: float) -> Exchange:
        values = {"pwm": self.pwm_of(rpm), "reverse": int(self._reverse(rpm)), "start_now": 1}
        return self._say("load_trajectory", values)

    def _reverse(self, rpm: float) -> bool:
        return (rpm < 0) != (self.table.clockwise == "reverse")

    def _switch(self, old: float, new: float) -> Iterator[Saying]:
        """Pins: a spindle that turns the other way is switched off first and given its time to stop."""
        begin_ns = 0
        if old and old * new <= 0:
            yield self._pin(0, "spindle on", 0)
            if "spindle speed" in self.panel.values:
                yield self._pin(0, "spindle speed", 0)
            begin_ns = round(ramp_s(self.table, old, 0.0) * NS_PER_S)
        if not new:
            return
        if "spindle reverse" in self.panel.switches and self.panel.levels.get("spindle reverse", 0.0) != (new < 0):
            yield self._pin(begin_ns, "spindle reverse", int(new < 0))
        if "spindle speed" in self.panel.values:
            yield self._pin(begin_ns, "spindle speed", self.pwm_of(new))
        if old * new <= 0:
            yield self._pin(begin_ns, "spindle on", 1)

    def _pin(self, after_ns: int, name: str, value: int) -> Saying:
        panel = self.panel
        make = partial(panel.set, name, value) if name in panel.values else partial(panel.switch, name, bool(value))
        return Saying(after_ns, make, name, value)

    def _say(self, name: str, values: dict[str, int]) -> Exchange:
        command, data = encode(picservo.FACTS, name, values)
        return Exchange(self.address, command, data, bus=self.bus)
