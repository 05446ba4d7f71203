"""A PIC-STEP (type 3, version 1): its commands, status and protections. Data sheet sections 4 and 5.

It answers first and executes afterwards (section 3.1): the reply shows the state at the end of the command's last byte,
the command takes effect up to ``start_delay_max_ns`` later (X-06).
"""

from __future__ import annotations

from sim import module as nmc
from sim.bus import Bus
from sim.clock import ChipClock
from sim.draws import Draws
from sim.spec import SimOptions, StepModule
from sim.stepguard import inputs_changed, protect, set_homing
from sim.stepinputs import StepInputs
from sim.stepload import StepLoads
from sim.stepmodes import Mode
from sim.steptimer import BASE_TICK_NS, QUARTER_MS_TICKS, StepTimer
from sim.trace import StepRuns

_DATA_LENGTH = {
    nmc.RESET_POSITION: 0,
    nmc.START_MOTION: 0,
    nmc.SET_PARAMETERS: 5,
    nmc.STOP_MOTOR: 1,
    nmc.SET_OUTPUTS: 1,
    nmc.SET_HOMING: 1,
    nmc.SAVE_HOME: 0,
}

OUTPUT_PINS = ("out1", "out2", "out3", "out4", "out5")


class PicStep(nmc.NmcModule):
    """One PIC-STEP with its inputs, outputs and mechanics."""

    type_id = 3

    def __init__(self, spec: StepModule, bus: Bus, ppb: int, draws: Draws, phase_ns: int, options: SimOptions) -> None:
        super().__init__(spec.name, bus, ppb, draws)
        self.spec = spec
        self.options = options
        self.clock = ChipClock(BASE_TICK_NS, ppb, phase_ns)
        self.runs = StepRuns(self.clock)
        self.slips: list[tuple[int, int]] = []
        self.timer = StepTimer(self.runs, self._at_edge)
        self.timer.mechanical = spec.start_steps
        self.inputs = StepInputs(spec.switches, spec.temperature)
        self.counter_resets: list[tuple[int, int]] = []  # (time ns, counter before)
        self.mask_bits = 0x7F if spec.ldcn else 0x3F
        self.power_up()

    def power_up(self) -> None:
        """Section 2.3, 3.2 and the reset state: counter 0, outputs 1-4 LOW and 5 HIGH, amplifier off."""
        timer = self.timer
        timer.advance(self.clock.tick_at(self.world.now_ns))
        timer.clear()
        self._zero_counter()
        timer.driven = False
        self.amp_enabled = False
        self.home_position = 0
        self.homing = 0
        self.homing_from = 0
        before, self.outputs = getattr(self, "outputs", 0x10), 0x10
        self.log.pins(self.world.now_ns, self.name, OUTPUT_PINS, before, self.outputs)
        self.parameters_set = False
        self.speed_mode = 1
        self.limit_stop = True
        self.estop_stop = True
        self.off_on_stop = False
        self.running_current = self.holding_current = self.thermal_limit = 0
        self.loads = StepLoads(self)
        self._last_execution_ns = 0
        self._watch_edges()

    # -- timing of commands ------------------------------------------------------------------------------------------

    def matches(self, address: int, command: int) -> bool:
        """A Hard Reset to 0xFF is obeyed whatever the group address (section 5.1)."""
        return address in (self.address, self.group) or (address == 0xFF and command & 0x0F == nmc.HARD_RESET)

    def take(self, command: int, data: bytes, good: bool, answers: bool) -> None:
        """Answer with the state before execution, then execute after a delay of the chip's own."""
        now_ns = self.world.now_ns
        if answers and not (good and command == nmc.HARD_RESET):
            self.synchronise()
            baud = self.rx_baud
            if good and command == nmc.SET_BAUD and data:
                baud = self.rate(data[0])
                self.violation("N-084", "Set Baud with an answer: it comes at the new rate")
            mask = self.reply_mask(command, data) if good else self.mask
            start_ns = now_ns + self.draws.below_ns(self.spec.reply_delay_max_ns)
            self.bus.reply(self.reply_bytes(mask, not good), start_ns, baud)
        if good:
            at_ns = max(now_ns + self.draws.below_ns(self.spec.start_delay_max_ns), self._last_execution_ns)
            self._last_execution_ns = at_ns
            self.later(at_ns, command, data)

    def synchronise(self) -> None:
        """Bring the axis to the present time."""
        self.timer.advance(self.clock.tick_at(self.world.now_ns))

    # -- status ------------------------------------------------------------------------------------------------------

    def status_byte(self) -> int:
        """Section 5.2."""
        timer = self.timer
        mode = timer.mode
        return (
            (mode != Mode.STOPPED)
            | self.amp_enabled << 2
            | self.inputs.power << 3
            | timer.at_speed << 4
            | (mode == Mode.VELOCITY) << 5
            | (mode == Mode.TRAP) << 6
            | bool(self.homing) << 7
        )

    def status_item(self, bit: int) -> bytes:
        """Items of Define Status, section 5.1, least significant byte first."""
        if bit == 0:
            return self.timer.position.to_bytes(4, "little", signed=True)
        if bit == 1:
            return bytes([self.inputs.temperature])
        if bit == 2:
            return self.count_in_timer().to_bytes(2, "little")
        if bit == 3:
            return bytes([self.inputs.byte(self.timer.mechanical)])
        if bit == 4:
            return self.home_position.to_bytes(4, "little", signed=True)
        if bit == 5:
            return bytes([self.type_id, self.spec.version])
        return bytes([self.outputs])

    def count_in_timer(self) -> int:
        """The initial timer count with which the timer was last reloaded; at rest the one last loaded (X-76)."""
        if self.timer.mode == Mode.STOPPED:
            return self.loads.count
        clocks = self.timer.active_period // self.timer.prescale
        return max(0, 65536 + 2 * self.speed_mode - clocks) & 0xFFFF

    @property
    def position(self) -> int:
        """The 32-bit counter, at the present time."""
        self.synchronise()
        return self.timer.position

    @property
    def mechanical_steps(self) -> int:
        """Where the mechanics stand, in steps from the mechanical zero."""
        self.synchronise()
        return self.timer.mechanical

    @property
    def moving(self) -> bool:
        """Status bit 0."""
        self.synchronise()
        return self.timer.mode != Mode.STOPPED

    @property
    def current_duty(self) -> int:
        """CUR_LIM in 1/255: the running value in motion and until 0.25 s after it, else holding (section 4.6)."""
        self.synchronise()
        timer = self.timer
        if timer.mode != Mode.STOPPED or timer.tick - timer.stopped_at < 1000 * QUARTER_MS_TICKS:
            return self.running_current
        return self.holding_current

    # -- commands ----------------------------------------------------------------------------------------------------

    def execute(self, command: int, data: bytes) -> None:
        """Commands of the PIC-STEP's own, at their execution instant."""
        self.synchronise()
        if command == nmc.LOAD_TRAJECTORY:
            self.loads.take(data)
            return
        wanted = 6 if self.spec.ldcn and command == nmc.SET_PARAMETERS else _DATA_LENGTH.get(command)
        if wanted is None:
            self.violation("X-41", f"command 0x{command:X} is not defined for a PIC-STEP: treated as No Operation")
        elif self.check_length(command, data, wanted):
            if command == nmc.RESET_POSITION:
                self._reset_position()
            elif command == nmc.START_MOTION:
                self.loads.start()
            elif command == nmc.SET_PARAMETERS:
                self._set_parameters(data)
            elif command == nmc.STOP_MOTOR:
                self._stop_motor(data[0])
            elif command == nmc.SET_OUTPUTS:
                self.zero_bits("ST-160", data[0], 0xE0)
                self.log.pins(self.world.now_ns, self.name, OUTPUT_PINS, self.outputs, data[0] & 0x1F)
                self.outputs = data[0] & 0x1F
            elif command == nmc.SET_HOMING:
                set_homing(self, data[0])
            else:
                if self.homing:
                    self.violation("X-75", "Save as Home while homing: the home register is overwritten")
                self.home_position = self.timer.position

    def _reset_position(self) -> None:
        if self.timer.mode != Mode.STOPPED:
            self.violation("X-72", "Reset Position while moving: executed")
        self._zero_counter()

    def _zero_counter(self) -> None:
        if self.timer.position:
            self.counter_resets.append((self.world.now_ns, self.timer.position))
        self.timer.position = 0

    def _set_parameters(self, data: bytes) -> None:
        mode = data[0]
        if not self.spec.ldcn:
            self.zero_bits("ST-145", mode, 0xE0)
        if self.timer.mode == Mode.STOPPED:
            self.speed_mode = 8 >> (mode & 3)
            self.timer.prescale = 8 // self.speed_mode
            self.timer.least_speed = self.clamp("minimum profile speed", data[1], 1, 250)
        self.limit_stop = not mode & 0x04
        self.estop_stop = not mode & 0x08
        self.off_on_stop = bool(mode & 0x10)
        self.running_current, self.holding_current, self.thermal_limit = data[2], data[3], data[4]
        self.parameters_set = True
        protect(self)

    def clamp(self, what: str, value: int, least: int, most: int) -> int:
        """X-73: a value outside its range is brought to the nearer end and logged."""
        if least <= value <= most:
            return value
        clamped = min(max(value, least), most)
        self.violation("X-73", f"{what} {value} is outside {least}..{most}: {clamped} taken")
        return clamped

    def _stop_motor(self, control: int) -> None:
        self.zero_bits("ST-153", control, 0xF2)
        if control & 0x0C == 0x0C:
            self.violation("ST-153", "Stop Motor abruptly and smoothly at once: abruptly taken")
        self.set_amplifier(bool(control & 0x01) and self.inputs.power)
        if control & 0x0C:
            self.loads.stopped()
            self.timer.reached_stop = False
            self.stop(smooth=not control & 0x04)
        protect(self)

    def stop(self, smooth: bool) -> None:
        """Stop the motor in one of two manners."""
        timer = self.timer
        if smooth:
            self.loads.speed = 0
            if timer.mode != Mode.STOPPED:
                if self.loads.acceleration:
                    timer.accel_ticks = self.loads.acceleration * QUARTER_MS_TICKS
                timer.begin_smooth_stop(max(self.loads.nearest_speed, 1))
        else:
            timer.halt()

    def set_amplifier(self, enabled: bool) -> None:
        """AMP_EN; without it pulses do not move the mechanics (X-66)."""
        self.amp_enabled = enabled
        self.timer.driven = enabled

    # -- inputs, homing, protections ---------------------------------------------------------------------------------

    # -- inputs ------------------------------------------------------------------------------------------------------

    def _at_edge(self) -> None:
        """The mechanics have passed a switch edge, at the pulse that the timer has just made."""
        inputs_changed(self)
        self._watch_edges()

    def _watch_edges(self) -> None:
        self.timer.edge_above, self.timer.edge_below = self.inputs.edges(self.timer.mechanical)

    def lose_steps(self, steps: int) -> None:
        """The motor slips: the mechanics move by ``steps`` without the counter knowing."""
        self.synchronise()
        self.timer.mechanical += steps
        self.slips.append((self.world.now_ns, steps))
        self._watch_edges()
        inputs_changed(self)

    def halt_dead(self) -> None:
        """No more pulses."""
        self.timer.halt()

    def set_inputs(self, **levels: int | bool | None) -> None:
        """Change pins from outside; names and values as ``StepInputs.set``."""
        self.synchronise()
        self.inputs.set(**levels)
        self._watch_edges()
        inputs_changed(self)
