"""From a description of buses to a running simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from nmc.link import Link
from sim.bus import Bus
from sim.cy545 import Cy545
from sim.cy545_line import add_cy545
from sim.cy545_spec import Cy545Port
from sim.draws import Draws
from sim.link import SimLink
from sim.module import NmcModule
from sim.picio import PicIo
from sim.picstep import PicStep
from sim.spec import BusSpec, IoModule, Module, ServoModule, SimOptions, StepModule
from sim.trace import BusLog, Trace, collect, with_pins
from sim.violations import Incident, Log, Violation
from sim.world import World

if TYPE_CHECKING:
    from sim.picservo import PicServo

MAX_MODULES = 32
SERVO_TYPE = 0


class Simulation:
    """Chips, buses and host ports under one virtual clock.

    ``modules`` of the buses and ``indexers`` (CY545s, each on a line of its own) by name; ``links``: one a bus or line.
    """

    def __init__(self) -> None:
        self.world = World()
        self.log = Log()
        self.buses: list[Bus] = []
        self.links: list[Link] = []
        self.modules: dict[str, NmcModule] = {}
        self.indexers: dict[str, Cy545] = {}
        self.bus_logs: list[BusLog] = []

    @property
    def violations(self) -> list[Violation]:
        """Everything so far that went against the data sheets."""
        return self.log.violations

    def rules(self) -> list[str]:
        """Numbers of the rules broken so far, in order."""
        return [v.rule for v in self.log.violations]

    @property
    def incidents(self) -> list[Incident]:
        """What chips did on their own account so far."""
        return self.log.incidents

    def steppers(self) -> dict[str, PicStep]:
        """All PIC-STEP modules by name."""
        return {name: m for name, m in self.modules.items() if isinstance(m, PicStep)}

    def servos(self) -> dict[str, PicServo]:
        """All PIC-SERVO modules by name."""
        return {name: m for name, m in self.modules.items() if m.type_id == SERVO_TYPE}  # type: ignore[misc]

    def power_cycle(self) -> None:
        """Switch the power of all modules off and on; the mechanics stay where they are."""
        for module in self.modules.values():
            module.synchronise()
            module.hard_reset()

    def another_master(self, bus: int) -> SimLink:
        """A second host port on the same wires, such as a watchdog's: it hears every reply and talks without jitter."""
        first = self.buses[bus]
        link = SimLink(first, first.status.draws, 0)
        link.baud = int(first.status.host_baud)
        return link

    def trace(self) -> Trace:
        """Everything that came out up to the present time, motors in the order in which they were described."""
        for bus in self.buses:
            bus.status.settle(self.world.now_ns)
        steppers, servos = self.steppers(), {name: m for name, m in self.servos().items() if m.spec.moves}
        for stepper in steppers.values():
            stepper.synchronise()
        for servo in servos.values():
            servo.synchronise()
            servo.flush_samples()
        for indexer in self.indexers.values():
            indexer.settle()
        motors = [name for name in self.modules if name in steppers or name in servos] + list(self.indexers)
        runs = {name: m.runs for name, m in steppers.items()} | {name: i.runs for name, i in self.indexers.items()}
        slips = {name: m.slips for name, m in steppers.items()}
        trace = collect(motors, runs, {name: m.samples for name, m in servos.items()}, self.bus_logs, slips)
        return with_pins(trace, self.log.outputs)


def build(buses: Sequence[BusSpec | Cy545Port], seed: int, options: SimOptions | None = None) -> Simulation:
    """Power up the machine. Same seed, same host: bit-identical. Raises ValueError on a description that cannot be."""
    options = options or SimOptions()
    simulation = Simulation()
    for number, spec in enumerate(buses):
        if isinstance(spec, Cy545Port):
            log = BusLog() if options.trace_bus else None
            simulation.bus_logs += [log] if log is not None else []
            add_cy545(
                simulation, spec, (stream(seed, number, 0), stream(seed, number, 1), stream(seed, number, 2)), log
            )
            continue
        if len(spec.modules) > MAX_MODULES:
            raise ValueError(f"bus {spec.name!r}: {len(spec.modules)} modules, at most {MAX_MODULES} fit (section 1.0)")
        bytes_log = BusLog() if options.trace_bus else None
        bus = Bus(spec.name, simulation.world, simulation.log, stream(seed, number, 0), bytes_log)
        if bytes_log is not None:
            simulation.bus_logs.append(bytes_log)
        for place, module_spec in enumerate(spec.modules):
            if module_spec.name in simulation.modules:
                raise ValueError(f"two modules are called {module_spec.name!r}")
            _check(module_spec)
            module = _module(module_spec, bus, stream(seed, number, 2 + place), options)
            bus.modules.append(module)
            simulation.modules[module_spec.name] = module
        bus.rewire()
        simulation.buses.append(bus)
        simulation.links.append(SimLink(bus, stream(seed, number, 1), spec.host_jitter_max_ns))
    return simulation


def stream(seed: int, bus: int, use: int) -> Draws:
    """Chance for one use: a stream of its own, so that one more draw here changes nothing there."""
    return Draws(np.random.default_rng([seed, bus, use]))


def _check(spec: Module) -> None:
    """Refuse what no chip can be."""
    name = f"module {spec.name!r}"
    if abs(spec.crystal_ppm) + spec.crystal_ppm_max > 10_000:
        raise ValueError(f"{name}: a crystal is not {abs(spec.crystal_ppm) + spec.crystal_ppm_max:g} ppm wrong")
    if isinstance(spec, ServoModule):
        plant = spec.plant
        if not 10 <= spec.oscillator_mhz <= 20:
            raise ValueError(f"{name}: the clock is between 10 and 20 MHz (PIC-SERVO data sheet section 3.0)")
        if min(plant.inertia_kgm2, plant.resistance_ohm, plant.torque_nm_per_a) <= 0 or plant.lines_per_rev < 1:
            raise ValueError(f"{name}: inertia, resistance, torque constant and encoder lines are above zero")
        if min(plant.coulomb_nm, plant.viscous_nms, plant.inductance_h, plant.load_mass_kg) < 0:
            raise ValueError(f"{name}: friction, inductance and mass are not below zero")
    elif spec.reply_delay_max_ns < 0 or (isinstance(spec, StepModule) and spec.start_delay_max_ns < 0):
        raise ValueError(f"{name}: delays are not below zero")


def _module(spec: Module, bus: Bus, draws: Draws, options: SimOptions) -> NmcModule:
    ppm = spec.crystal_ppm + (2 * draws.unit() - 1) * spec.crystal_ppm_max
    phase_ns = -draws.below_ns(options.power_phase_max_ns)
    if isinstance(spec, IoModule):
        return PicIo(spec, bus, round(ppm * 1000), draws)
    if isinstance(spec, StepModule):
        return PicStep(spec, bus, round(ppm * 1000), draws, phase_ns, options)
    from sim.picservo import PicServo  # its kernel is compiled: only where there is a servo

    return PicServo(spec, bus, round(ppm * 1000), draws, phase_ns, options)
