"""What hangs on a serial port of its own: a CY545, described; choices where its manual is silent."""

from __future__ import annotations

from dataclasses import dataclass

from nmc.chips.cy545 import TABLE_CRYSTAL_MHZ, RateTable
from sim.spec import Switch


@dataclass(frozen=True, slots=True)
class Cy545Port:
    """A CY545 and its line.

    name: of its motor; port: of the line. baud: the rate its receiver is set to. crystal_mhz: nominal (Fcy);
    crystal_ppm: error, > 0 fast; crystal_ppm_max: a further error drawn uniformly within +/- that. execute_ns: from a
    carriage return to the command's effect; start_delay_max_ns: a motion begins U(0, that) after it. switch: on the
    mechanics, read by the host over its own line. start_steps: mechanical position when power comes on.
    host_jitter_max_ns: every write of the host waits U(0, that) before its first bit leaves.
    """

    name: str
    port: str
    rates: RateTable
    baud: int = 9600
    crystal_mhz: float = TABLE_CRYSTAL_MHZ
    crystal_ppm: float = 0.0
    crystal_ppm_max: float = 0.0
    execute_ns: int = 500_000
    start_delay_max_ns: int = 0
    switch: Switch | None = None
    start_steps: int = 0
    host_jitter_max_ns: int = 0
