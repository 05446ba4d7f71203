"""What is on the buses: frozen descriptions of modules, switches and the host; choices where the sheets are silent.

The rules named ``X-nn`` are the project's list of silences and contradictions of the data sheets; each choice is an
option here, so that a host can be tried against the other reading as well.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

CountLatch = Literal["rollover", "immediate"]
FirstPulse = Literal["period", "immediate"]
SwitchPin = Literal["limit1", "limit2", "home"]


@dataclass(frozen=True, slots=True)
class Switch:
    """A switch on the mechanics: its pin is HIGH while ``from_steps <= position <= to_steps`` (None: without end).

    Positions are steps (or counts) relative to the mechanical zero, which the chip's counter does not know.
    active_high False: the pin is LOW there and HIGH elsewhere.
    """

    pin: SwitchPin
    from_steps: int | None
    to_steps: int | None
    active_high: bool = True


@dataclass(frozen=True, slots=True)
class StepModule:
    """A PIC-STEP and what hangs on it.

    crystal_ppm: error of its crystal, > 0 fast; crystal_ppm_max: a further error drawn uniformly within +/- that.
    start_delay_max_ns: a command executes U(0, that) after its last byte; reply_delay_max_ns: the reply's first bit
    leaves U(0, that) after it (PIC-STEP data sheet section 3.1: within 0.5 ms). count_latch: when a new count acts
    in motion (X-61). first_pulse: one period after the start, or at once (X-62). start_steps: mechanical position when
    power comes on.
    ldcn: the two differences of the LDCN dialect (status item bit 6 = outputs; six parameter bytes).
    """

    name: str
    crystal_ppm: float = 0.0
    crystal_ppm_max: float = 0.0
    start_delay_max_ns: int = 250_000
    reply_delay_max_ns: int = 500_000
    count_latch: CountLatch = "rollover"
    first_pulse: FirstPulse = "period"
    switches: tuple[Switch, ...] = ()
    start_steps: int = 0
    temperature: int = 255
    ldcn: bool = False
    version: int = 1


@dataclass(frozen=True, slots=True)
class SimOptions:
    """Choices that hold for all modules.

    reached_stop_is_stopped: a reached stop position counts as mode Stopped (X-64).
    power_phase_max_ns: chips come up within this time of power-on, each with its own phase.
    trace_bus: keep every byte of the buses in the trace. spool_directory: where long traces are kept while growing.
    """

    reached_stop_is_stopped: bool = True
    power_phase_max_ns: int = 1_000_000
    trace_bus: bool = True


Module = StepModule


@dataclass(frozen=True, slots=True)
class BusSpec:
    """One serial bus. modules: in chain order, the first is farthest from the host and gets address 1.

    host_jitter_max_ns: every write of the host waits U(0, that) before its first bit leaves.
    """

    name: str
    modules: tuple[Module, ...] = field(default=())
    host_jitter_max_ns: int = 0
