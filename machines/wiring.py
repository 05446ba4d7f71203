"""The composition root's dictionary: what a machine file says, in the words of each room.

planner gets limits and motors, sim gets modules, nmc gets what it must find on each bus. Nothing is decided here that
the file does not say, except the speed mode of a PIC-STEP that is left to ``auto``.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gcode.canon import AXES
from machines.cy545 import cy545_tables, indexer_of, line_names, line_specs
from machines.outputs_rules import SPINDLE
from machines.schema import BusTable, MachineConfig, PlantTable, ServoMotorTable, SimMotor, StepMotorTable
from machines.travel import Travel
from nmc.budget import BusTiming
from nmc.chips.picservo import COUNTS_PER_LINE
from planner.cy545 import Indexer
from planner.motors import Motor, ServoMotor, StepMotor
from planner.quantize import speed_mode_for
from planner.stream import lead_in_ns
from planner.types import Limits
from sim.cy545_spec import Cy545Port
from sim.spec import BusSpec, IoModule, Module, ServoModule, ServoPlant, StepModule, Switch

NS_PER_MS = 1_000_000


def planned_axes(config: MachineConfig) -> tuple[str, ...]:
    """Axes of the machine in the order of the canonical commands."""
    return tuple(axis for axis in AXES if axis in config.axis)


def planner_limits(config: MachineConfig) -> Limits:
    """What planner may ask of the axes."""
    axes = planned_axes(config)
    tables = [config.axis[axis] for axis in axes]
    jerks = [table.max_jerk for table in tables]
    known = [jerk for jerk in jerks if jerk is not None]
    jumps = [0.0 if table.chip == "cy545" else table.pull_in_velocity for table in tables]
    return Limits(
        axes=axes,
        velocity=np.array([table.max_velocity for table in tables]),
        acceleration=np.array([table.max_acceleration for table in tables]),
        tolerance_mm=config.machine.path_tolerance,
        jerk=np.array([np.inf if jerk is None else jerk for jerk in jerks]) if known else None,
        velocity_jump=np.array(jumps) if any(jumps) else None,
    )


def travel(config: MachineConfig) -> Travel:
    """Soft limits of each axis, machine coordinates."""
    return {axis: config.axis[axis].travel for axis in planned_axes(config)}


def motor_tables(config: MachineConfig) -> dict[str, tuple[str, StepMotorTable]]:
    """PIC-STEP motors by name, each with the axis it follows: the axes' own first motors, then the further ones."""
    found: dict[str, tuple[str, StepMotorTable]] = {}
    for axis in planned_axes(config):
        table = config.axis[axis]
        if isinstance(table, StepMotorTable):
            found[axis] = (axis, table)
    for name, extra in config.motor.items():
        if isinstance(extra, StepMotorTable):
            found[name] = (extra.axis, extra)
    return found


def nmc_buses(config: MachineConfig) -> dict[str, BusTable]:
    """The buses with NMC modules, in the order of the file; the others are lines of CY545s."""
    lines = line_names(config)
    return {name: table for name, table in config.bus.items() if name not in lines}


def every_motor(config: MachineConfig) -> list[Motor | Indexer]:
    """All motors as a trace has them: those of the buses, then those on CY545s."""
    return [*motors(config), *indexers(config)]


PARK_EXCHANGES = 3
"""What parking costs a motor at most: a stop, and its group twice."""


def indexers(config: MachineConfig) -> list[Indexer]:
    """Motors on CY545s, in the order of their lines: after a move the others are parked and need their lead-in."""
    driven = motors(config)
    simulated = all(bus.port == "sim" for bus in config.bus.values())
    timings = [bus_timing(config, motor.bus, simulated) for motor in driven]
    lead_ns = max((lead_in_ns(driven, timing) for timing in timings), default=0)
    lead_ns += sum(PARK_EXCHANGES * timing.worst_ns(2) for timing in timings)
    return [indexer_of(config, axis, table, lead_ns) for axis, table in cy545_tables(config).items()]


def motors(config: MachineConfig) -> list[Motor]:
    """Motors as planner lowers to them, in the order of the buses and of their chains, as a trace has them."""
    buses = list(nmc_buses(config))
    found: list[Motor] = []
    for name, (axis, step) in motor_tables(config).items():
        mode = speed_mode(config, axis, step)
        found.append(StepMotor(name, axis, buses.index(step.bus), step.address, step.steps_per_unit, mode))
    for name, (axis, servo) in servo_tables(config).items():
        lead_ns = round(servo.servo.lag_ms * NS_PER_MS)
        bus = buses.index(servo.bus)
        found.append(ServoMotor(name, axis, bus, servo.address, servo.counts_per_unit, lead_ns=lead_ns))
    return sorted(found, key=lambda motor: (motor.bus, motor.address))


def command_leads_ns(config: MachineConfig) -> dict[str, int]:
    """How much ahead of the plan the command of each PIC-SERVO motor is given (``lag_ms``)."""
    return {motor.name: motor.lead_ns for motor in motors(config) if isinstance(motor, ServoMotor)}


def scale_of(motor: Motor | Indexer) -> float:
    """Steps or counts a unit, signed."""
    return motor.counts_per_unit if isinstance(motor, ServoMotor) else motor.steps_per_unit


SERVO_STANDS_WITHIN = 4


def stands_within(motor: Motor | Indexer) -> int:
    """Steps or counts by which a motor may stand beside its place: a servo's shaft is never quite still."""
    return SERVO_STANDS_WITHIN if isinstance(motor, ServoMotor) else 0


def speed_mode(config: MachineConfig, axis: str, table: StepMotorTable) -> int:
    """Speed mode 1, 2, 4 or 8: the file's, or the lowest that reaches the axis's greatest velocity."""
    if table.step.speed_mode != "auto":
        return int(table.step.speed_mode.removesuffix("x"))
    return speed_mode_for(abs(config.axis[axis].max_velocity * table.steps_per_unit))


def servo_tables(config: MachineConfig) -> dict[str, tuple[str, ServoMotorTable]]:
    """PIC-SERVO motors by name, each with the axis it follows."""
    found: dict[str, tuple[str, ServoMotorTable]] = {}
    for axis in planned_axes(config):
        table = config.axis[axis]
        if isinstance(table, ServoMotorTable):
            found[axis] = (axis, table)
    for name, extra in config.motor.items():
        if isinstance(extra, ServoMotorTable):
            found[name] = (extra.axis, extra)
    return found


def bus_specs(config: MachineConfig) -> list[BusSpec | Cy545Port]:
    """The simulated modules of every bus, in chain order; then the CY545s on lines of their own."""
    modules: dict[str, dict[int, Module]] = {bus: {} for bus in nmc_buses(config)}
    for name, (_, step) in motor_tables(config).items():
        modules[step.bus][step.address] = _step_module(config, name, step)
    for name, (_, servo) in servo_tables(config).items():
        modules[servo.bus][servo.address] = _servo_module(config, name, servo)
    for bus_name, address, module in other_modules(config):
        modules[bus_name][address] = module
    buses = [
        BusSpec(
            name=bus,
            modules=tuple(module for _, module in sorted(modules[bus].items())),
            host_jitter_max_ns=round(config.sim.host_jitter_ms * NS_PER_MS),
        )
        for bus in modules
    ]
    switches = {
        name: _switches(config.sim.axis.get(name, SimMotor()), table.steps_per_unit)
        for name, table in cy545_tables(config).items()
    }
    return [*buses, *line_specs(config, switches)]


def other_modules(config: MachineConfig) -> Iterator[tuple[str, int, Module]]:
    """Simulated modules that move no axis, each with bus and address: those of the file, and the spindle's."""
    ppm = config.sim.crystal_ppm
    for name, table in config.module.items():
        if table.chip == "pic-servo":
            yield table.bus, table.address, ServoModule(name=name, crystal_ppm_max=ppm, trace_every=0, moves=False)
            continue
        reply_ns = round(config.sim.reply_delay_ms * NS_PER_MS)
        yield table.bus, table.address, IoModule(name=name, crystal_ppm_max=ppm, reply_delay_max_ns=reply_ns)
    spindle = config.spindle
    if spindle is None or spindle.bus is None or spindle.address is None:
        return
    plant = config.sim.spindle
    if spindle.counts_per_rev is not None:
        plant = plant.model_copy(update={"lines_per_rev": max(round(spindle.counts_per_rev / COUNTS_PER_LINE), 1)})
    servo = ServoModule(name=SPINDLE, crystal_ppm_max=ppm, plant=_plant(plant, 1.0), trace_every=0, moves=False)
    yield spindle.bus, spindle.address, servo


def _step_module(config: MachineConfig, name: str, table: StepMotorTable) -> StepModule:
    sim = config.sim
    twin = sim.axis.get(name, SimMotor())
    return StepModule(
        name=name,
        crystal_ppm=twin.crystal_ppm or 0.0,
        crystal_ppm_max=sim.crystal_ppm if twin.crystal_ppm is None else 0.0,
        start_delay_max_ns=round(sim.start_delay_ms * NS_PER_MS),
        reply_delay_max_ns=round(sim.reply_delay_ms * NS_PER_MS),
        count_latch=sim.count_latch,
        first_pulse=sim.first_step,
        switches=tuple(_switches(twin, table.steps_per_unit)),
        start_steps=round(twin.start_at * table.steps_per_unit),
    )


def _servo_module(config: MachineConfig, name: str, table: ServoMotorTable) -> ServoModule:
    sim = config.sim
    twin = sim.axis.get(name, SimMotor())
    return ServoModule(
        name=name,
        crystal_ppm=twin.crystal_ppm or 0.0,
        crystal_ppm_max=sim.crystal_ppm if twin.crystal_ppm is None else 0.0,
        plant=_plant(twin.plant, table.counts_per_unit),
        switches=tuple(_switches(twin, table.counts_per_unit)),
        start_counts=round(twin.start_at * table.counts_per_unit),
    )


def _plant(table: PlantTable, counts_per_unit: float) -> ServoPlant:
    """The plant in counts; of end stops the lower place of the axis may be the higher one of a turned motor."""
    places = (table.stop_low_at, table.stop_high_at)
    stops = [None if at is None else at * counts_per_unit for at in (places if counts_per_unit > 0 else places[::-1])]
    same = table.model_dump(exclude={"stop_low_at", "stop_high_at", "index_at"})
    return ServoPlant(
        **same,
        stop_low_counts=stops[0],
        stop_high_counts=stops[1],
        index_at_counts=round(table.index_at * counts_per_unit),
    )


def _switches(plant: SimMotor, steps_per_unit: float) -> list[Switch]:
    """LIMIT1 ends forward steps and LIMIT2 reverse ones, so their places are in the motor's sense of direction."""
    found: list[Switch] = []
    if plant.limit1_at is not None:
        found.append(Switch("limit1", round(plant.limit1_at * steps_per_unit), None))
    if plant.limit2_at is not None:
        found.append(Switch("limit2", None, round(plant.limit2_at * steps_per_unit)))
    if plant.home_at is not None:
        place = round(plant.home_at * steps_per_unit)
        found.append(Switch("home", None, place) if steps_per_unit > 0 else Switch("home", place, None))
    return found


REAL_PORT_JITTER_MS = 2.0
"""What a host may add before a packet on a port whose ``host_jitter_ms`` nobody has measured."""


def bus_timing(config: MachineConfig, bus: int, simulated: bool) -> BusTiming:
    """What a stream assumes of a bus: the file's ``host_jitter_ms``, else the twin's, else a cautious value."""
    table = list(nmc_buses(config).values())[bus]
    jitter_ms = table.host_jitter_ms
    if jitter_ms is None:
        jitter_ms = config.sim.host_jitter_ms if simulated else REAL_PORT_JITTER_MS
    return BusTiming.at(table.baud, jitter_max_ns=round(jitter_ms * NS_PER_MS))
