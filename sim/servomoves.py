"""Load Trajectory, Start Motion, Stop Motor, Set Gain, homing of a PIC-SERVO (data sheet sections 4.4, 4.5, 5.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim import module as nmc
from sim import servokernel as k
from sim.registers import wrap32

if TYPE_CHECKING:
    from sim.picservo import PicServo

POSITION, VELOCITY, ACCELERATION, PWM = 1, 2, 4, 8
SERVO_MODE, VELOCITY_MODE, REVERSE, START_NOW = 0x10, 0x20, 0x40, 0x80


@dataclass(slots=True)
class Load:
    """A Load Trajectory command that waits for its Start Motion; control: its control byte."""

    control: int
    position: int = 0
    velocity: int = 0
    acceleration: int = 0
    pwm: int = 0


class ServoMoves:
    """The trajectory registers of one chip and the load that waits."""

    def __init__(self, chip: PicServo) -> None:
        self.chip = chip
        self.goal = 0
        self.velocity = 0
        self.acceleration = 0
        self.last: Load | None = None
        self.fresh = False
        self.stop_since_load = False

    def load(self, data: bytes) -> None:
        """Load Trajectory: keep the data, and execute them if bit 7 says so."""
        chip = self.chip
        if not data:
            chip.check_length(nmc.LOAD_TRAJECTORY, data, 1)
            return
        control = data[0]
        sizes = [4 * (control & 1), 4 * (control >> 1 & 1), 4 * (control >> 2 & 1), control >> 3 & 1]
        if not chip.check_length(nmc.LOAD_TRAJECTORY, data, 1 + sum(sizes)):
            return
        load = Load(control)
        at = 1
        if control & POSITION:
            load.position = int.from_bytes(data[at : at + 4], "little", signed=True)
            if load.position == -0x80000000:
                chip.violation("SV-121", "position -0x80000000 is out of range")
            at += 4
        if control & VELOCITY:
            load.velocity = self._magnitude("velocity", data[at : at + 4])
            at += 4
        if control & ACCELERATION:
            load.acceleration = self._magnitude("acceleration", data[at : at + 4])
            at += 4
        if control & PWM:
            load.pwm = data[at]
        self._keep(load)
        self.last = load
        self.fresh = True
        self.stop_since_load = False
        if control & START_NOW:
            self.start()

    def _magnitude(self, what: str, data: bytes) -> int:
        value = int.from_bytes(data, "little")
        if value > 0x7FFFFFFF:
            self.chip.violation("SV-122", f"{what} 0x{value:08X} is above 0x7FFFFFFF: that taken")
            return 0x7FFFFFFF
        return value

    def start(self) -> None:
        """Start Motion: execute the most recent load."""
        chip, load = self.chip, self.last
        if not self.fresh:
            chip.violation("X-47", "Start Motion with nothing freshly loaded: the last load is executed again")
        elif self.stop_since_load:
            chip.violation("X-48", "Start Motion of a load that is older than the last Stop Motor")
        self.fresh = False
        self.stop_since_load = False
        if load is not None:
            self._begin(load)

    def _keep(self, load: Load) -> None:
        """Parameters that are not loaded keep the values that were loaded before, executed or not."""
        if load.control & POSITION:
            self.goal = load.position
        if load.control & VELOCITY:
            self.velocity = load.velocity
        if load.control & ACCELERATION:
            self.acceleration = load.acceleration

    def _begin(self, load: Load) -> None:
        n = self.chip.n
        control = load.control
        n[k.ACCEL] = self.acceleration
        if not control & SERVO_MODE:
            self._raw_pwm(load)
        elif control & VELOCITY_MODE:
            k.servo_on(n)
            n[k.MODE] = k.MODE_VELOCITY
            n[k.GOAL_VELOCITY] = -self.velocity if control & REVERSE else self.velocity
            n[k.MOVE_DONE] = n[k.VELOCITY] == n[k.GOAL_VELOCITY]
            n[k.ACCEL_DONE] = n[k.SLEW_DONE] = 0
        else:
            self._trapezoid()

    def _raw_pwm(self, load: Load) -> None:
        n = self.chip.n
        if n[k.SERVO_ON] and not n[k.MOVE_DONE]:
            self.chip.violation("SV-126", "PWM mode entered while a profile is moving")
        pwm = load.pwm if load.control & PWM else int(n[k.RAW_PWM])
        k.servo_off(n)
        n[k.RAW_PWM] = n[k.PWM] = pwm
        n[k.DIR] = bool(load.control & REVERSE)

    def _trapezoid(self) -> None:
        chip, n = self.chip, self.chip.n
        if n[k.SERVO_ON] and n[k.MODE] == k.MODE_TRAPEZOID and not n[k.MOVE_DONE]:
            chip.violation("X-07", "trapezoid changed before its end: erratic motion")
            if chip.options.trapezoid_change == "jump":
                n[k.COMMAND] = n[k.TARGET]
        elif n[k.SERVO_ON] and n[k.VELOCITY] != 0:
            chip.violation("SV-124", "trapezoid started at a velocity that is not 0: the velocity jumps to 0")
        k.servo_on(n)
        n[k.MODE] = k.MODE_TRAPEZOID
        n[k.VELOCITY] = 0
        n[k.PEAK_VELOCITY] = self.velocity
        whole = int(n[k.COMMAND]) >> 16
        distance = self.goal - wrap32(whole)
        if abs(distance) > 0x7FFFFFFF:
            chip.violation("SV-121", "goal is more than 0x7FFFFFFF away")
        n[k.TARGET] = (whole + distance) << 16
        n[k.ACCEL_DONE] = n[k.SLEW_DONE] = 0
        n[k.MOVE_DONE] = n[k.TARGET] == n[k.COMMAND]
        if not n[k.MOVE_DONE] and (self.velocity == 0 or n[k.ACCEL] == 0):
            chip.violation("X-90", "trapezoid with velocity or acceleration 0: it never ends")

    def stop(self, control: int, position: int | None) -> None:
        """Stop Motor in one of four manners; AMP_EN follows bit 0 whatever else is said."""
        chip, n = self.chip, self.chip.n
        chip.zero_bits("SV-146", control, 0xE0)
        if (control & 0x1E).bit_count() > 1:
            chip.violation("SV-146", "Stop Motor in more than one manner at once")
        n[k.AMP] = control & 1
        if control & 0x1E:
            self.stop_since_load = True
        if control & 0x02:
            k.servo_off(n)
        elif control & 0x04:
            k.stop_abruptly(n)
        elif control & 0x08:
            k.stop_smoothly(n)
        elif control & 0x10:
            self._stop_here(position)

    def _stop_here(self, position: int | None) -> None:
        chip, n = self.chip, self.chip.n
        if chip.spec.version < 2:
            chip.violation("SV-145", "Stop Here does not exist in version 1: ignored")
        elif position is None:
            chip.violation("X-03", "Stop Here without a position: not executed")
        else:
            if not n[k.SERVO_ON]:
                k.servo_on(n)
            n[k.MODE] = k.MODE_VELOCITY
            n[k.VELOCITY] = n[k.GOAL_VELOCITY] = 0
            n[k.MOVE_DONE] = 1
            whole = int(n[k.COMMAND]) >> 16
            n[k.COMMAND] = (whole + wrap32(position - wrap32(whole))) << 16

    def set_gain(self, data: bytes) -> None:
        """Set Gain: Kp, Kd, Ki, IL, OL, CL, EL, SR, deadband."""
        chip, n = self.chip, self.chip.n
        for at, register, most in ((0, k.KP, 0x7FFF), (2, k.KD, 0x7FFF), (4, k.KI, 0x7FFF), (6, k.IL, 0x7FFF)):
            n[register] = self._at_most(int.from_bytes(data[at : at + 2], "little"), most)
        n[k.OL], n[k.CL] = data[8], data[9]
        n[k.EL] = self._at_most(int.from_bytes(data[10:12], "little"), 0x3FFF)
        if data[12] == 0:
            chip.violation("SV-130", "servo rate divisor 0: 1 taken")
        n[k.SR] = max(data[12], 1)
        n[k.DEADBAND] = data[13]
        bound = int(n[k.IL]) * 256
        n[k.SUM] = min(max(int(n[k.SUM]), -bound), bound)

    def _at_most(self, value: int, most: int) -> int:
        if value > most:
            self.chip.violation("SV-130", f"gain or limit {value} is above {most}: that taken")
        return min(value, most)

    def set_homing(self, control: int) -> None:
        """Begin to watch the flagged conditions for a change from now on (X-74)."""
        chip, n = self.chip, self.chip.n
        if (control & 0x34).bit_count() > 1:
            chip.violation("SV-161", "Set Homing Mode with more than one manner of stopping")
        n[k.HOMING] = control | 0x100
        n[k.HOMING_FROM] = n[k.INPUTS]

    def reset_position(self, offset: int) -> None:
        """Reset Position: counter and command position change together, so the motor does not jump."""
        chip, n = self.chip, self.chip.n
        if n[k.MODE] == k.MODE_TRAPEZOID and not n[k.MOVE_DONE]:
            chip.violation("SV-101", "Reset Position during a trapezoid")
        moved = offset - int(n[k.POS])
        n[k.POS] = offset
        n[k.LAST_POS] = wrap32(int(n[k.LAST_POS]) + moved)
        n[k.COMMAND] = n[k.TARGET] = offset << 16

    def reset_relative(self, mode: int) -> None:
        """Reset Position with one data byte: newer firmware, relative to home (X-02)."""
        chip = self.chip
        if chip.options.reset_relative_home and mode & 1:
            self.reset_position(int(chip.n[k.POS]) - int(chip.n[k.HOME]))
        else:
            chip.violation("X-02", "Reset Position with a data byte belongs to another version: not executed")
