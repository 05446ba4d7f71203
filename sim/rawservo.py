"""Shorthands of PIC-SERVO commands for experiments and tests: moves by meaning, bytes by hand."""

from __future__ import annotations

import struct

from sim.picservo import PicServo
from sim.rawhost import RawHost, i32
from sim.spec import ServoPlant

LOCKED = ServoPlant(stop_low_counts=0.5, stop_high_counts=0.5)  # the shaft is held in the middle of count 0
Gains = tuple[int, ...]


def gains(
    kp: int = 0,
    kd: int = 0,
    ki: int = 0,
    il: int = 0,
    ol: int = 255,
    cl: int = 0,
    el: int = 0x3FFF,
    sr: int = 1,
    deadband: int = 0,
) -> Gains:
    """The nine values of Set Gain in their order (data sheet section 5.2)."""
    return (kp, kd, ki, il, ol, cl, el, sr, deadband)


def set_gain(host: RawHost, *values: int) -> bytes:
    """Set Gain with 14 data bytes."""
    return host.exchange(1, 0x6, struct.pack("<HHHHBBHBB", *values))


def stop_here(host: RawHost, position: int, amplifier: int = 1) -> bytes:
    """Stop Motor, Stop Here."""
    return host.exchange(1, 0x7, bytes([0x10 | amplifier]) + i32(position))


def velocity(
    host: RawHost, goal: int, acceleration: int | None = None, *, start: bool = True, address: int = 1
) -> None:
    """Load a signed goal velocity (16.16 counts/tick) and perhaps an acceleration, velocity mode."""
    control = 0x32 | (0x80 if start else 0) | (0x40 if goal < 0 else 0)
    data = i32(abs(goal))
    if acceleration is not None:
        control |= 0x04
        data += i32(acceleration)
    host.exchange(address, 0x4, [control, *data])


def trapezoid(
    host: RawHost, goal: int, peak: int | None = None, acceleration: int | None = None, *, start: bool = True
) -> None:
    """Load a goal position and perhaps velocity and acceleration, trapezoidal profile mode."""
    control = 0x11 | (0x80 if start else 0)
    data = i32(goal)
    for bit, value in ((2, peak), (4, acceleration)):
        if value is not None:
            control |= bit
            data += i32(value)
    host.exchange(1, 0x4, [control, *data])


def tick(host: RawHost, chip: PicServo, count: int = 1) -> list[int]:
    """Let ``count`` servo ticks end; the registers after them."""
    host.link.sleep_until(chip.clock.ns_of(chip.clock.tick_at(host.link.now_ns()) + count))
    chip.synchronise()
    return [int(x) for x in chip.n]


def auxiliary(host: RawHost) -> int:
    """The auxiliary status byte."""
    return host.items(1, 0x08, 1)[0]
