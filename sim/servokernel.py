"""The inner loop of a PIC-SERVO with its PIC-ENC and its motor, compiled: one call runs many servo ticks.

State is two arrays, so that a call costs a microsecond: ``n`` i8[N_SIZE] holds the chip's registers (names in capitals
below), ``f`` f8[F_SIZE] the plant. Section numbers are those of the PIC-SERVO data sheet. Units: counts, ticks, 16.16
fixed point for velocity and acceleration, 48.16 for the command position; plant in counts, seconds, volts, amperes.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from nmc.native import native

I8 = npt.NDArray[np.int64]
I4 = npt.NDArray[np.int32]
F8 = npt.NDArray[np.float64]

# registers of the chip
TICK, PHASE, POS, RAW16, COUNT, MEASURED, LAST_POS = 0, 1, 2, 3, 4, 5, 6
COMMAND, VELOCITY, GOAL_VELOCITY, ACCEL, TARGET, PEAK_VELOCITY = 7, 8, 9, 10, 11, 12
MODE, SERVO_ON, MOVE_DONE, POS_ERROR, OVERCURRENT, POS_WRAP, ACCEL_DONE, SLEW_DONE = 13, 14, 15, 16, 17, 18, 19, 20
HOMING, HOMING_FROM, HOME, HOMED_TICK = 21, 22, 23, 24
KP, KD, KI, IL, OL, CL, EL, SR, DEADBAND = 25, 26, 27, 28, 29, 30, 31, 32, 33
SUM, LAST_ERROR, OUTPUT, PWM, DIR, ADJUST, RAW_PWM = 34, 35, 36, 37, 38, 39, 40
AMP, INPUTS, AD, POWER, FAULTS, SAMPLES, EVERY, SKIP = 41, 42, 43, 44, 45, 46, 47, 48
IO_CONTROL, PRINTED_SIGN, VERSION, TRIPPED_TICK = 49, 50, 51, 52
N_SIZE = 53

# plant: state, then parameters
THETA, OMEGA, CURRENT = 0, 1, 2
SUPPLY, RESISTANCE, DECAY, BACK_EMF, TORQUE, COULOMB, VISCOUS, LOAD = 3, 4, 5, 6, 7, 8, 9, 10
STOP_LOW, STOP_HIGH, SENSE, SENSE_BASE, SUBSTEP_S, INDEX_EVERY, INDEX_WIDTH, INDEX_AT, AMP_DEADBAND = (
    11, 12, 13, 14, 15, 16, 17, 18, 19,
)  # fmt: skip
F_SIZE = 20

MODE_PWM, MODE_VELOCITY, MODE_TRAPEZOID = 0, 1, 2
IN_LIMIT1, IN_LIMIT2, IN_INDEX = 1, 2, 4
SUBSTEPS = 8
FASTEST_COUNTS_S = 500_000.0  # section 3.2
POWER_VOLTS = 12.0  # section 5.3


@native("i8(i8)", exact=True)
def wrap32(value: int) -> int:
    """A number as a 32-bit two's complement register holds it."""
    return (value + 0x80000000) % 0x100000000 - 0x80000000


@native("void(i8[::1])", exact=True)
def servo_off(n: I8) -> None:
    """The position servo is disabled: PWM 0, PWM mode, pos_error (sections 4.5, 5.3)."""
    n[SERVO_ON] = 0
    n[MODE] = MODE_PWM
    n[MOVE_DONE] = 1
    n[POS_ERROR] = 1
    n[RAW_PWM] = n[PWM] = n[OUTPUT] = n[ADJUST] = 0


@native("void(i8[::1])", exact=True)
def servo_on(n: I8) -> None:
    """Begin to servo where the motor is, at the velocity it has (section 4.5): no jump."""
    if n[SERVO_ON] == 0:
        n[SERVO_ON] = 1
        n[COMMAND] = n[POS] << 16
        n[VELOCITY] = n[MEASURED] << 16
        n[SUM] = n[LAST_ERROR] = n[ADJUST] = 0


@native("void(i8[::1])", exact=True)
def stop_abruptly(n: I8) -> None:
    """Stop Motor bit 2: command velocity and goal velocity 0, servo on, velocity mode."""
    servo_on(n)
    n[MODE] = MODE_VELOCITY
    n[VELOCITY] = n[GOAL_VELOCITY] = 0
    n[MOVE_DONE] = 1


@native("void(i8[::1])", exact=True)
def stop_smoothly(n: I8) -> None:
    """Stop Motor bit 3: goal velocity 0, velocity mode, present acceleration."""
    servo_on(n)
    n[MODE] = MODE_VELOCITY
    n[GOAL_VELOCITY] = 0
    n[MOVE_DONE] = 1 if n[VELOCITY] == 0 else 0


@native()
def _plant(n: I8, f: F8) -> None:
    """One full-rate tick of motor, amplifier, friction and end stops under the PWM that stands."""
    powered = n[AMP] != 0 and f[SUPPLY] > 0.0
    duty = max(0.0, n[PWM] - f[AMP_DEADBAND]) / 255.0
    volts = f[SUPPLY] * duty * (-1.0 if n[DIR] else 1.0)
    dt, decay, rub = f[SUBSTEP_S], f[DECAY], f[COULOMB] * f[SUBSTEP_S]
    theta, omega, current = f[THETA], f[OMEGA], f[CURRENT]
    for _ in range(SUBSTEPS):
        if powered:
            settled = (volts - f[BACK_EMF] * omega) / f[RESISTANCE]
            current = settled + (current - settled) * decay
        else:
            current = 0.0
        omega += (f[TORQUE] * current + f[LOAD] - f[VISCOUS] * omega) * dt
        # dry friction takes at most all of the speed away, so it can hold but never drive
        omega = 0.0 if abs(omega) <= rub else omega - math.copysign(rub, omega)
        theta += omega * dt
        if theta < f[STOP_LOW]:
            theta, omega = f[STOP_LOW], 0.0
        elif theta > f[STOP_HIGH]:
            theta, omega = f[STOP_HIGH], 0.0
    f[THETA], f[OMEGA], f[CURRENT] = theta, omega, current


@native()
def _encoder(n: I8, f: F8) -> None:
    """PIC-ENC: a 16-bit wrapping count, extended to 32 bits; edges closer than 2 us are missed (section 3.2, 4.2)."""
    count = math.floor(f[THETA])
    moved = count - n[COUNT]
    n[COUNT] = count
    if abs(f[OMEGA]) > FASTEST_COUNTS_S:
        n[FAULTS] += 1
        return
    raw = (n[RAW16] + moved) & 0xFFFF
    seen = ((raw - n[RAW16] + 0x8000) & 0xFFFF) - 0x8000
    n[RAW16] = raw
    position = wrap32(n[POS] + seen)
    if position != n[POS] + seen:
        n[POS_WRAP] = 1
    n[POS] = position


@native()
def _inputs(n: I8, f: F8, switches: I8, before: int) -> bool:
    """Read limit pins, index, A/D; returns whether the index went by since the last tick."""
    count, value = n[COUNT], 0
    for k in range(switches.shape[0]):
        inside = switches[k, 1] <= count <= switches[k, 2]
        if inside == (switches[k, 3] != 0):
            value |= switches[k, 0]
    control = n[IO_CONTROL]  # bits 0, 1 output values; 2, 3 direction, 1 = input
    for pin in range(2):
        if not control >> (2 + pin) & 1:
            value = value & ~(1 << pin) | (control >> pin & 1) << pin
    passed = False
    if f[INDEX_EVERY] > 0:
        every, at = int(f[INDEX_EVERY]), int(f[INDEX_AT])
        if (count - at) % every < int(f[INDEX_WIDTH]):
            value |= IN_INDEX
        passed = (count - at) // every != (before - at) // every
    n[INPUTS] = value
    n[AD] = int(min(255.0, max(0.0, f[SENSE_BASE] + f[SENSE] * abs(f[CURRENT]))))
    n[POWER] = 1 if f[SUPPLY] > POWER_VOLTS else 0
    return passed


@native()
def _limit_current(n: I8) -> bool:
    """Section 4.3: the adjustment grows by one a tick while over the limit and shrinks by one while under it (X-05)."""
    limit = n[CL] & ~1
    if n[CL] == 0:
        n[ADJUST] = 0
        return False
    over = n[AD] > limit if n[CL] & 1 else n[AD] < limit
    if over:
        n[ADJUST] = min(n[ADJUST] + 1, abs(n[OUTPUT]) >> 8, n[OL])
        n[OVERCURRENT] = 1
    else:
        n[ADJUST] = max(n[ADJUST] - 1, 0)
    return bool(over)


@native()
def braking_distance(velocity: int, accel: int) -> int:
    """Distance of v - a, v - 2a, ... until it would not be positive any more."""
    steps = (velocity - 1) // accel if velocity > 0 else 0
    return steps * velocity - accel * (steps * (steps + 1) // 2)


@native()
def _trapezoid(n: I8) -> None:
    """One tick of a position move: the greatest velocity from which the goal can still be braked for (section 4.4)."""
    accel = n[ACCEL]
    if accel == 0 or n[PEAK_VELOCITY] == 0:
        return
    sign = 1 if n[TARGET] >= n[COMMAND] else -1
    left = abs(n[TARGET] - n[COMMAND])
    speed = abs(n[VELOCITY])
    for step in (accel, 0, -accel):
        tried = min(speed + step, n[PEAK_VELOCITY], left)
        if tried > 0 and left - tried >= braking_distance(tried, accel):
            break
    tried = min(max(tried, 1), left)
    if tried == n[PEAK_VELOCITY] or tried < speed + accel:
        n[ACCEL_DONE] = 1
    if tried < speed or tried == left:
        n[SLEW_DONE] = 1
    n[COMMAND] += sign * tried
    n[VELOCITY] = sign * tried
    if n[COMMAND] == n[TARGET]:
        n[VELOCITY] = 0
        n[MOVE_DONE] = n[ACCEL_DONE] = n[SLEW_DONE] = 1


@native()
def _profile(n: I8) -> None:
    """Where the motor should be at this tick (section 4.4)."""
    if n[MODE] == MODE_TRAPEZOID:
        if n[MOVE_DONE] == 0:
            _trapezoid(n)
        return
    velocity, goal = n[VELOCITY], n[GOAL_VELOCITY]
    if velocity < goal:
        velocity = min(velocity + n[ACCEL], goal)
    elif velocity > goal:
        velocity = max(velocity - n[ACCEL], goal)
    n[VELOCITY] = velocity
    n[COMMAND] += velocity
    n[MOVE_DONE] = 1 if velocity == goal else 0


@native()
def _filter(n: I8) -> bool:
    """The PID filter in integers (section 4.3); returns whether the position error limit was exceeded."""
    error = wrap32((n[COMMAND] >> 16) - n[POS])
    exceeded = abs(error) > n[EL]
    if exceeded:
        servo_off(n)
        n[TRIPPED_TICK] = n[TICK]
        return True
    bound = n[IL] * 256
    n[SUM] = min(max(n[SUM] + error, -bound), bound)
    change = error - n[LAST_ERROR]
    n[LAST_ERROR] = error
    damping = n[KD] * change
    if n[PRINTED_SIGN]:  # the sheet's formula as printed, which amplifies
        damping = -damping
    n[OUTPUT] = n[KP] * error + damping + n[KI] * (n[SUM] >> 8)
    if n[OUTPUT] != 0:
        n[DIR] = 1 if n[OUTPUT] < 0 else 0
    return False


@native()
def _drive(n: I8) -> None:
    """PWM = min(|output / 256|, OL) - adjustment, plus the deadband compensation (section 4.3, 5.2)."""
    magnitude = max(min(abs(n[OUTPUT]) >> 8, n[OL]) - n[ADJUST], 0)
    if n[OUTPUT] != 0:
        magnitude = min(magnitude + n[DEADBAND], 255)
    n[PWM] = magnitude


@native()
def _home(n: I8, index_passed: bool, error: bool, limiting: bool) -> None:
    """Set Homing Mode: any flagged condition captures the position and stops in the flagged manner (section 5.2)."""
    flags = n[HOMING]
    if flags == 0:
        return
    changed = n[INPUTS] ^ n[HOMING_FROM]
    hit = ((flags & 1) != 0 and (changed & IN_LIMIT1) != 0) or ((flags & 2) != 0 and (changed & IN_LIMIT2) != 0)
    hit = hit or ((flags & 8) != 0 and ((changed & IN_INDEX) != 0 or index_passed))
    hit = hit or ((flags & 0x40) != 0 and error) or ((flags & 0x80) != 0 and limiting)
    if not hit:
        return
    n[HOMING] = 0
    n[HOME] = n[POS]
    n[HOMED_TICK] = n[TICK]
    if n[VERSION] < 3:
        return
    if flags & 4:
        servo_off(n)
    elif flags & 16:
        stop_abruptly(n)
    elif flags & 32:
        stop_smoothly(n)


@native("void(i8, i8[::1], f8[::1], i8[:, ::1], i8[::1], i4[::1])", exact=True)
def run(ticks: int, n: I8, f: F8, switches: I8, command: I8, position: I4) -> None:
    """Run ``ticks`` full-rate ticks. Samples go to command i8[K] (48.16) and position i4[K] from n[SAMPLES] on.

    There must be room.
    """
    for _ in range(ticks):
        n[TICK] += 1
        before = n[COUNT]
        _plant(n, f)
        _encoder(n, f)
        passed = _inputs(n, f, switches, before)
        if n[POWER] == 0 and n[SERVO_ON]:
            servo_off(n)
        error = limiting = False
        if n[SERVO_ON]:
            limiting = _limit_current(n)
        n[PHASE] += 1
        if n[PHASE] >= n[SR]:
            n[PHASE] = 0
            n[MEASURED] = wrap32(n[POS] - n[LAST_POS])
            n[LAST_POS] = n[POS]
            if n[SERVO_ON]:
                _profile(n)
                error = _filter(n)
        if n[SERVO_ON]:
            _drive(n)
        else:
            n[POS_ERROR] = 1
            n[PWM] = n[RAW_PWM]
            n[COMMAND] = n[POS] << 16
            n[VELOCITY] = n[MEASURED] << 16
        _home(n, passed, error, limiting)
        n[SKIP] += 1
        if n[EVERY] and n[SKIP] >= n[EVERY]:
            n[SKIP] = 0
            command[n[SAMPLES]] = n[COMMAND]
            position[n[SAMPLES]] = n[POS]
            n[SAMPLES] += 1
