"""A PIC-SERVO with its PIC-ENC (type 0, version 4): its commands, status and timing. Data sheet sections 4 and 5.

A command waits in the buffer until the end of the servo cycle, is then executed, and then answered (section 4.1). The
servo loop itself runs in the compiled kernel, and only when somebody looks: up to the tick at which something happens.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sim import module as nmc
from sim import servokernel as k
from sim.bus import Bus
from sim.clock import ChipClock
from sim.draws import Draws
from sim.plant import plant_arrays
from sim.servomoves import ServoMoves
from sim.spec import ServoModule, SimOptions
from sim.trace import ServoSamples
from sim.uart import chip_baud

TICK_NS = 512_000  # 10 240 clocks of 20 MHz: 1953.125 Hz
_CHUNK = 8192
_EVER = 1 << 60
_DATA_LENGTH = {
    nmc.RESET_POSITION: 0,
    nmc.START_MOTION: 0,
    nmc.SET_PARAMETERS: 14,
    nmc.STOP_MOTOR: 1,
    nmc.SET_OUTPUTS: 1,
    nmc.SET_HOMING: 1,
    nmc.CLEAR_BITS: 0,
    nmc.SAVE_HOME: 0,
}


@dataclass(slots=True)
class _Pending:
    """A command in the buffer, and whether it will be answered."""

    command: int
    data: bytes
    good: bool
    answers: bool


LIMIT_PINS = ("limit1", "limit2")


class PicServo(nmc.NmcModule):
    """One PIC-SERVO, PIC-ENC, amplifier and motor."""

    type_id = 0

    def __init__(self, spec: ServoModule, bus: Bus, ppb: int, draws: Draws, phase_ns: int, options: SimOptions) -> None:
        self.spec = spec
        self.options = options
        self.clock = ChipClock(round(TICK_NS * 20.0 / spec.oscillator_mhz), ppb, phase_ns)
        super().__init__(spec.name, bus, ppb, draws)
        self.n = np.zeros(k.N_SIZE, np.int64)
        self.f = plant_arrays(spec.plant, spec.start_counts, self.clock.span_ns(1) * 1e-9)
        self.n[k.COUNT] = spec.start_counts
        self.n[k.TICK] = self.clock.tick_at(self.world.now_ns)
        self.switches = np.zeros((len(spec.switches), 4), np.int64)
        self._wire_switches()
        self._command = np.zeros(_CHUNK, np.int64)
        self._position = np.zeros(_CHUNK, np.int32)
        self.samples = ServoSamples()
        self._chunk_tick = int(self.n[k.TICK])
        self.pending: _Pending | None = None
        self.power_up()

    def rate(self, brd: int) -> float:
        """True baud for a divisor; a slower oscillator slows the line as well (section 3.0)."""
        return chip_baud(brd, self.ppb) * self.spec.oscillator_mhz / 20.0

    def _wire_switches(self) -> None:
        bits = {"limit1": k.IN_LIMIT1, "limit2": k.IN_LIMIT2}
        for row, switch in enumerate(self.spec.switches):
            if switch.pin not in bits:
                raise ValueError(f"module {self.spec.name!r}: a PIC-SERVO has no switch input {switch.pin!r}")
            low = -_EVER if switch.from_steps is None else switch.from_steps
            high = _EVER if switch.to_steps is None else switch.to_steps
            self.switches[row] = bits[switch.pin], low, high, switch.active_high

    def power_up(self) -> None:
        """Section 4.5: everything zero, SR 1, PWM mode, move_done and pos_error set."""
        n = self.n
        kept = [k.TICK, k.COUNT, k.RAW16, k.FAULTS, k.SAMPLES, k.SKIP]
        saved = n[kept]
        n[:] = 0
        n[kept] = saved
        n[k.SR] = 1
        n[k.MOVE_DONE] = n[k.POS_ERROR] = 1
        n[k.IO_CONTROL] = 0x0C
        n[k.EVERY] = self.spec.trace_every
        n[k.PRINTED_SIGN] = self.spec.derivative_as_printed
        n[k.VERSION] = self.spec.version
        n[k.POWER] = self.f[k.SUPPLY] > k.POWER_VOLTS
        self.overrun = False
        self.pending = None
        self.moves = ServoMoves(self)

    # -- time --------------------------------------------------------------------------------------------------------

    def synchronise(self) -> None:
        """Run the servo up to the last tick that has ended by now."""
        self.run_to(self.clock.tick_at(self.world.now_ns))

    def run_to(self, tick: int) -> None:
        """Run the servo up to the end of ``tick``."""
        n = self.n
        ticks = tick - int(n[k.TICK])
        while ticks > 0:
            room = _CHUNK - int(n[k.SAMPLES])
            now = min(ticks, room * max(1, self.spec.trace_every))
            before = n.copy()
            k.run(now, n, self.f, self.switches, self._command, self._position)
            self._tell_changes(before)
            if n[k.SAMPLES] >= _CHUNK:
                self.flush_samples()
            ticks -= now

    def _tell_changes(self, before: k.I8) -> None:
        """Log what the chip did on its own account since ``before``."""
        n = self.n
        if before[k.HOMING] and not n[k.HOMING]:
            self._tell(int(n[k.HOMED_TICK]), f"home captured at {int(n[k.HOME])}")
        if before[k.SERVO_ON] and not n[k.SERVO_ON]:
            tripped = n[k.TRIPPED_TICK] > before[k.TRIPPED_TICK]
            tick = int(n[k.TRIPPED_TICK if tripped else k.TICK])
            self._tell(tick, "servo disabled: " + ("position error limit" if tripped else "power or homing"))
        if n[k.FAULTS] > before[k.FAULTS]:
            lost = int(n[k.FAULTS] - before[k.FAULTS])
            self._tell(int(n[k.TICK]), f"encoder edges above 500 kHz: counts of {lost} ticks lost")

    def _tell(self, tick: int, what: str) -> None:
        self.log.incident(self.clock.ns_of(tick), self.name, what)

    def flush_samples(self) -> None:
        """Move the samples of the current chunk to the trace, with their times."""
        n = self.n
        count = int(n[k.SAMPLES])
        every = max(1, self.spec.trace_every)
        if count:
            ticks = int(n[k.TICK]) - int(n[k.SKIP]) - every * np.arange(count - 1, -1, -1)
            times = self.clock.phase_ns + np.floor(ticks * self.clock.span_ns(1)).astype(np.int64)
            self.samples.add(times, self._command[:count], self._position[:count])
            n[k.SAMPLES] = 0

    def inject_overrun(self, extra_ns: int) -> None:
        """Lengthen the present tick: the calculations took longer than 0.51 ms (section 5.3, servo_overrun)."""
        self.synchronise()
        self.flush_samples()
        self.clock = replace(self.clock, phase_ns=self.clock.phase_ns + extra_ns)
        self.overrun = True

    # -- timing of commands ------------------------------------------------------------------------------------------

    def take(self, command: int, data: bytes, good: bool, answers: bool) -> None:
        """Keep the command in the buffer until the end of the present servo cycle."""
        if self.pending is not None:
            self.violation("N-022", "a command overwrote the one before it in the buffer")
        else:
            self._at_tick_end()
        self.pending = _Pending(command, data, good, answers)
        if answers and not (good and command == nmc.HARD_RESET):
            self.bus.expect_reply(self.clock.ns_of(self.clock.tick_at(self.world.now_ns) + 1))

    def _at_tick_end(self) -> None:
        tick = self.clock.tick_at(self.world.now_ns) + 1
        self.world.call_at(self.clock.ns_of(tick), partial(self._execute_pending, tick, self.epoch))

    def drop_reply(self) -> bool:
        """The host has talked: the buffered command is still executed but not answered."""
        had = self.pending is not None and self.pending.answers
        if self.pending is not None:
            self.pending.answers = False
        return had

    def _execute_pending(self, tick: int, epoch: int) -> None:
        pending = self.pending
        if epoch != self.epoch or pending is None or self.broken:
            return
        if self.clock.ns_of(tick) > self.world.now_ns:  # the tick was lengthened meanwhile
            self.world.call_at(self.clock.ns_of(tick), partial(self._execute_pending, tick, epoch))
            return
        self.pending = None
        self.run_to(tick)
        if pending.good and not self.shared(pending.command, pending.data):
            before = self.raw_pwm
            self.execute(pending.command, pending.data)
            self.log.pwm(self.world.now_ns, self.name, "pwm", before, self.raw_pwm)
        if pending.answers and not (pending.good and pending.command == nmc.HARD_RESET):
            mask = self.reply_mask(pending.command, pending.data) if pending.good else self.mask
            if pending.good and pending.command == nmc.SET_BAUD:
                self.violation("N-084", "Set Baud with an answer: it comes at the new rate")
            self.bus.reply(self.reply_bytes(mask, not pending.good), self.world.now_ns, self.rx_baud)

    # -- status ------------------------------------------------------------------------------------------------------

    def status_byte(self) -> int:
        """Section 5.3."""
        n = self.n.tolist()
        return int(
            n[k.MOVE_DONE]
            | n[k.OVERCURRENT] << 2
            | n[k.POWER] << 3
            | n[k.POS_ERROR] << 4
            | (n[k.INPUTS] & 3) << 5
            | (n[k.HOMING] != 0) << 7
        )

    def auxiliary_byte(self) -> int:
        """Section 5.3: index complemented, pos_wrap, servo_on, accel_done, slew_done, servo_overrun."""
        n = self.n.tolist()
        return int(
            (not n[k.INPUTS] & k.IN_INDEX)
            | n[k.POS_WRAP] << 1
            | n[k.SERVO_ON] << 2
            | n[k.ACCEL_DONE] << 3
            | n[k.SLEW_DONE] << 4
            | self.overrun << 5
        )

    def status_item(self, bit: int) -> bytes:
        """Items of Define Status, section 5.2, least significant byte first; the velocity is negated."""
        n = self.n
        if bit == 0:
            return int(n[k.POS]).to_bytes(4, "little", signed=True)
        if bit == 1:
            return bytes([int(n[k.AD])])
        if bit == 2:
            return max(-0x8000, min(0x7FFF, -int(n[k.MEASURED]))).to_bytes(2, "little", signed=True)
        if bit == 3:
            return bytes([self.auxiliary_byte()])
        if bit == 4:
            return int(n[k.HOME]).to_bytes(4, "little", signed=True)
        return bytes([self.type_id, self.spec.version])

    @property
    def position(self) -> int:
        """The 32-bit encoder position, at the present time."""
        self.synchronise()
        return int(self.n[k.POS])

    @property
    def command_position(self) -> float:
        """Where the motor should be, in counts with fraction."""
        self.synchronise()
        return int(self.n[k.COMMAND]) / 65536

    @property
    def mechanical_counts(self) -> float:
        """Where the shaft is, in counts from the mechanical zero."""
        self.synchronise()
        return float(self.f[k.THETA])

    @property
    def raw_pwm(self) -> int:
        """The PWM value of PWM mode, negative in reverse; 0 while the servo is on or the amplifier off."""
        n = self.n
        if n[k.SERVO_ON] or not n[k.AMP]:
            return 0
        return -int(n[k.RAW_PWM]) if n[k.DIR] else int(n[k.RAW_PWM])

    @property
    def moving(self) -> bool:
        """The complement of move_done."""
        self.synchronise()
        return not self.n[k.MOVE_DONE]

    # -- commands ----------------------------------------------------------------------------------------------------

    def execute(self, command: int, data: bytes) -> None:
        """Commands of the PIC-SERVO's own, at the end of the tick."""
        n, moves = self.n, self.moves
        if command == nmc.LOAD_TRAJECTORY:
            moves.load(data)
            return
        wanted = _DATA_LENGTH.get(command)
        if wanted is None:
            self.violation("X-41", f"command 0x{command:X} is not defined for a PIC-SERVO: treated as No Operation")
        elif command == nmc.RESET_POSITION and len(data) == 1:
            moves.reset_relative(data[0])
        elif command == nmc.SET_PARAMETERS and len(data) == 13:
            moves.set_gain(data + b"\0")
        elif command == nmc.STOP_MOTOR and len(data) == 5:
            moves.stop(data[0], int.from_bytes(data[1:], "little", signed=True))
        elif command == nmc.SET_PARAMETERS and len(data) == 15:
            self.violation("X-04", "Set Gain with 15 data bytes belongs to another version: not executed")
        elif self.check_length(command, data, wanted):
            if command == nmc.RESET_POSITION:
                moves.reset_position(0)
            elif command == nmc.START_MOTION:
                moves.start()
            elif command == nmc.SET_PARAMETERS:
                moves.set_gain(data[:13] + (b"\0" if self.spec.version < 4 else data[13:14]))
            elif command == nmc.STOP_MOTOR:
                moves.stop(data[0], None)
            elif command == nmc.SET_OUTPUTS:
                self.zero_bits("SV-150", data[0], 0xF0)
                before, after = int(n[k.IO_CONTROL]), data[0] & 0x0F
                n[k.IO_CONTROL] = after
                self.log.pins(self.world.now_ns, self.name, LIMIT_PINS, before & ~(before >> 2), after & ~(after >> 2))
            elif command == nmc.SET_HOMING:
                moves.set_homing(data[0])
            elif command == nmc.CLEAR_BITS:
                n[k.OVERCURRENT] = n[k.POS_WRAP] = 0
                self.overrun = False
                n[k.POS_ERROR] = not n[k.SERVO_ON]  # set whenever the servo is off
            else:
                if n[k.HOMING]:
                    self.violation("X-75", "Save as Home while homing: the home register is overwritten")
                n[k.HOME] = n[k.POS]

    def halt_dead(self) -> None:
        """No more PWM; the motor coasts."""
        self.n[k.AMP] = 0
        k.servo_off(self.n)

    def set_supply(self, volts: float) -> None:
        """Change the motor supply from now on."""
        self.synchronise()
        self.f[k.SUPPLY] = volts
