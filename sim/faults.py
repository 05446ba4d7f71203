"""What goes wrong on purpose: bytes lost, flipped or inserted, stuck switches, lost steps, late ticks, dead modules.

A fault is a record with the time at which it happens; ``schedule`` puts a list of them into a simulation. Noise on the
wires is drawn from a seeded stream of its own, so a run with faults is as repeatable as one without.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from sim.build import Simulation, stream
from sim.bus import Bus
from sim.module import NmcModule
from sim.picstep import PicStep

NOISE = 1000  # a use of chance beside those of build


@dataclass(frozen=True, slots=True)
class Noise:
    """Bytes of bus number ``bus`` are lost, bit-flipped or joined by another with these probabilities, in a time span.

    command, status: which of the two lines are noisy.
    """

    bus: int = 0
    lose: float = 0.0
    flip: float = 0.0
    insert: float = 0.0
    from_ns: int = 0
    until_ns: int = 1 << 62
    command: bool = True
    status: bool = True
    seed: int = 0


@dataclass(frozen=True, slots=True)
class Inputs:
    """Input pins of a PIC-STEP change; ``limit1``, ``limit2``, ``home`` are held there (stuck), None frees them."""

    module: str
    at_ns: int
    levels: dict[str, int | bool | None]


@dataclass(frozen=True, slots=True)
class LostSteps:
    """The motor of a PIC-STEP loses ``steps`` steps (signed): the mechanics stand elsewhere than the counter says."""

    module: str
    at_ns: int
    steps: int


@dataclass(frozen=True, slots=True)
class Overrun:
    """A PIC-SERVO tick takes ``extra_ns`` longer and sets servo_overrun (data sheet section 5.3)."""

    module: str
    at_ns: int
    extra_ns: int = 100_000


@dataclass(frozen=True, slots=True)
class Supply:
    """The motor supply of a PIC-SERVO changes to ``volts``."""

    module: str
    at_ns: int
    volts: float


@dataclass(frozen=True, slots=True)
class Dead:
    """A module stops hearing, answering and moving."""

    module: str
    at_ns: int


Fault = Noise | Inputs | LostSteps | Overrun | Supply | Dead


def schedule(simulation: Simulation, faults: Sequence[Fault]) -> None:
    """Let the faults happen. Raises ValueError if a module does not exist or is of the wrong type."""
    for fault in faults:
        if isinstance(fault, Noise):
            _add_noise(simulation.buses[fault.bus], fault)
            continue
        if fault.module not in simulation.modules:
            raise ValueError(f"fault on module {fault.module!r}, which does not exist")
        simulation.world.call_at(fault.at_ns, _action(simulation, fault))


def _action(simulation: Simulation, fault: Inputs | LostSteps | Overrun | Supply | Dead) -> Callable[[], None]:
    module = simulation.modules[fault.module]
    if isinstance(fault, Dead):
        return partial(_die, module)
    if isinstance(fault, Inputs | LostSteps):
        if not isinstance(module, PicStep):
            raise ValueError(f"{type(fault).__name__} needs a PIC-STEP, {fault.module!r} is none")
        if isinstance(fault, Inputs):
            return partial(module.set_inputs, **fault.levels)
        return partial(module.lose_steps, fault.steps)
    servo = simulation.servos().get(fault.module)
    if servo is None:
        raise ValueError(f"{type(fault).__name__} needs a PIC-SERVO, {fault.module!r} is none")
    if isinstance(fault, Overrun):
        return partial(servo.inject_overrun, fault.extra_ns)
    return partial(servo.set_supply, fault.volts)


def _die(module: NmcModule) -> None:
    module.synchronise()
    module.broken = True
    module.epoch += 1
    module.halt_dead()
    module.bus.rewire()


def _add_noise(bus: Bus, noise: Noise) -> None:
    draws = stream(noise.seed, noise.bus, NOISE)

    def active(time_ns: int) -> bool:
        return noise.from_ns <= time_ns < noise.until_ns

    def one(value: int) -> list[int]:
        """What becomes of one byte: values that arrive, -1 for one that is lost."""
        if draws.unit() < noise.lose:
            return [-1]
        if draws.unit() < noise.flip:
            value ^= 1 << int(draws.unit() * 8)
        return [value, int(draws.unit() * 256)] if draws.unit() < noise.insert else [value]

    def on_command(data: bytes) -> tuple[list[int], list[bool]]:
        noisy = active(bus.world.now_ns)
        values = [v for byte in data for v in (one(byte) if noisy else [byte])]
        return values, [True] * len(values)

    def on_status(coming: list[tuple[int, int]]) -> list[tuple[int, int]]:
        return [
            (at_ns, value) for at_ns, byte in coming for value in (one(byte) if active(at_ns) else [byte]) if value >= 0
        ]

    if noise.command:
        bus.noise = on_command
    if noise.status:
        bus.status.noise = on_status
