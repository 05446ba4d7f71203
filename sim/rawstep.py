"""Shorthands of PIC-STEP commands for experiments and tests: loads by meaning, bytes by hand."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sim.build import Simulation
from sim.rawhost import RawHost, i32

# speed mode bits of Set Parameters: multiple, timer clock in Hz (data sheet section 4.1)
MODES = {3: (1, 625_000), 2: (2, 1_250_000), 1: (4, 2_500_000), 0: (8, 5_000_000)}


def count_for(rate: float, bits: int) -> int:
    """Initial timer count for ``rate`` steps/s. Section 4.1, Table 2: 65,536 - clock / S + {2, 4, 8, 16}."""
    multiple, clock = MODES[bits]
    return round(65536 - clock / rate + 2 * multiple)


def load_count(
    host: RawHost,
    count: int,
    *,
    reverse: bool = False,
    position: int | None = None,
    speed: int = 10,
    start: bool = True,
    address: int = 1,
) -> None:
    """Load a timer count and perhaps a stop position; bit 7 unless ``start`` is False."""
    control = 0x08 | (0x10 if reverse else 0) | (0x80 if start else 0)
    data = b"" if position is None else i32(position)
    control |= 0x01 if position is not None else 0
    host.exchange(address, 0x4, [control, *data, *count.to_bytes(2, "little"), speed])


def load_profile(
    host: RawHost,
    *,
    speed: int | None = None,
    acceleration: int | None = None,
    position: int | None = None,
    reverse: bool = False,
    start: bool = True,
) -> None:
    """Load what is given of a velocity profile or, with a position, of a trapezoid."""
    control = (0x10 if reverse else 0) | (0x80 if start else 0)
    data = b""
    for bit, value in ((1, position), (2, speed), (4, acceleration)):
        if value is not None:
            control |= bit
            data += i32(value) if bit == 1 else bytes([value])
    host.exchange(1, 0x4, [control, *data])


def gaps_ns(simulation: Simulation, name: str = "M1") -> npt.NDArray[np.float64]:
    """Times between successive pulses of a motor so far."""
    return np.diff(simulation.trace().pulses_ns(name))
