"""Load Trajectory and Start Motion of a PIC-STEP: what is loaded, when it executes, what Table 4 says to it.

One load deep, no queue: a load overwrites the one before it, and Start Motion executes the most recent one (section
5.1), also when it has been executed before (X-47).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sim import module as nmc
from sim.registers import wrap32
from sim.stepguard import inhibited
from sim.stepmodes import ACCELERATION, COUNT, POSITION, SPEED, Mode, goal_of, refusal
from sim.steptimer import QUARTER_MS_TICKS

if TYPE_CHECKING:
    from sim.picstep import PicStep

MIN_COUNT, MAX_COUNT = 1, 65_452


@dataclass(slots=True)
class Load:
    """A Load Trajectory command that waits for its Start Motion. loaded: control byte bits 0..3."""

    loaded: int
    reverse: bool
    position: int = 0
    speed: int = 0
    acceleration: int = 0
    count: int = 0
    nearest_speed: int = 0


class StepLoads:
    """The motion parameters of one chip and the load that waits."""

    def __init__(self, chip: PicStep) -> None:
        self.chip = chip
        self.goal = 0
        self.speed = self.acceleration = self.nearest_speed = 0
        self.count = 0
        self.last: Load | None = None
        self.fresh = False
        self.stop_since_load = False
        self.stop_since_motion = True

    def forget(self) -> None:
        """Nothing is loaded any more (X-71)."""
        self.last = None
        self.fresh = False

    def stopped(self) -> None:
        """A Stop Motor has been executed."""
        self.stop_since_load = True
        self.stop_since_motion = True

    def take(self, data: bytes) -> None:
        """Load Trajectory: keep the data, and execute them if bit 7 says so."""
        chip = self.chip
        if not data:
            chip.check_length(nmc.LOAD_TRAJECTORY, data, 1)
            return
        control = data[0]
        loaded = control & 0x0F
        sizes = [4 * (loaded & 1), loaded >> 1 & 1, loaded >> 2 & 1, 3 * (loaded >> 3)]
        if not chip.check_length(nmc.LOAD_TRAJECTORY, data, 1 + sum(sizes)):
            return
        chip.zero_bits("ST-116", control, 0x60)
        load = Load(loaded, bool(control & 0x10))
        at = 1
        if loaded & POSITION:
            load.position = int.from_bytes(data[at : at + 4], "little", signed=True)
            if load.position == -0x80000000:
                chip.violation("ST-119", "position -0x80000000 is out of range")
            at += 4
        if loaded & SPEED:
            load.speed = chip.clamp("speed", data[at], 1, 250)
            at += 1
        if loaded & ACCELERATION:
            load.acceleration = chip.clamp("acceleration", data[at], 1, 255)
            at += 1
        if loaded & COUNT:
            count = int.from_bytes(data[at : at + 2], "little")
            load.count = chip.clamp("initial timer count", count, MIN_COUNT, MAX_COUNT)
            load.nearest_speed = min(max(data[at + 2], 1), 250)
        self._keep(load)
        self.last = load
        self.fresh = True
        self.stop_since_load = False
        if control & 0x80:
            self.start()

    def start(self) -> None:
        """Start Motion: execute the most recent load."""
        chip = self.chip
        load = self.last
        if not self.fresh:
            chip.violation("X-47", "Start Motion with nothing freshly loaded: the last load is executed again")
        elif self.stop_since_load:
            chip.violation("X-48", "Start Motion of a load that is older than the last Stop Motor")
        self.fresh = False
        self.stop_since_load = False
        if load is not None:
            self._begin(load)

    def _start_mode(self) -> Mode:
        timer = self.chip.timer
        if timer.mode == Mode.STOPPED and timer.reached_stop and not self.chip.options.reached_stop_is_stopped:
            return Mode.UNPROFILED_STOP
        return timer.mode

    def _begin(self, load: Load) -> None:
        """Execute a load: Table 4, then the rules of direction, then the mode itself."""
        chip = self.chip
        timer = chip.timer
        if not chip.parameters_set:
            chip.violation("X-66", "motion before Set Parameters: ignored")
            return
        start = self._start_mode()
        refused = refusal(start, load.loaded)
        if refused is not None:
            chip.violation(refused[0], refused[1] + ": load ignored (X-60)")
            return
        mode = goal_of(start, load.loaded)
        direction = -1 if load.reverse else 1
        if mode == Mode.TRAP:
            direction = 1 if (load.position - timer.position) >= 0 else -1
        if timer.mode != Mode.STOPPED and direction != timer.direction and mode != Mode.TRAP:
            chip.violation("ST-129", "reversal without stopping: load ignored (X-60)")
            return
        if load.loaded & POSITION and not self._check_goal(mode, load.position, direction):
            return
        if timer.mode == Mode.STOPPED:
            self._check_departure(mode, direction)
            if inhibited(chip, direction):
                return
            self.stop_since_motion = False
        self._set_going(mode, direction)

    def _keep(self, load: Load) -> None:
        """Parameters that are not loaded keep the values that were loaded before, executed or not (foot of Table 4)."""
        if load.loaded & POSITION:
            self.goal = load.position
        if load.loaded & SPEED:
            self.speed = load.speed
        if load.loaded & ACCELERATION:
            self.acceleration = load.acceleration
        if load.loaded & COUNT:
            self.count, self.nearest_speed = load.count, load.nearest_speed

    def _check_goal(self, mode: Mode, goal: int, direction: int) -> bool:
        chip = self.chip
        distance = goal - chip.timer.position
        if distance == 0:
            chip.violation("X-65", "goal equals the present position: no pulse")
            return False
        if abs(distance) > 0x7FFFFFFF:
            chip.violation("ST-120", "goal is more than 0x7FFFFFFF away")
        elif mode == Mode.UNPROFILED_STOP and distance * direction < 0:
            chip.violation("X-63", "direction bit points away from the stop position: the axis runs away")
        return True

    def _check_departure(self, mode: Mode, direction: int) -> None:
        chip = self.chip
        timer = chip.timer
        turned = direction != timer.direction and mode != Mode.TRAP
        if turned and timer.reached_stop and not self.stop_since_motion:
            chip.violation("X-64", "reversal after a reached stop position without Stop Motor")
        if not chip.amp_enabled:
            chip.violation("X-66", "motion with AMP_EN low: pulses without movement")

    def _set_going(self, mode: Mode, direction: int) -> None:
        chip = self.chip
        timer = chip.timer
        if mode in (Mode.UNPROFILED, Mode.UNPROFILED_STOP):
            clocks = 65536 - self.count + 2 * chip.speed_mode
            from_rest = timer.mode == Mode.STOPPED
            # in motion the stop position is inherited; Table 4 lets none be loaded
            stop = (wrap32(self.goal) if from_rest else timer.stop_position) if mode == Mode.UNPROFILED_STOP else None
            at_once = (chip.spec.first_pulse if from_rest else chip.spec.count_latch) == "immediate"
            timer.run_count(mode, clocks * timer.prescale, direction, stop, at_once)
            return
        if timer.mode in (Mode.UNPROFILED, Mode.UNPROFILED_STOP):
            timer.speed = self.nearest_speed
        if self.speed == 0 and mode == Mode.TRAP:
            chip.violation("ST-155", "trapezoid without a speed (a smooth stop sets it to 0): least speed taken")
        acceleration = chip.clamp("acceleration", self.acceleration, 1, 255)
        stop = wrap32(self.goal) if mode == Mode.TRAP else None
        ticks = acceleration * QUARTER_MS_TICKS
        timer.run_profile(mode, self.speed, ticks, direction, stop, chip.spec.first_pulse == "immediate")
