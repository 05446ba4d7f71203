"""A PIC-I/O (type 2), as a small module: pins, A/D inputs, PWM outputs and a timer.

No data sheet of it was at hand; command and item numbers are those of the vendor's published host headers. Addresses,
groups, checksums, baud and reset are those of every NMC module.
"""

from __future__ import annotations

from sim import module as nmc
from sim.bus import Bus
from sim.draws import Draws
from sim.spec import IoModule

SET_DIRECTION, SET_PWM, SYNCH_OUTPUT, SET_OUTPUT, SET_SYNCH_OUTPUT, SET_TIMER, SYNCH_INPUT = 0, 4, 5, 6, 7, 8, 0xC
_DATA_LENGTH = {
    SET_DIRECTION: 2,
    SET_PWM: 2,
    SYNCH_OUTPUT: 0,
    SET_OUTPUT: 2,
    SET_SYNCH_OUTPUT: 4,
    SET_TIMER: 1,
    SYNCH_INPUT: 0,
}
_PINS = 0x0FFF
OUTPUT_PINS = tuple(f"bit{number}" for number in range(12))
_TIMER_NS = 200  # 5 MHz, divided by 1, 2, 4, 8


class PicIo(nmc.NmcModule):
    """One PIC-I/O; executes at once and answers within its reply delay."""

    type_id = 2
    mask_bits = 0xFF

    def __init__(self, spec: IoModule, bus: Bus, ppb: int, draws: Draws) -> None:
        super().__init__(spec.name, bus, ppb, draws)
        self.spec = spec
        self.levels = spec.inputs & _PINS
        self.direction, self.outputs, self.pwm = _PINS, 0, (0, 0)
        self.analog = list(spec.analog)
        self.power_up()

    def power_up(self) -> None:
        """All pins inputs, outputs LOW, PWM 0, timer off."""
        self._change(_PINS, 0, (0, 0))  # 1 = input
        self.synch_outputs = 0
        self.synch_pwm = (0, 0)
        self.latched_pins = 0
        self.latched_timer = 0
        self.timer_mode = 0
        self.timer_from_ns = 0

    def pins(self) -> int:
        """Levels of all 12 pins: the outside's on inputs, the module's own on outputs."""
        driven = self.outputs & ~self.direction & _PINS
        levels = self.levels
        for follow in self.spec.follows:
            level = (driven >> follow.output & 1) ^ follow.inverted
            levels = levels & ~(1 << follow.input) | level << follow.input
        return (levels & self.direction) | driven

    def timer(self) -> int:
        """Counts of the timer; as a counter it counts nothing, because no pulses are modelled."""
        if self.timer_mode & 3 != 1:
            return 0
        return (self.world.now_ns - self.timer_from_ns) // (_TIMER_NS << (self.timer_mode >> 4 & 3)) & 0xFFFFFFFF

    def take(self, command: int, data: bytes, good: bool, answers: bool) -> None:
        """Execute at once, then answer."""
        mask = self.reply_mask(command, data) if good else self.mask
        if good and not self.shared(command, data):
            self.execute(command, data)
        if answers and not (good and command == nmc.HARD_RESET):
            start_ns = self.world.now_ns + self.draws.below_ns(self.spec.reply_delay_max_ns)
            self.bus.reply(self.reply_bytes(mask, not good), start_ns, self.rx_baud)

    def status_byte(self) -> int:
        """Nothing but the communications error bit is used."""
        return 0

    def status_item(self, bit: int) -> bytes:
        """Pins, three A/D values, timer, type and version, latched pins, latched timer."""
        if bit == 0:
            return self.pins().to_bytes(2, "little")
        if bit <= 3:
            return bytes([self.analog[bit - 1]])
        if bit == 4:
            return self.timer().to_bytes(4, "little")
        if bit == 5:
            return bytes([self.type_id, self.spec.version])
        if bit == 6:
            return self.latched_pins.to_bytes(2, "little")
        return self.latched_timer.to_bytes(4, "little")

    def execute(self, command: int, data: bytes) -> None:
        """Commands of the PIC-I/O's own."""
        wanted = _DATA_LENGTH.get(command)
        if wanted is None:
            self.violation("X-41", f"command 0x{command:X} is not defined for a PIC-I/O: treated as No Operation")
        elif self.check_length(command, data, wanted):
            if command == SET_DIRECTION:
                self._change(int.from_bytes(data[:2], "little") & _PINS, self.outputs, self.pwm)
            elif command == SET_PWM:
                self._change(self.direction, self.outputs, (data[0], data[1]))
            elif command == SYNCH_OUTPUT:
                self._change(self.direction, self.synch_outputs, self.synch_pwm)
            elif command == SET_OUTPUT:
                self._change(self.direction, int.from_bytes(data[:2], "little") & _PINS, self.pwm)
            elif command == SET_SYNCH_OUTPUT:
                self.synch_outputs = int.from_bytes(data[:2], "little") & _PINS
                self.synch_pwm = (data[2], data[3])
            elif command == SET_TIMER:
                self.timer_mode = data[0]
                self.timer_from_ns = self.world.now_ns
            else:
                self.latched_pins, self.latched_timer = self.pins(), self.timer()

    def _change(self, direction: int, outputs: int, pwm: tuple[int, int]) -> None:
        """Take new levels and note the pins that have changed."""
        now_ns, before = self.world.now_ns, self.outputs & ~self.direction
        self.log.pins(now_ns, self.name, OUTPUT_PINS, before & _PINS, outputs & ~direction & _PINS)
        for name, old, new in zip(("pwm1", "pwm2"), self.pwm, pwm, strict=True):
            self.log.pwm(now_ns, self.name, name, old, new)
        self.direction, self.outputs, self.pwm = direction, outputs, pwm
