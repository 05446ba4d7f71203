"""What a machine file may say: one frozen model a table, an unknown key is an error.

Lengths are in mm (degrees on rotary axes), times in s, unless a key's own name says otherwise. Every number may be
arithmetic in a string (``arith.py``). ``load.py`` turns a file into a :class:`MachineConfig` with all of its errors at
once; rules that span several tables are in ``checks.py``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from machines.arith import number, whole
from machines.outputs_schema import AnalogTable, CoolantTable, OutputTable, SpindleTable
from machines.tables import Address, Byte, NotNegative, Number, Positive, Scale, ServoTable, Table
from machines.usercommands import UserCommandTable

CountLatch = Literal["rollover", "immediate", "unknown"]
FirstStep = Literal["period", "immediate", "unknown"]
Chip = Literal["pic-step", "pic-servo", "cy545"]

CHIPS = ("pic-step", "pic-servo", "cy545")
SHORTEST_WATCHDOG_MS = 30
"""At 9600 baud the nulls that end a half-sent packet alone take most of this."""
JITTER_MAX_MS = 100
"""A host that hesitates for longer keeps no chip on any path."""
CRYSTAL_MAX_PPM = 2000
"""Crystals are off by tens of parts in a million, ceramic resonators by a few thousand at the very most."""
BAUDS = (9600, 19200, 57600, 115200)
"""The rates both NMC data sheets list under Set Baud Rate."""


HostJitter = Annotated[float, BeforeValidator(number), Field(ge=0, le=JITTER_MAX_MS)]
CrystalError = Annotated[float, BeforeValidator(number), Field(ge=-CRYSTAL_MAX_PPM, le=CRYSTAL_MAX_PPM)]


class MachineTable(Table):
    """``[machine]``. ``path_tolerance``: mm, what G64 without P means."""

    name: str = Field(min_length=1)
    kinematics: Literal["cartesian"] = "cartesian"
    path_tolerance: Positive = 0.01


class BusTable(Table):
    """``[bus.NAME]``. ``port``: ``sim`` or a serial port. ``host_jitter_ms``: the host's own delay, at most.

    ``watchdog_ms``: silence of this program after which its watchdog process stops the motors of a port; 0: none.
    """

    port: str = Field(default="sim", min_length=1)
    baud: Annotated[int, BeforeValidator(whole)] = 115200
    host_jitter_ms: HostJitter | None = None
    watchdog_ms: Annotated[float, BeforeValidator(number), Field(allow_inf_nan=False)] = 100.0

    @model_validator(mode="after")
    def _long_enough(self) -> BusTable:
        if self.watchdog_ms != 0 and self.watchdog_ms < SHORTEST_WATCHDOG_MS:
            raise ValueError(f"watchdog_ms must be 0 (none) or at least {SHORTEST_WATCHDOG_MS}")
        return self

    @model_validator(mode="after")
    def _listed_baud(self) -> BusTable:
        if self.baud not in BAUDS:
            raise ValueError(f"baud {self.baud} is not one that the chips list: {', '.join(map(str, BAUDS))}")
        return self


class HomeTable(Table):
    """``[axis.X.home]``: seek ``switch`` in ``direction``, then its place is ``position`` in machine coordinates.

    ``velocity``: of the first approach; ``slow_velocity``: of the second, after backing off by ``backoff``.
    """

    switch: Literal["limit1", "limit2", "home", "index"] = "home"
    direction: Literal["positive", "negative"] = "negative"
    velocity: Positive = 10.0
    slow_velocity: Positive = 1.0
    backoff: Positive = 2.0
    position: Number = 0.0


class StepTable(Table):
    """``[axis.X.step]``: what Set Parameters of a PIC-STEP is told (data sheet section 5.1).

    ``speed_mode`` auto takes the slowest of 1x, 2x, 4x, 8x that reaches ``max_velocity``.
    """

    speed_mode: Literal["auto", "1x", "2x", "4x", "8x"] = "auto"
    minimum_speed: Annotated[int, BeforeValidator(whole), Field(ge=1, le=250)] = 1
    running_current: Byte = 128
    holding_current: Byte = 64
    thermal_limit: Byte = 0
    limit_autostop: bool = True
    estop: bool = True
    motor_off_on_stop: bool = False


class AxisKeys(Table):
    """What an axis may do, whatever drives it. ``travel``: least and greatest machine coordinate."""

    max_velocity: Positive
    max_acceleration: Positive
    max_jerk: Positive | None = None
    pull_in_velocity: NotNegative = 0.0
    travel: tuple[Number, Number]
    home: HomeTable | None = None

    @model_validator(mode="before")
    @classmethod
    def _travel_is_a_pair(cls, data: Any) -> Any:
        if isinstance(data, dict) and isinstance(data.get("travel"), list):
            return data | {"travel": tuple(data["travel"])}
        return data

    @model_validator(mode="after")
    def _travel_ascends(self) -> AxisKeys:
        if self.travel[0] >= self.travel[1]:
            raise ValueError("travel must be [least, greatest]")
        return self


TWIN = "twin"
"""How ``measured_on`` begins of what was measured on the simulated machine."""


class Measured(Table):
    """Of every record of a measurement. ``measured_on``: the port, or ``twin`` and its seed; ``date``: of that day."""

    date: str = ""
    measured_on: str = ""


class CrystalTable(Measured):
    """``[axis.X.crystal]``, written by calibrate: the module's crystal runs ``ppm`` fast against the host's clock.

    ``within_ppm``: it is certainly within plus or minus that of it.
    """

    ppm: CrystalError
    within_ppm: Annotated[float, BeforeValidator(number), Field(gt=0, le=CRYSTAL_MAX_PPM)]


class ProbedTable(Measured):
    """``[axis.X.probed]``, written by probe-latch: what ``count_latch`` and ``first_step`` of the axis rest on.

    ``version``: of the module's firmware; ``load_trials``, ``start_trials``: runs that were looked at;
    ``start_delay_ms``, ``start_delay_error_ms``: mean time from a start's last byte to its execution, standard error.
    """

    version: Annotated[int, BeforeValidator(whole), Field(ge=0, le=255)]
    load_trials: Annotated[int, BeforeValidator(whole), Field(ge=0)] = 0
    start_trials: Annotated[int, BeforeValidator(whole), Field(ge=0)] = 0
    start_delay_ms: Number = 0.0
    start_delay_error_ms: NotNegative = 0.0


class MotorKeys(Table):
    """Where an NMC chip hangs: ``address`` counts the chain, 1 is the module farthest from the host."""

    bus: str
    address: Address
    crystal: CrystalTable | None = None


class StepMotorTable(MotorKeys):
    """A motor behind a PIC-STEP.

    ``steps_per_unit``: negative turns the motor round. ``count_latch``: when a count loaded while moving takes effect,
    ``first_step``: whether the first step comes one period after a start or at once; both as measured on this module.
    """

    chip: Literal["pic-step"]
    steps_per_unit: Scale
    count_latch: CountLatch = "unknown"
    first_step: FirstStep = "unknown"
    probed: ProbedTable | None = None
    step: StepTable = StepTable()


class AxisServoTable(ServoTable):
    """``[axis.X.servo]``: the gains, and ``lag_ms``: the shaft is commanded so much ahead of the plan."""

    lag_ms: Annotated[float, BeforeValidator(number), Field(ge=0, le=5)] = 0.0


class ServoMotorTable(MotorKeys):
    """A motor behind a PIC-SERVO."""

    chip: Literal["pic-servo"]
    counts_per_unit: Scale
    servo: AxisServoTable


class Cy545MotorTable(Table):
    """A motor behind a CY545: a serial port of its own (``bus``), no address.

    ``rate_table``: a CSV file, or the shipped stand-in. ``crystal_mhz``: of the chip. ``abort_line``: output of the
    port that holds INHIBIT_ABORT high while it is asserted, ``home_line``: input with the home switch, ``cts``: CTS is
    wired. ``command_gap_ms``: rest after each command.
    """

    chip: Literal["cy545"]
    bus: str
    steps_per_unit: Scale
    rate_table: str = Field(default="stand-in", min_length=1)
    crystal_mhz: Annotated[float, BeforeValidator(number), Field(ge=1, le=24)] = 12.0
    abort_line: Literal["none", "rts", "dtr"] = "none"
    home_line: Literal["none", "cts", "dsr", "cd", "ri"] = "none"
    cts: bool = False
    command_gap_ms: Annotated[float, BeforeValidator(number), Field(ge=1, le=100)] = 5.0


class StepAxis(AxisKeys, StepMotorTable):
    """``[axis.X]`` that is its own first motor, a PIC-STEP."""


class ServoAxis(AxisKeys, ServoMotorTable):
    """``[axis.X]`` that is its own first motor, a PIC-SERVO."""


class Cy545Axis(AxisKeys, Cy545MotorTable):
    """``[axis.A]`` that is its own only motor, a CY545."""


class StepExtra(StepMotorTable):
    """``[motor.Y2]``: a further motor of ``axis``."""

    axis: str


class ServoExtra(ServoMotorTable):
    """``[motor.Y2]``: a further motor of ``axis``."""

    axis: str


class ModuleTable(MotorKeys):
    """``[module.NAME]``: a module of a bus that moves no axis: a PIC-I/O, or a PIC-SERVO whose PWM is an output."""

    chip: Literal["pic-io", "pic-servo"]


def _chip(value: Any) -> str:
    """The tag of the union: the chip named, or one that lets the missing or wrong name be reported."""
    chip = value.get("chip") if isinstance(value, dict) else getattr(value, "chip", None)
    return chip if isinstance(chip, str) else "missing"


AnyAxis = Annotated[
    Annotated[StepAxis, Tag("pic-step")] | Annotated[ServoAxis, Tag("pic-servo")] | Annotated[Cy545Axis, Tag("cy545")],
    Discriminator(_chip),
]
AnyMotor = Annotated[
    Annotated[StepExtra, Tag("pic-step")] | Annotated[ServoExtra, Tag("pic-servo")], Discriminator(_chip)
]


class PlantTable(Table):
    """``[sim.axis.X.plant]``: motor, amplifier, encoder, screw and load behind a PIC-SERVO, from their data sheets.

    One turn is ``lines_per_rev`` * 4 counts and ``lead_mm`` of travel. ``load_nm``: constant torque on the shaft;
    ``stop_low_at``, ``stop_high_at``: hard end stops in machine coordinates; ``index_at``: where the index begins.
    """

    supply_v: Positive = 24.0
    resistance_ohm: Positive = 1.5
    inductance_h: NotNegative = 1e-3
    torque_nm_per_a: Positive = 0.045
    inertia_kgm2: Positive = 2.6e-5
    coulomb_nm: NotNegative = 0.012
    viscous_nms: NotNegative = 0.0
    load_nm: Number = 0.0
    lines_per_rev: Annotated[int, BeforeValidator(whole), Field(ge=1)] = 500
    lead_mm: Positive = 5.0
    load_mass_kg: NotNegative = 0.0
    stop_low_at: Number | None = None
    stop_high_at: Number | None = None
    sense_v_per_a: NotNegative = 1.0
    sense_inverted: bool = False
    index: bool = True
    index_at: Number = 0.0
    amp_deadband: NotNegative = 0.0


class SimMotor(Table):
    """``[sim.axis.X]``: what the twin adds to the motor of that name, places in machine coordinates.

    ``limit1_at``, ``limit2_at``: the limit switch closes at and beyond that place; ``home_at``: the home switch closes
    at and below it. ``crystal_ppm``: the module's own crystal error, instead of one drawn. ``start_at``: where the axis
    stands when power comes on (the host takes that for zero until it has homed).
    """

    crystal_ppm: CrystalError | None = None
    start_at: Number = 0.0
    limit1_at: Number | None = None
    limit2_at: Number | None = None
    home_at: Number | None = None
    plant: PlantTable = PlantTable()


class SimTable(Table):
    """``[sim]``. Random times are drawn between 0 and the value, crystals within plus or minus ``crystal_ppm``."""

    seed: Annotated[int, BeforeValidator(whole), Field(ge=0)] = 1
    host_jitter_ms: HostJitter = 0.0
    crystal_ppm: Annotated[float, BeforeValidator(number), Field(ge=0, le=CRYSTAL_MAX_PPM)] = 0.0
    start_delay_ms: Annotated[float, BeforeValidator(number), Field(ge=0, le=0.5)] = 0.0
    reply_delay_ms: Annotated[float, BeforeValidator(number), Field(ge=0, le=0.5)] = 0.5
    count_latch: Literal["rollover", "immediate"] = "rollover"
    first_step: Literal["period", "immediate"] = "period"
    axis: dict[str, SimMotor] = Field(default_factory=dict)
    spindle: PlantTable = PlantTable()
    """``[sim.spindle]``: motor and load of a spindle on a PIC-SERVO; its encoder is that of ``[spindle]``."""


class VerifyTable(Table):
    """``[verify]``: what a run on the twin may show and still be called good.

    ``contour_steps``: largest distance of the pins from the planned path; ``shaft_um``: of a PIC-SERVO's shaft from its
    planned place, None: what its axis's velocity gives (``machines.shafts``); ``end_error_steps``: of each axis at the
    end; simulated and planned time may differ by ``time_percent``, in any case by ``time_slack_s``.
    """

    contour_steps: NotNegative = 6.0
    shaft_um: NotNegative | None = None
    end_error_steps: Annotated[int, BeforeValidator(whole), Field(ge=0)] = 0
    time_percent: NotNegative = 1.0
    time_slack_s: NotNegative = 0.05
    output_ms: NotNegative = 5.0
    """How far an output may change from its planned instant."""


class MachineConfig(Table):
    """A whole machine file."""

    machine: MachineTable
    bus: dict[str, BusTable] = Field(min_length=1)
    axis: dict[str, AnyAxis] = Field(min_length=1)
    motor: dict[str, AnyMotor] = Field(default_factory=dict)
    module: dict[str, ModuleTable] = Field(default_factory=dict)
    spindle: SpindleTable | None = None
    coolant: CoolantTable | None = None
    output: dict[str, OutputTable] = Field(default_factory=dict)
    analog: dict[str, AnalogTable] = Field(default_factory=dict)
    user_command: dict[str, UserCommandTable] = Field(default_factory=dict)
    sim: SimTable = SimTable()
    verify: VerifyTable = VerifyTable()
