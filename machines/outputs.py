"""The output pins of a machine: which module has them, what is said to change one, what all of them stand at.

A chip sets several pins with one command, so the panel keeps the word of every module and changes one bit of it.
Nothing is read back: a PIC-STEP cannot tell its outputs. Before the first change every pin is put to its off state.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from machines.outputs_rules import SPINDLE
from machines.outputs_schema import AnalogTable, PinTable
from machines.schema import MachineConfig
from machines.wiring import nmc_buses
from nmc.chips import picio, picservo, picstep
from nmc.chips.common import ChipFacts
from nmc.codec import encode
from nmc.program import Exchange

_FACTS: dict[str, ChipFacts] = {facts.name: facts for facts in (picstep.FACTS, picservo.FACTS, picio.FACTS)}
STEP_OUTPUTS = 0x10
"""PIC-STEP data sheet, section 2.3: OUT1 to OUT4 begin LOW, OUT5 begins HIGH."""
PWM_FULL = 255


@dataclass(frozen=True, slots=True)
class Pin:
    """One output pin. ``name``: what it is in the machine file (``flood``, ``output 3``). ``module``: of the file."""

    name: str
    module: str
    pin: str
    chip: str
    bus: int
    address: int
    active_low: bool = False
    keep: bool = False
    """A stop leaves it as it is."""


@dataclass(frozen=True, slots=True)
class Value:
    """One PWM pin and what its numbers mean: ``least`` is PWM 0, ``greatest`` 255."""

    pin: Pin
    least: float
    greatest: float

    def pwm(self, value: float) -> int:
        """The PWM value nearest to ``value``, inside its range."""
        share = (value - self.least) / (self.greatest - self.least)
        return min(max(round(share * PWM_FULL), 0), PWM_FULL)


@dataclass(slots=True)
class _Word:
    """What one module has been told: switched bits, PIC-I/O's two PWM values, which pins are outputs."""

    bits: int = 0
    pwm: list[int] = field(default_factory=lambda: [0, 0])
    driven: int = 0


def find_pin(config: MachineConfig, table: PinTable | AnalogTable, name: str) -> Pin:
    """The pin that a table of the file means."""
    chip, bus, address = _module(config, table.module)
    low = isinstance(table, PinTable) and table.active_low
    keep = getattr(table, "on_stop", "off") == "keep"
    number = list(nmc_buses(config)).index(bus)
    return Pin(name, table.module, table.pin, chip, number, address, low, keep)


def _module(config: MachineConfig, name: str) -> tuple[str, str, int]:
    spindle = config.spindle
    if name == SPINDLE and spindle is not None and spindle.bus is not None and spindle.address is not None:
        return picservo.FACTS.name, spindle.bus, spindle.address
    table = config.axis.get(name) or config.motor.get(name) or config.module[name]
    assert table.chip != "cy545"  # outputs_rules.py lets no pin of a CY545 through
    return table.chip, table.bus, table.address


def switched_pins(config: MachineConfig) -> dict[str, Pin]:
    """Every pin that is on or off, by its name: ``spindle on``, ``spindle reverse``, ``flood``, ``mist``, ``output 3``.

    In the order in which a stop switches them off.
    """
    tables: dict[str, PinTable | None] = {}
    if config.spindle is not None:
        tables |= {"spindle on": config.spindle.on, "spindle reverse": config.spindle.reverse}
    if config.coolant is not None:
        tables |= {"flood": config.coolant.flood, "mist": config.coolant.mist}
    tables |= {f"output {number}": table for number, table in config.output.items()}
    return {name: find_pin(config, table, name) for name, table in tables.items() if table is not None}


def valued_pins(config: MachineConfig) -> dict[str, Value]:
    """Every pin that has a value, by its name: ``analog 0``, ``spindle speed`` (PWM values themselves)."""
    found = {}
    for number, table in config.analog.items():
        name = f"analog {number}"
        found[name] = Value(find_pin(config, table, name), table.least, table.greatest)
    if config.spindle is not None and config.spindle.speed is not None:
        name = "spindle speed"
        found[name] = Value(find_pin(config, config.spindle.speed, name), 0.0, PWM_FULL)
    return found


class Panel:
    """All output pins, and the words in which their modules hold them. Methods make exchanges; somebody sends them."""

    def __init__(self, switches: Mapping[str, Pin], values: Mapping[str, Value]) -> None:
        self.switches = dict(switches)
        self.values = dict(values)
        self.levels: dict[str, float] = {}
        """What every pin was told last: 1 on, 0 off, PWM 0 to 255."""
        self._words: dict[tuple[int, int], _Word] = {}
        for pin in [*self.switches.values(), *(value.pin for value in self.values.values())]:
            base = STEP_OUTPUTS if pin.chip == picstep.FACTS.name else 0
            word = self._words.setdefault((pin.bus, pin.address), _Word(bits=base))
            if pin.pin.startswith(("bit", "limit")):
                word.driven |= 1 << _bit(pin)

    def start(self) -> Iterator[Exchange]:
        """Make the pins outputs and put all of them to their off state; one exchange after the other."""
        for pin in self.switches.values():
            self._note(pin, False)
        done: set[tuple[int, int]] = set()
        for pin in self.switches.values():
            place = pin.bus, pin.address
            if place in done:
                continue
            done.add(place)
            yield self._switch(pin)
            if pin.chip == picio.FACTS.name:
                inputs = picio.DIRECTION_RESET & ~self._words[place].driven
                yield _exchange(pin, "set_io_direction", {"inputs": inputs})
        for value in self.values.values():
            if value.pin.chip == picservo.FACTS.name:
                yield _exchange(value.pin, "stop_motor", {"amplifier_enable": 1})
            yield self.set(value.pin.name, 0)

    def switch(self, name: str, on: bool) -> Exchange:
        """Switch a pin by its name."""
        pin = self.switches[name]
        self._note(pin, on)
        return self._switch(pin)

    def set(self, name: str, pwm: int) -> Exchange:
        """Give a PWM pin a value 0 to 255."""
        pin = self.values[name].pin
        self.levels[name] = pwm
        if pin.chip == picservo.FACTS.name:
            return _exchange(pin, "load_trajectory", {"pwm": pwm, "start_now": 1})
        word = self._words[pin.bus, pin.address]
        word.pwm[int(pin.pin[-1]) - 1] = pwm
        return _exchange(pin, "set_pwm", {"pwm1": word.pwm[0], "pwm2": word.pwm[1]})

    def off(self, *, stopping: bool) -> Iterator[Exchange]:
        """Everything off that is not off; ``stopping``: also outputs, except those that a stop leaves as they are."""
        done: set[tuple[int, int]] = set()
        for name, pin in self.switches.items():
            program = name.startswith("output ")
            if not pin.keep and (stopping or not program):
                self._note(pin, False)
        for pin in self.switches.values():
            if (pin.bus, pin.address) not in done:
                done.add((pin.bus, pin.address))
                yield self._switch(pin)
        for name, value in self.values.items():
            program = name.startswith("analog ")
            if not value.pin.keep and (stopping or not program):
                yield self.set(name, 0)

    @property
    def anything_on(self) -> bool:
        """Whether some pin is not at its off state, those aside that a stop keeps."""
        pins = self.switches | {name: value.pin for name, value in self.values.items()}
        return any(self.levels.get(name) and not pin.keep for name, pin in pins.items())

    def _note(self, pin: Pin, on: bool) -> None:
        self.levels[pin.name] = float(on)
        word = self._words[pin.bus, pin.address]
        bit = 1 << _bit(pin)
        word.bits = word.bits | bit if on != pin.active_low else word.bits & ~bit

    def _switch(self, pin: Pin) -> Exchange:
        """The exchange that tells a module its word."""
        word = self._words[pin.bus, pin.address]
        if pin.chip == picstep.FACTS.name:
            return _exchange(pin, "set_outputs", {"outputs": word.bits})
        if pin.chip == picio.FACTS.name:
            return _exchange(pin, "set_output", {"outputs": word.bits})
        values = {"limit1_output": word.bits & 1, "limit2_output": word.bits >> 1 & 1}
        values |= {"limit1_is_input": int(not word.driven & 1), "limit2_is_input": int(not word.driven & 2)}
        return _exchange(pin, "io_control", values)


def _bit(pin: Pin) -> int:
    """Bit of a pin in its module's word."""
    if pin.pin.startswith("bit"):
        return int(pin.pin.removeprefix("bit"))
    return int(pin.pin[-1]) - 1


def _exchange(pin: Pin, name: str, values: dict[str, int]) -> Exchange:
    command, data = encode(_FACTS[pin.chip], name, values)
    return Exchange(pin.address, command, data, bus=pin.bus)


def panel_of(config: MachineConfig) -> Panel:
    """The panel of a machine; without any pin it has nothing to say."""
    return Panel(switched_pins(config), valued_pins(config))
