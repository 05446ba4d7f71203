"""A PIC-STEP (type 3, version 1): its commands, status and protections. Data sheet sections 4 and 5.

It answers first and executes afterwards (section 3.1): the reply shows the state at the end of the command's last byte,
the command takes effect up to ``start_delay_max_ns`` later (X-06).
"""

from __future__ import annotations

from dataclasses import dataclass

from sim import module as nmc
from sim.bus import Bus
from sim.clock import ChipClock
from sim.draws import Draws
from sim.spec import SimOptions, StepModule
from sim.stepinputs import StepInputs
from sim.stepmodes import ACCELERATION, COUNT, POSITION, SPEED, Mode, goal_of, refusal
from sim.steptimer import BASE_TICK_NS, QUARTER_MS_TICKS, StepTimer, wrap32
from sim.trace import StepRuns
from sim.uart import chip_baud

MAX_COUNT, MIN_COUNT = 65_452, 1
_RELOAD_NS = 3_200  # +2/+4/+8/+16 timer clocks of 1x/2x/4x/8x
_DATA_LENGTH = {
    nmc.RESET_POSITION: 0,
    nmc.START_MOTION: 0,
    nmc.SET_PARAMETERS: 5,
    nmc.STOP_MOTOR: 1,
    nmc.SET_OUTPUTS: 1,
    nmc.SET_HOMING: 1,
    nmc.SAVE_HOME: 0,
}


@dataclass(slots=True)
class _Load:
    """A Load Trajectory command that waits for its Start Motion."""

    loaded: int
    reverse: bool
    position: int = 0
    speed: int = 0
    acceleration: int = 0
    count: int = 0
    nearest_speed: int = 0


class PicStep(nmc.NmcModule):
    """One PIC-STEP with its inputs, outputs and mechanics."""

    type_id = 3

    def __init__(self, spec: StepModule, bus: Bus, ppb: int, draws: Draws, phase_ns: int, options: SimOptions) -> None:
        super().__init__(spec.name, bus, ppb, draws)
        self.spec = spec
        self.options = options
        self.clock = ChipClock(BASE_TICK_NS, ppb, phase_ns)
        self.runs = StepRuns(self.clock)
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
        timer.position = 0
        timer.driven = False
        self.amp_enabled = False
        self.home_position = 0
        self.homing = 0
        self.homing_from = 0
        self.outputs = 0x10
        self.parameters_set = False
        self.speed_mode = 1
        self.limit_stop = True
        self.estop_stop = True
        self.off_on_stop = False
        self.running_current = self.holding_current = self.thermal_limit = 0
        self.goal = 0
        self.speed = self.acceleration = self.nearest_speed = 0
        self.count = 0
        self.load: _Load | None = None
        self.load_fresh = False
        self.stop_since_load = False
        self.stop_since_motion = True
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
                baud = chip_baud(data[0], self.ppb)
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
            return self.count
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
            self._load_trajectory(data)
            return
        wanted = 6 if self.spec.ldcn and command == nmc.SET_PARAMETERS else _DATA_LENGTH.get(command)
        if wanted is None:
            self.violation("X-41", f"command 0x{command:X} is not defined for a PIC-STEP: treated as No Operation")
        elif self.check_length(command, data, wanted):
            if command == nmc.RESET_POSITION:
                self._reset_position()
            elif command == nmc.START_MOTION:
                self._start_motion()
            elif command == nmc.SET_PARAMETERS:
                self._set_parameters(data)
            elif command == nmc.STOP_MOTOR:
                self._stop_motor(data[0])
            elif command == nmc.SET_OUTPUTS:
                self._zero_bits("ST-160", data[0], 0xE0)
                self.outputs = data[0] & 0x1F
            elif command == nmc.SET_HOMING:
                self._set_homing(data[0])
            else:
                if self.homing:
                    self.violation("X-75", "Save as Home while homing: the home register is overwritten")
                self.home_position = self.timer.position

    def _zero_bits(self, rule: str, value: int, mask: int) -> None:
        if value & mask:
            self.violation(rule, f"byte 0x{value:02X}: bits 0x{mask:02X} should be zero, ignored")

    def _reset_position(self) -> None:
        if self.timer.mode != Mode.STOPPED:
            self.violation("X-72", "Reset Position while moving: executed")
        self.counter_resets.append((self.world.now_ns, self.timer.position))
        self.timer.position = 0

    def _set_parameters(self, data: bytes) -> None:
        mode = data[0]
        if not self.spec.ldcn:
            self._zero_bits("ST-145", mode, 0xE0)
        if self.timer.mode == Mode.STOPPED:
            self.speed_mode = 8 >> (mode & 3)
            self.timer.prescale = 8 // self.speed_mode
            self.timer.least_speed = self._clamp("minimum profile speed", data[1], 1, 250)
        self.limit_stop = not mode & 0x04
        self.estop_stop = not mode & 0x08
        self.off_on_stop = bool(mode & 0x10)
        self.running_current, self.holding_current, self.thermal_limit = data[2], data[3], data[4]
        self.parameters_set = True
        self.protect()

    def _clamp(self, what: str, value: int, least: int, most: int) -> int:
        if least <= value <= most:
            return value
        clamped = min(max(value, least), most)
        self.violation("X-73", f"{what} {value} is outside {least}..{most}: {clamped} taken")
        return clamped

    def _load_trajectory(self, data: bytes) -> None:
        if not data:
            self.check_length(nmc.LOAD_TRAJECTORY, data, 1)
            return
        control = data[0]
        loaded = control & 0x0F
        sizes = [4 * (loaded & 1), loaded >> 1 & 1, loaded >> 2 & 1, 3 * (loaded >> 3)]
        if not self.check_length(nmc.LOAD_TRAJECTORY, data, 1 + sum(sizes)):
            return
        self._zero_bits("ST-116", control, 0x60)
        load = _Load(loaded, bool(control & 0x10))
        at = 1
        if loaded & POSITION:
            load.position = int.from_bytes(data[at : at + 4], "little", signed=True)
            if load.position == -0x80000000:
                self.violation("ST-119", "position -0x80000000 is out of range")
            at += 4
        if loaded & SPEED:
            load.speed = self._clamp("speed", data[at], 1, 250)
            at += 1
        if loaded & ACCELERATION:
            load.acceleration = self._clamp("acceleration", data[at], 1, 255)
            at += 1
        if loaded & COUNT:
            count = int.from_bytes(data[at : at + 2], "little")
            load.count = self._clamp("initial timer count", count, MIN_COUNT, MAX_COUNT)
            load.nearest_speed = min(max(data[at + 2], 1), 250)
        self.load = load
        self.load_fresh = True
        self.stop_since_load = False
        if control & 0x80:
            self._start_motion()

    def _start_motion(self) -> None:
        load = self.load
        if not self.load_fresh:
            self.violation("X-47", "Start Motion with nothing freshly loaded: the last load is executed again")
        elif self.stop_since_load:
            self.violation("X-48", "Start Motion of a load that is older than the last Stop Motor")
        self.load_fresh = False
        self.stop_since_load = False
        if load is not None:
            self._begin(load)

    def _start_mode(self) -> Mode:
        timer = self.timer
        if timer.mode == Mode.STOPPED and timer.reached_stop and not self.options.reached_stop_is_stopped:
            return Mode.UNPROFILED_STOP
        return timer.mode

    def _begin(self, load: _Load) -> None:
        """Execute a load: Table 4, then the rules of direction, then the mode itself."""
        timer = self.timer
        if not self.parameters_set:
            self.violation("X-66", "motion before Set Parameters: ignored")
            return
        start = self._start_mode()
        refused = refusal(start, load.loaded)
        if refused is not None:
            self.violation(refused[0], refused[1] + ": load ignored (X-60)")
            return
        mode = goal_of(start, load.loaded)
        direction = -1 if load.reverse else 1
        if mode == Mode.TRAP:
            direction = 1 if (load.position - timer.position) >= 0 else -1
        if timer.mode != Mode.STOPPED and direction != timer.direction and mode != Mode.TRAP:
            self.violation("ST-129", "reversal without stopping: load ignored (X-60)")
            return
        self._keep(load)
        if load.loaded & POSITION and not self._check_goal(mode, load.position, direction):
            return
        if timer.mode == Mode.STOPPED:
            self._check_departure(mode, direction)
            if self._inhibited(direction):
                return
            self.stop_since_motion = False
        self._set_going(mode, direction)

    def _keep(self, load: _Load) -> None:
        """Parameters that are not loaded keep their values (foot of Table 4)."""
        if load.loaded & POSITION:
            self.goal = load.position
        if load.loaded & SPEED:
            self.speed = load.speed
        if load.loaded & ACCELERATION:
            self.acceleration = load.acceleration
        if load.loaded & COUNT:
            self.count, self.nearest_speed = load.count, load.nearest_speed

    def _check_goal(self, mode: Mode, goal: int, direction: int) -> bool:
        distance = goal - self.timer.position
        if distance == 0:
            self.violation("X-65", "goal equals the present position: no pulse")
            return False
        if abs(distance) > 0x7FFFFFFF:
            self.violation("ST-120", "goal is more than 0x7FFFFFFF away")
        elif mode == Mode.UNPROFILED_STOP and distance * direction < 0:
            self.violation("X-63", "direction bit points away from the stop position: the axis runs away")
        return True

    def _check_departure(self, mode: Mode, direction: int) -> None:
        timer = self.timer
        turned = direction != timer.direction and mode != Mode.TRAP
        if turned and timer.reached_stop and not self.stop_since_motion:
            self.violation("X-64", "reversal after a reached stop position without Stop Motor")
        if not self.amp_enabled:
            self.violation("X-66", "motion with AMP_EN low: pulses without movement")

    def _set_going(self, mode: Mode, direction: int) -> None:
        timer = self.timer
        if mode in (Mode.UNPROFILED, Mode.UNPROFILED_STOP):
            clocks = 65536 - self.count + 2 * self.speed_mode
            stop = None
            if mode == Mode.UNPROFILED_STOP:
                stop = wrap32(self.goal)
            from_rest = timer.mode == Mode.STOPPED
            at_once = (self.spec.first_pulse if from_rest else self.spec.count_latch) == "immediate"
            timer.run_count(mode, clocks * timer.prescale, direction, stop, at_once)
            return
        if timer.mode in (Mode.UNPROFILED, Mode.UNPROFILED_STOP):
            timer.speed = self.nearest_speed
        if self.speed == 0 and mode == Mode.TRAP:
            self.violation("ST-155", "trapezoid without a speed (a smooth stop sets it to 0): least speed taken")
        acceleration = self._clamp("acceleration", self.acceleration, 1, 255)
        stop = wrap32(self.goal) if mode == Mode.TRAP else None
        ticks = acceleration * QUARTER_MS_TICKS
        timer.run_profile(mode, self.speed, ticks, direction, stop, self.spec.first_pulse == "immediate")

    def _stop_motor(self, control: int) -> None:
        self._zero_bits("ST-153", control, 0xF2)
        if control & 0x0C == 0x0C:
            self.violation("ST-153", "Stop Motor abruptly and smoothly at once: abruptly taken")
        self.set_amplifier(bool(control & 0x01) and self.inputs.power)
        if control & 0x0C:
            self.stop_since_load = True
            self.stop_since_motion = True
            self.timer.reached_stop = False
            self.stop(smooth=not control & 0x04)
        self.protect()

    def stop(self, smooth: bool) -> None:
        """Stop the motor in one of two manners."""
        timer = self.timer
        if smooth:
            self.speed = 0
            if timer.mode != Mode.STOPPED:
                if self.acceleration:
                    timer.accel_ticks = self.acceleration * QUARTER_MS_TICKS
                timer.begin_smooth_stop(max(self.nearest_speed, 1))
        else:
            timer.halt()

    def set_amplifier(self, enabled: bool) -> None:
        """AMP_EN; without it pulses do not move the mechanics (X-66)."""
        self.amp_enabled = enabled
        self.timer.driven = enabled

    # -- inputs, homing, protections ---------------------------------------------------------------------------------

    def _set_homing(self, control: int) -> None:
        self._zero_bits("ST-067", control, 0xC0)
        if (control & 0x34).bit_count() > 1:
            self.violation("ST-067", "Set Homing Mode with more than one manner of stopping")
        self.homing = control | 0x100  # the bit in progress, also with no condition at all
        self.homing_from = self.inputs.byte(self.timer.mechanical)

    def _at_edge(self) -> None:
        """The mechanics have passed a switch edge, at the pulse that the timer has just made."""
        self.inputs_changed()
        self._watch_edges()

    def _watch_edges(self) -> None:
        self.timer.edge_above, self.timer.edge_below = self.inputs.edges(self.timer.mechanical)

    def inputs_changed(self) -> None:
        """Inputs may have another level than before: homing first (it captures), then the protections."""
        self._check_home()
        self.protect()

    def _check_home(self) -> None:
        homing = self.homing
        if not homing:
            return
        changed = self.inputs.byte(self.timer.mechanical) ^ self.homing_from
        flagged = (homing & 1) << 3 | (homing & 2) << 3 | (homing & 8) << 2
        if not changed & flagged:
            return
        self.homing = 0
        self.home_position = self.timer.position
        self.log.incident(self.clock.ns_of(self.timer.tick), self.name, f"home captured at {self.home_position}")
        if homing & 0x04:
            self.set_amplifier(False)
            self.timer.halt()
        elif homing & 0x10:
            self.timer.halt()
        elif homing & 0x20:
            self.stop(smooth=True)

    def _inhibited(self, direction: int) -> bool:
        """A motion that a limit or the E-stop does not allow never begins (section 4.5, X-70)."""
        inputs = self.inputs.byte(self.timer.mechanical)
        blocked = self.estop_stop and inputs & 0x01
        blocked |= self.limit_stop and inputs & (0x08 if direction > 0 else 0x10)
        if blocked or not self.inputs.power:
            self.incident("motion inhibited by " + ("power sense" if not self.inputs.power else "limit or E-stop"))
            self._forget_loads()
            return True
        return False

    def _forget_loads(self) -> None:
        self.load = None
        self.load_fresh = False

    def protect(self) -> None:
        """Section 4.5: limits, E-stop, power sense, thermal limit, as the inputs stand now."""
        timer = self.timer
        inputs = self.inputs.byte(timer.mechanical)
        moving = timer.mode != Mode.STOPPED
        if not self.inputs.power:
            self._trip("power sense LOW", True)
        if self.thermal_limit and self.inputs.temperature < self.thermal_limit:
            self._trip("thermal limit", True)
        if moving and self.limit_stop and inputs & (0x08 if timer.direction > 0 else 0x10):
            self._trip("limit switch", self.off_on_stop)
        if self.estop_stop and inputs & 0x01:
            self._trip("E-stop", self.off_on_stop)

    def _trip(self, why: str, motor_off: bool) -> None:
        """Motion ends at once; the state is Stopped with nothing loaded (X-71)."""
        if self.timer.mode != Mode.STOPPED:
            self.log.incident(self.clock.ns_of(self.timer.tick), self.name, f"motion terminated: {why}")
            self.timer.halt()
            self._forget_loads()
        if motor_off and self.amp_enabled:
            self.log.incident(self.clock.ns_of(self.timer.tick), self.name, f"amplifier off: {why}")
            self.set_amplifier(False)

    def set_inputs(self, **levels: int | bool | None) -> None:
        """Change pins from outside; names and values as ``StepInputs.set``."""
        self.synchronise()
        self.inputs.set(**levels)
        self._watch_edges()
        self.inputs_changed()
