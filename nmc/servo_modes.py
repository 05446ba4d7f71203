"""The PIC-SERVO as the driver knows it: the 'while moving' column of its command list, and what is loaded.

Data sheet section 5.1 with notes 1 and 2: Load Trajectory is allowed while moving only if it is not started now or
selects velocity mode, Start Motion only if what is loaded selects velocity mode; Reset Position never.
"""

from __future__ import annotations

from enum import IntEnum

from nmc.chips import picservo
from nmc.chips.common import LOAD_TRAJECTORY, POSITION_MAX, START_MOTION, STOP_MOTOR
from nmc.chips.picservo import (
    LOAD_ACCELERATION,
    LOAD_POSITION,
    LOAD_SERVO_MODE,
    LOAD_START_NOW,
    LOAD_VELOCITY,
    LOAD_VELOCITY_MODE,
    STATUS_MOVE_DONE,
    STOP_ABRUPTLY,
    STOP_HERE,
    STOP_MOTOR_OFF,
    STOP_SMOOTHLY,
)
from nmc.codec import complain
from nmc.modes import RESET_POSITION, Tracker

SET_GAIN = 0x6

LOAD_BYTES = tuple(1 + 4 * (c & 1) + 4 * (c >> 1 & 1) + 4 * (c >> 2 & 1) + (c >> 3 & 1) for c in range(16))
"""Section 5.2: data bytes of a load, by the low four control bits."""


class ServoMode(IntEnum):
    """What the PIC-SERVO does with its motor."""

    PWM = 0
    TRAPEZOID = 1
    VELOCITY = 2


class ServoTracker(Tracker):
    """A PIC-SERVO: mode, whether it moves, which velocity and acceleration it holds."""

    def __init__(self, address: int) -> None:
        super().__init__(address, picservo.FACTS)
        self.mode = ServoMode.PWM
        self.done = True
        self.goal_velocity = 0
        self.gains_set = False
        self.velocity = 0
        self.acceleration = 0
        self.loaded = 0
        self.fresh = False

    @property
    def moving(self) -> bool:
        """Whether a profile is running: inside a trapezoid, or in velocity mode with or towards a velocity."""
        if self.mode is ServoMode.PWM:
            return bool(self.unsure)
        return not self.done or (self.mode is ServoMode.VELOCITY and self.goal_velocity != 0) or bool(self.unsure)

    def check(self, command: int, data: bytes, *, endless: bool = False, for_rest: bool = False) -> None:
        """The 'while moving' column, ranges, gains before motion."""
        if command == LOAD_TRAJECTORY:
            self._check_load(data)
            return
        if command == STOP_MOTOR and data and data[0] & ~1 == STOP_HERE and len(data) == 5:
            self._check_here(data)
            return
        super().check(command, data)
        if command == START_MOTION:
            self._require_sure()
            if not self.fresh:
                raise self.fault("Start Motion would execute an old load again", "5.2 Start Motion")
            self._check_begin(self.loaded)
        elif command == RESET_POSITION and self.moving:
            raise self.fault("Reset Position while moving", "5.1 list of commands")

    def _check_load(self, data: bytes) -> None:
        control = data[0] if data else 0
        complaint: tuple[str, ...] = ()
        if not data or len(data) != LOAD_BYTES[control & 0x0F]:
            complaint = complain(self.facts.commands[LOAD_TRAJECTORY], data)
        else:
            at = 1
            if control & LOAD_POSITION:
                self._check_distance(data[1:5])
                at = 5
            for _ in range((control & LOAD_VELOCITY > 0) + (control & LOAD_ACCELERATION > 0)):
                if data[at + 3] & 0x80:
                    complaint = complain(self.facts.commands[LOAD_TRAJECTORY], data)
                at += 4
        if complaint:
            raise self.fault(f"load_trajectory: {complaint[0]}", "5.2 Load Trajectory")
        self._require_sure()
        if control & LOAD_START_NOW:
            self._check_begin(control, data)

    def _check_begin(self, control: int, data: bytes = b"") -> None:
        servo = control & LOAD_SERVO_MODE
        if servo and not self.gains_set:
            raise self.fault("Set Gain must come before the position servo is used", "5.2 Set Gain")
        if self.moving and not (servo and control & LOAD_VELOCITY_MODE):
            raise self.fault("only velocity mode may be started while moving", "5.1 list of commands, notes 1 and 2")
        if servo and not control & LOAD_VELOCITY_MODE:
            velocity, acceleration = self._held(control, data)
            if not velocity or not acceleration:
                raise self.fault("a trapezoid without velocity or acceleration never ends", "5.2 Load Trajectory")

    def _check_here(self, data: bytes) -> None:
        self._check_distance(data[1:5])
        if not self.gains_set:
            raise self.fault("Set Gain must come before Stop Here", "5.2 Set Gain")

    def _check_distance(self, four: bytes) -> None:
        goal = int.from_bytes(four, "little", signed=True)
        if goal < -POSITION_MAX:
            raise self.fault(f"position {goal} is outside +/-0x7FFFFFFF", "5.2 Load Trajectory")
        if self.position is not None and abs(goal - self.position) > POSITION_MAX:
            raise self.fault(f"the goal is {goal - self.position} counts away, more than 0x7FFFFFFF", "5.2")

    def _held(self, control: int, data: bytes) -> tuple[int, int]:
        """Velocity and acceleration that the chip holds once these load data are in."""
        velocity, acceleration = self.velocity, self.acceleration
        at = 5 if control & LOAD_POSITION else 1
        if data and control & LOAD_VELOCITY:
            velocity = int.from_bytes(data[at : at + 4], "little")
            at += 4
        if data and control & LOAD_ACCELERATION:
            acceleration = int.from_bytes(data[at : at + 4], "little")
        return velocity, acceleration

    def _require_sure(self) -> None:
        if self.unsure:
            raise self.fault(f"its state is unknown ({self.unsure}): send an abrupt Stop Motor first", "5.2 Stop Motor")

    def executed(self, command: int, data: bytes) -> None:
        """Follow the command into the mode it leads to."""
        if command == LOAD_TRAJECTORY:
            self.loaded, self.fresh = data[0], True
            self.velocity, self.acceleration = self._held(data[0], data)
            if data[0] & LOAD_START_NOW:
                self._start()
        elif command == START_MOTION:
            self._start()
        elif command == STOP_MOTOR:
            self._stop(data[0])
        elif command == SET_GAIN:
            self.gains_set = True
        elif command == RESET_POSITION:
            self.position = 0
        else:
            super().executed(command, data)

    def _start(self) -> None:
        self.fresh = False
        self.position = None
        if not self.loaded & LOAD_SERVO_MODE:
            self.mode, self.done, self.goal_velocity = ServoMode.PWM, True, 0
        elif self.loaded & LOAD_VELOCITY_MODE:
            self.mode, self.done, self.goal_velocity = ServoMode.VELOCITY, False, self.velocity
        else:
            self.mode, self.done, self.goal_velocity = ServoMode.TRAPEZOID, False, 0

    def _stop(self, control: int) -> None:
        if control & STOP_MOTOR_OFF:
            self.mode, self.done, self.goal_velocity, self.unsure = ServoMode.PWM, True, 0, ""
        elif control & (STOP_ABRUPTLY | STOP_HERE):
            self.mode, self.done, self.goal_velocity = ServoMode.VELOCITY, True, 0
            self.unsure = ""
        elif control & STOP_SMOOTHLY:
            self.mode, self.done, self.goal_velocity = ServoMode.VELOCITY, False, 0

    def seen(self, status: int, extra: bytes, mask: int) -> None:
        """Move_done ends a trapezoid or a change of velocity."""
        super().seen(status, extra, mask)
        self.done = bool(status & STATUS_MOVE_DONE)

    def lost(self, command: int, data: bytes) -> None:
        """After a lost motion command nothing is known; Stop Here may simply be sent again."""
        super().lost(command, data)
        if command in (LOAD_TRAJECTORY, START_MOTION, STOP_MOTOR):
            self.unsure = f"command 0x{command:X} went unanswered"
            self.fresh = False
        elif command == SET_GAIN:
            self.gains_set = False
        elif command == RESET_POSITION:
            self.position = None
