"""From a machine description to a bus that is ready to stream: links, the nine start-up steps, parameters, amplifiers.

Whether a link is a port or the simulator is decided here and nowhere else. After ``bring_up`` every module rests,
parked, its amplifier on and its counter at zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from machines.cy545_lines import open_ports, simulated_indexers
from machines.gains import gains_of
from machines.outputs_events import Rig
from machines.outputs_hook import ready_rig, switch_off, switches_of
from machines.outputs_rules import SPINDLE
from machines.pauses import nothing_old_looked_at
from machines.schema import TWIN, BusTable, MachineConfig, ServoMotorTable, StepMotorTable
from machines.takeover import found_ready, take_over
from machines.troubles import servo_troubles, words_of
from machines.wiring import SERVO_STANDS_WITHIN, bus_specs, motor_tables, nmc_buses, servo_tables, speed_mode
from nmc.bus import Bus
from nmc.chips import picservo, picstep
from nmc.cy545 import Cy545
from nmc.errors import NmcError, RemoteFault
from nmc.executor import PARKED_GROUP, STREAMING_GROUP, has_motor, stop_together
from nmc.link import Link
from nmc.picservo import PicServo
from nmc.picstep import PicStep
from nmc.recording_link import RecordingLink
from nmc.setup import ModuleExpectation, ModuleInfo, set_group, start_up
from sim.build import Simulation, build

if TYPE_CHECKING:
    from nmc.watchdog import Switch
    from nmc.watchdog_process import SupervisedLink

SIM = "sim"
NS_PER_MS = 1_000_000
STEADY_POLL_NS = 10_000_000
STEADY_FOR_NS = 300_000_000
STEADY_WITHIN_NS = 3_000_000_000


@dataclass(slots=True)
class Connection:
    """The buses of a machine, in the order of its file. ``simulation``: the twin, None on real ports.

    ``indexers``: CY545s by axis, each on a line of its own, which is none of the buses.
    """

    config: MachineConfig
    links: list[Link]
    buses: list[Bus]
    simulation: Simulation | None
    modules: dict[str, list[ModuleInfo]] = field(default_factory=dict)
    indexers: dict[str, Cy545] = field(default_factory=dict)
    rig: Rig | None = None
    """Spindle, coolant and outputs, once the buses are up."""
    place: str = ""
    """Where it is: the ports, or ``twin`` and its seed; what is measured there is recorded with it."""

    def records(self) -> dict[str, list[str]]:
        """Bytes of real ports as text by bus; a simulated bus keeps its bytes in the trace."""
        links = dict(zip(nmc_buses(self.config), self.links, strict=True))
        links |= {f"{axis}-cy545": indexer.link for axis, indexer in self.indexers.items()}
        return {name: list(link.lines()) for name, link in links.items() if isinstance(link, RecordingLink)}

    def alive(self) -> None:
        """Tell the watchdogs that the host lives: between two bounded pieces of a longer reckoning, nowhere else."""
        for link in self.links:
            if (guard := supervised(link)) is not None:
                guard.beat()

    def close(self) -> None:
        """Switch off what still runs beside the axes, and give the ports back."""
        if self.rig is not None and self.rig.running:
            with suppress(NmcError):
                switch_off(self.rig, self.buses)
        for link in (*self.links, *(indexer.link for indexer in self.indexers.values())):
            link.close()


def is_simulated(config: MachineConfig, port: str | None = None) -> bool:
    """Whether this machine runs on its twin. A machine is on ports or on the twin as a whole."""
    if port is not None:
        return port == SIM
    return all(bus.port == SIM for bus in config.bus.values())


def connect(config: MachineConfig, port: str | None = None, seed: int | None = None) -> Connection:
    """Open every bus. ``port`` replaces that of a machine with one bus; ``seed`` that of the twin.

    Raises NmcError where a port cannot be opened, ValueError where ``port`` does not say which bus it means.
    """
    if is_simulated(config, port):
        seed = config.sim.seed if seed is None else seed
        simulation = build(bus_specs(config), seed)
        links = simulation.links[: len(nmc_buses(config))]
        chips = simulated_indexers(config, simulation)
        place = f"{TWIN}, seed {seed}"
        return Connection(config, links, _buses(config, links), simulation, indexers=chips, place=place)
    names = [bus.port for bus in nmc_buses(config).values()]
    if port is not None:
        if len(config.bus) != 1:
            raise ValueError(f"--port names one port, the machine has {len(config.bus)} buses; write them in its file")
        names = [port]
    if SIM in (*names, *(bus.port for bus in config.bus.values() if port is None)):
        raise ValueError("a machine is on ports or simulated as a whole; give every bus a port")
    opened: list[Link] = []
    try:
        for name, table in zip(names, nmc_buses(config).values(), strict=True):
            opened.append(RecordingLink(_port(name, table)))
        chips = open_ports(config, opened)
    except Exception:
        for link in opened:
            link.close()
        raise
    return Connection(config, opened, _buses(config, opened), None, indexers=chips, place=", ".join(names))


def _buses(config: MachineConfig, links: Sequence[Link]) -> list[Bus]:
    """One bus needs no name in errors, several do."""
    names = list(nmc_buses(config))
    return [Bus(link, name=name if len(names) > 1 else "") for name, link in zip(names, links, strict=True)]


def _port(name: str, table: BusTable) -> Link:
    from nmc.serial_link import SerialLink
    from nmc.watchdog_process import SupervisedLink

    return SupervisedLink(name) if table.watchdog_ms else SerialLink(name)


def bring_up(connection: Connection) -> bool:
    """Make every bus and motor ready; on ports that is first tried without a reset, so that positions are kept.

    Returns whether the counters are those of an earlier session. Raises NmcError with what was found where it should
    not be.
    """
    config = connection.config
    kept = connection.simulation is None and all(
        found_ready(bus, expectations(config, name), table.baud)
        for (name, table), bus in zip(nmc_buses(config).items(), connection.buses, strict=True)
    )
    for (name, table), bus in zip(nmc_buses(config).items(), connection.buses, strict=True):
        wanted = expectations(config, name)
        connection.modules[name] = take_over(bus, wanted) if kept else start_up(bus, wanted, table.baud)
    for name, (axis, step) in motor_tables(config).items():
        stepper = PicStep(bus_of(connection, step.bus), step.address)
        with _named(name):
            _ready_stepper(stepper, step, f"{speed_mode(config, axis, step)}x", kept)
    for name, (_, servo) in servo_tables(config).items():
        with _named(name, servo=True):
            _ready_servo(PicServo(bus_of(connection, servo.bus), servo.address), servo, kept)
    for indexer in connection.indexers.values():
        kept = indexer.start_up(kept) and kept
    connection.rig = ready_rig(config, connection.buses, connection.simulation is not None)
    for number, (table, bus) in enumerate(zip(nmc_buses(config).values(), connection.buses, strict=True)):
        _watch(connection.links[number], bus, table, switches_of(connection.rig, number))
    return kept


def _watch(link: Link, bus: Bus, table: BusTable, switches: Sequence[Switch]) -> None:
    """Tell the watchdog of a port what it must stop and switch off if this program dies."""
    from nmc.watchdog import Ward

    guarded = supervised(link)
    if guarded is not None:
        wards = [Ward(each.address, each.facts.name) for each in bus.guard.modules.values() if has_motor(each)]
        timeout_ns = round(table.watchdog_ms * NS_PER_MS)
        groups = (STREAMING_GROUP, PARKED_GROUP)
        guarded.watch(wards, groups, baud=table.baud, timeout_ns=timeout_ns, switches=switches)


def supervised(link: Link) -> SupervisedLink | None:
    """The link of a port that has a watchdog, whatever is around it."""
    inner = link.inner if isinstance(link, RecordingLink) else link
    return inner if hasattr(inner, "arm") else None  # type: ignore[return-value]  # only a SupervisedLink can be armed


@contextmanager
def quiet(connection: Connection) -> Iterator[None]:
    """On a port, no long pauses while something moves; on the twin, where time waits, nothing."""
    if connection.simulation is not None:
        yield
        return
    with nothing_old_looked_at():
        yield


@contextmanager
def armed(connection: Connection) -> Iterator[None]:
    """While something moves, the watchdogs of the ports stop it if this program dies or hangs."""
    guards = [guard for link in connection.links if (guard := supervised(link)) is not None]
    with quiet(connection):
        for guard in guards:
            guard.arm()
        try:
            yield
        finally:
            for guard in guards:
                guard.disarm()


@contextmanager
def _named(motor: str, *, servo: bool = False) -> Iterator[None]:
    """A fault of a module is told with the name of its motor; ``servo``: and with what has switched it off."""
    try:
        yield
    except RemoteFault as fault:
        troubles = servo_troubles(fault.status) if servo and fault.status is not None else []
        words = [f"{words_of([motor], trouble)} ({fault})" for trouble in troubles] or [f"motor {motor}: {fault}"]
        raise NmcError(words[0]) from fault


def set_step_parameters(stepper: PicStep, table: StepMotorTable, mode: str) -> None:
    """Set Parameters as the machine file has them, with speed mode ``mode`` ("1x", "2x", "4x" or "8x")."""
    step = table.step
    stepper.set_parameters(
        mode,
        minimum_speed=step.minimum_speed,
        running_current=step.running_current,
        holding_current=step.holding_current,
        thermal_limit=step.thermal_limit,
        disable_limit_stop=not step.limit_autostop,
        disable_estop=not step.estop,
        motor_off_on_stop=step.motor_off_on_stop,
    )


def _ready_stepper(stepper: PicStep, table: StepMotorTable, mode: str, kept: bool) -> None:
    set_step_parameters(stepper, table, mode)
    stepper.stop_motor("abruptly")
    if not kept:
        stepper.reset_position()
    stepper.bus.arm_faults(stepper.address, low=picstep.STATUS_POWER)


def _ready_servo(servo: PicServo, table: ServoMotorTable, kept: bool) -> None:
    """Gains first, then the position servo: with zero gains an amplifier that is on holds nothing."""
    servo.set_gain(gains_of(table))
    if not kept:
        servo.stop_motor("abruptly")
    servo.clear_sticky_bits()
    servo.require_ready()
    servo.bus.arm_faults(servo.address, high=picservo.STATUS_POSITION_ERROR, low=picservo.STATUS_POWER_ON)
    wait_until_steady(servo)
    if not kept:
        servo.reset_position()  # only now: while its amplifier was off, a loaded axis may have slipped


def park(connection: Connection) -> None:
    """Make the modules as a stream must find them: steppers stopped, all in the parked group, the first one leading it.

    Stop Motor lets a stepper turn back against its last run. Old leaders step down first, so that no group has two.
    """
    for driver in drivers(connection).values():
        if isinstance(driver, PicStep):
            driver.stop_motor("abruptly")
    for bus in connection.buses:
        addresses = sorted(address for address, module in bus.guard.modules.items() if module.moves_axis)
        leads = next(iter(addresses), None)
        for address in addresses:
            module = bus.guard.modules[address]
            if module.group != PARKED_GROUP or module.leader != (address == leads):
                set_group(bus, address, PARKED_GROUP)
        if leads is not None and not bus.guard.modules[leads].leader:
            set_group(bus, leads, PARKED_GROUP, leader=True)


def wait_until_steady(servo: PicServo) -> int:
    """Wait until the shaft has come to its command, at most ``STEADY_WITHIN_NS``; returns where it stands.

    When its amplifier comes on under load, an axis sags until the integral term has found the load. Raises RemoteFault
    if it moves on beyond what a servo at rest may; that it swings a little there is no reason not to start.
    """
    link = servo.bus.link
    deadline_ns = link.now_ns() + STEADY_WITHIN_NS
    stood = near = servo.position()
    since_ns = near_since_ns = link.now_ns()
    while link.now_ns() - since_ns < STEADY_FOR_NS and link.now_ns() < deadline_ns:
        servo.poll(STEADY_POLL_NS)
        now = servo.position()
        if abs(now - stood) > 1:
            stood, since_ns = now, link.now_ns()
        if abs(now - near) > SERVO_STANDS_WITHIN:
            near, near_since_ns = now, link.now_ns()
    if link.now_ns() - min(since_ns, near_since_ns) < STEADY_FOR_NS:
        within_s = STEADY_WITHIN_NS / 1e9
        raise servo.give_up(f"its shaft does not come to rest within {within_s:.0f} s: look at its gains and its load")
    return stood


def expectations(config: MachineConfig, bus: str) -> list[ModuleExpectation]:
    """What must be found on a bus, in chain order."""
    found: dict[int, ModuleExpectation] = {}
    for section in (config.axis, config.motor, config.module):
        for name, table in section.items():
            if table.chip != "cy545" and table.bus == bus:
                moves = section is not config.module
                found[table.address] = ModuleExpectation(chip=table.chip, name=name, moves=moves)
    spindle = config.spindle
    if spindle is not None and spindle.bus == bus and spindle.address is not None:
        found[spindle.address] = ModuleExpectation(chip=picservo.FACTS.name, name=SPINDLE, moves=False)
    return [expectation for _, expectation in sorted(found.items())]


def drivers(connection: Connection) -> dict[str, PicStep | PicServo]:
    """Every motor's chip on its bus, by the motor's name."""
    found: dict[str, PicStep | PicServo] = {}
    for name, (_, step) in motor_tables(connection.config).items():
        found[name] = PicStep(bus_of(connection, step.bus), step.address)
    for name, (_, servo) in servo_tables(connection.config).items():
        found[name] = PicServo(bus_of(connection, servo.bus), servo.address)
    return found


def read_positions(connection: Connection) -> dict[str, int]:
    """Counter of every motor, read back from its chip."""
    found = {name: driver.position() for name, driver in drivers(connection).items()}
    return found | {axis: indexer.read_position() for axis, indexer in connection.indexers.items()}


def stop_everything(connection: Connection) -> int:
    """Stop every motor of every bus at once; returns the rounds it took. Raises NmcError if one cannot be stopped."""
    for indexer in connection.indexers.values():
        indexer.begin_stop()
    try:
        rounds = stop_together(connection.buses)
        for indexer in connection.indexers.values():
            indexer.finish_stop()
    except BaseException:
        if connection.rig is not None:  # the motion first; but whatever becomes of it, the spindle has to go off
            with suppress(NmcError):
                switch_off(connection.rig, connection.buses)
        raise
    if connection.rig is not None:
        switch_off(connection.rig, connection.buses)
    return rounds


def bus_of(connection: Connection, name: str) -> Bus:
    """The bus of that name."""
    return connection.buses[list(nmc_buses(connection.config)).index(name)]
