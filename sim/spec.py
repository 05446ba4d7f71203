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
class ServoPlant:
    """Motor, amplifier, encoder, screw and load of one servo axis.

    supply_v; resistance_ohm, inductance_h: winding; torque_nm_per_a: Kt; inertia_kgm2: rotor and coupling;
    coulomb_nm, viscous_nms: friction; load_nm: constant torque on the shaft (a weight), > 0 pushes forward;
    lines_per_rev: of the encoder; lead_mm, load_mass_kg: the screw and what it moves (0: none); stop_low_counts,
    stop_high_counts: hard end stops (None: none); sense_v_per_a: current sense of the amplifier, 5 V = 255;
    sense_inverted: 5 V = no current; index: one pulse a turn, index_width_counts wide, beginning at index_at_counts;
    amp_deadband: PWM below which the amplifier gives nothing.
    """

    supply_v: float = 24.0
    resistance_ohm: float = 1.5
    inductance_h: float = 1e-3
    torque_nm_per_a: float = 0.045
    inertia_kgm2: float = 2.6e-5
    coulomb_nm: float = 0.012
    viscous_nms: float = 0.0
    load_nm: float = 0.0
    lines_per_rev: int = 500
    lead_mm: float = 5.0
    load_mass_kg: float = 0.0
    stop_low_counts: float | None = None
    stop_high_counts: float | None = None
    sense_v_per_a: float = 1.0
    sense_inverted: bool = False
    index: bool = True
    index_width_counts: int = 4
    index_at_counts: int = 0
    amp_deadband: float = 0.0


@dataclass(frozen=True, slots=True)
class ServoModule:
    """A PIC-SERVO with its PIC-ENC and motor.

    oscillator_mhz: 10..20 (section 3.0), scales tick and baud. start_counts: mechanical position at power-up; the
    counter starts at 0. limits: switches on the pins limit1 and limit2, in counts. version: of the firmware, 4 in the
    data sheet; 1 has no Stop Here, below 3 homing does not stop, below 4 Set Gain ignores a 14th byte.
    derivative_as_printed: the formula of section 4.3 taken literally, which amplifies (X-01). trace_every: one sample
    of command and position every so many ticks (0: none). moves: it moves an axis, so that the trace has it as a motor;
    False: a spindle or an output.
    """

    name: str
    crystal_ppm: float = 0.0
    crystal_ppm_max: float = 0.0
    plant: ServoPlant = ServoPlant()
    switches: tuple[Switch, ...] = ()
    start_counts: int = 0
    oscillator_mhz: float = 20.0
    version: int = 4
    derivative_as_printed: bool = False
    trace_every: int = 1
    moves: bool = True


@dataclass(frozen=True, slots=True)
class SimOptions:
    """Choices that hold for all modules.

    reached_stop_is_stopped: a reached stop position counts as mode Stopped (X-64).
    trapezoid_change: what a trapezoid started during a trapezoid does to the command position: "jump" to the old goal
    or "restart" from where it is (X-07). reset_relative_home: Reset Position with one data byte is accepted (X-02).
    power_phase_max_ns: chips come up within this time of power-on, each with its own phase.
    trace_bus: keep every byte of the buses in the trace.
    """

    reached_stop_is_stopped: bool = True
    trapezoid_change: Literal["jump", "restart"] = "jump"
    reset_relative_home: bool = False
    power_phase_max_ns: int = 1_000_000
    trace_bus: bool = True


@dataclass(frozen=True, slots=True)
class IoFollow:
    """An actuator with its sensor: input pin ``input`` takes the level of output pin ``output``, or its complement."""

    input: int
    output: int
    inverted: bool = False


@dataclass(frozen=True, slots=True)
class IoModule:
    """A PIC-I/O: 12 pins that are inputs until told otherwise, three A/D inputs, two PWM outputs, a timer.

    inputs: levels that the outside puts on pins 0..11; follows: inputs that actuators on the outputs move;
    analog: the A/D inputs, 0..255.
    """

    name: str
    crystal_ppm: float = 0.0
    crystal_ppm_max: float = 0.0
    reply_delay_max_ns: int = 500_000
    inputs: int = 0
    follows: tuple[IoFollow, ...] = ()
    analog: tuple[int, int, int] = (0, 0, 0)
    version: int = 2


Module = StepModule | ServoModule | IoModule


@dataclass(frozen=True, slots=True)
class BusSpec:
    """One serial bus. modules: in chain order, the first is farthest from the host and gets address 1.

    host_jitter_max_ns: every write of the host waits U(0, that) before its first bit leaves.
    """

    name: str
    modules: tuple[Module, ...] = field(default=())
    host_jitter_max_ns: int = 0
