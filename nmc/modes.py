"""What the driver knows of each module, and what it therefore refuses to send: the base, and the PIC-STEP's modes.

A tracker sees every command and every answer of one module. Before a command leaves, ``check`` judges it against the
data sheet and raises LocalFault; afterwards ``answered``, ``executed`` or ``lost`` move the tracker on. When the
outcome of a command is unknown the tracker is *unsure* and lets nothing move the module until an abrupt Stop Motor,
or for a PIC-STEP a reply with a clear moving bit, has made its state known again.

The PIC-STEP's Table 4 stands as data in ``nmc.chips.table4``. A PIC-STEP that reaches its stop position becomes
Stopped on its own: the tracker learns it from the moving bit of a reply, from the source (``Exchange.at_rest``), or
by a Stop Motor.
"""

from __future__ import annotations

from nmc.chips import picstep
from nmc.chips.common import (
    DEFAULT_GROUP,
    DEFINE_STATUS,
    LOAD_TRAJECTORY,
    POSITION_MAX,
    READ_STATUS,
    SET_ADDRESS,
    START_MOTION,
    STOP_MOTOR,
    ChipFacts,
)
from nmc.chips.picstep import (
    COUNT_MAX,
    COUNT_MIN,
    LOAD_ACCELERATION,
    LOAD_COUNT,
    LOAD_POSITION,
    LOAD_REVERSE,
    LOAD_SPEED,
    LOAD_START_NOW,
    SPEED_MAX,
    STATUS_MOVING,
    STOP_ABRUPTLY,
    STOP_SMOOTHLY,
)
from nmc.chips.table4 import TABLE_4, Mode, Refusal, goal_of
from nmc.codec import complain
from nmc.errors import LocalFault, RemoteFault

RESET_POSITION = 0x0
SET_PARAMETERS = 0x6

GOALS: tuple[tuple[Mode | None, ...], ...] = tuple(tuple(goal_of(mode, bits) for bits in range(16)) for mode in Mode)
"""GOALS[starting mode][control byte & 15]: Table 4 turned round, for the hot path."""

LOAD_BYTES = tuple(
    1 + 4 * (c & 1) + (c >> 1 & 1) + (c >> 2 & 1) + 3 * (c >> 3 & 1)
    for c in range(16)  # section 5.1: data bytes of a load, by the low four control bits
)


class Tracker:
    """One module as the driver knows it; this base knows only what all NMC modules share.

    mask: the defined status items, None while unknown. faults_high, faults_low: status bits that must not be set, or
    not be clear, in any reply (nothing until armed).
    """

    def __init__(self, address: int, facts: ChipFacts) -> None:
        self.address = address
        self.facts = facts
        self.version = facts.version
        self.group = DEFAULT_GROUP
        self.leader = False
        self.moves_axis = True
        """False: a spindle or an output, which a stop of the motion leaves to whoever drives it."""
        self.mask: int | None = 0
        self.unsure = ""
        self.address_unsure = False
        self.faults_high = 0
        self.faults_low = 0
        self.last_sent_ns = -(10**18)
        self.position: int | None = None
        self.status: int | None = None

    def fault(self, words: str, rule: str) -> LocalFault:
        """A refusal that names this module and the section that forbids the command."""
        return LocalFault(words, address=self.address, rule=f"{self.facts.name} section {rule}")

    def reply_extra(self, command: int, data: bytes) -> int:
        """Bytes between status and checksum of the answer to this command."""
        if command in (DEFINE_STATUS, READ_STATUS):
            return self.facts.status_bytes[data[0]]
        if self.mask is None:
            raise self.fault("status items are unknown: send Define Status first", "5.1 Define Status")
        return self.facts.status_bytes[self.mask]

    def check(self, command: int, data: bytes, *, endless: bool = False, for_rest: bool = False) -> None:
        """Raise LocalFault if this command must not be sent now. See ``Exchange`` for the two permissions."""
        fact = self.facts.commands.get(command)
        if fact is None:
            raise self.fault(f"command 0x{command:X} is not defined", "5.1")
        complaints = complain(fact, data)
        if complaints:
            raise self.fault(f"{fact.name}: {complaints[0]}", fact.section)

    def repeatable(self, command: int, data: bytes) -> bool:
        """Whether sending the command a second time does no more than sending it once."""
        fact = self.facts.commands.get(command)
        if fact is None or not fact.repeatable:
            return False
        return command != LOAD_TRAJECTORY or not data[0] & LOAD_START_NOW

    def executed(self, command: int, data: bytes) -> None:
        """The module has carried the command out."""
        if command == DEFINE_STATUS:
            self.mask = data[0]

    def seen(self, status: int, extra: bytes, mask: int) -> None:
        """A status packet of this module came in."""
        self.status = status
        if mask & 1:
            self.position = int.from_bytes(extra[:4], "little", signed=True)

    def answered(self, command: int, data: bytes, status: int, extra: bytes) -> None:
        """The command was answered without a communications error."""
        mask = data[0] if command in (DEFINE_STATUS, READ_STATUS) else self.mask or 0
        self.executed(command, data)
        self.seen(status, extra, mask)

    def lost(self, command: int, data: bytes) -> None:
        """Nobody knows whether the command was carried out."""
        if command == DEFINE_STATUS:
            self.mask = None
        elif command == SET_ADDRESS:
            self.address_unsure = True

    @property
    def awaits_rest(self) -> bool:
        """What is loaded can be started only when the module has come to rest."""
        return False

    def at_rest(self) -> None:
        """The source states that the module has come to rest by itself."""

    def judge(self, status: int) -> RemoteFault | None:
        """The fault that an armed bit of this status byte tells, if any."""
        high, low = status & self.faults_high, ~status & self.faults_low
        if not high and not low:
            return None
        names = self.facts.status_bits
        words = [f"{names[bit]} is set" for bit in range(8) if high >> bit & 1]
        words += [f"{names[bit]} is clear" for bit in range(8) if low >> bit & 1]
        return RemoteFault(", ".join(words), address=self.address, status=status, executed=True)


class StepTracker(Tracker):
    """A PIC-STEP: its operating mode, what is loaded and not yet started, and the direction it may run in.

    reached_stop_is_stopped: a run in the same direction may follow a reached stop without a Stop Motor.
    """

    def __init__(self, address: int, *, reached_stop_is_stopped: bool = True) -> None:
        super().__init__(address, picstep.FACTS)
        self.mode = Mode.STOPPED
        self.reached_stop_is_stopped = reached_stop_is_stopped
        self.parameters_set = False
        self.reverse: bool | None = None
        self.stop_issued = True  # since the last motion; power-up counts as such
        self.held = 0  # of LOAD_SPEED and LOAD_ACCELERATION: what a started load has given the chip
        self.stopping = False
        self.at_known_rest = False  # ``position`` was read, or set to 0, since the last start and at rest
        self.stop_position: int | None = None  # to which it runs in unprofiled position mode
        self.loaded = 0
        self.loaded_position: int | None = None
        self.loaded_goal: Mode | None = None
        self.fresh = False
        self._intended: Mode | None = None

    @property
    def moving(self) -> bool:
        """Whether the module may be making steps."""
        return self.mode is not Mode.STOPPED or bool(self.unsure)

    def check(self, command: int, data: bytes, *, endless: bool = False, for_rest: bool = False) -> None:
        """Table 4, the 'only when stopped' commands, ranges."""
        if command == LOAD_TRAJECTORY:
            self._check_load(data, endless, for_rest)
            return
        if command == START_MOTION:
            self._check_start(data)
            return
        super().check(command, data)
        if command == RESET_POSITION and self.moving:
            raise self.fault("Reset Position while the motor is in motion", "5.1 Reset Position")

    def _check_load(self, data: bytes, endless: bool, for_rest: bool) -> None:
        control = data[0] if data else 0
        if not data or control & 0x60 or len(data) != LOAD_BYTES[control & 0x0F]:
            complaint = complain(self.facts.commands[LOAD_TRAJECTORY], data)
            raise self.fault(f"load_trajectory: {complaint[0]}", "5.1 Load Trajectory")
        count_only = control & 0x0F == LOAD_COUNT
        if not count_only or not (COUNT_MIN <= (data[1] | data[2] << 8) <= COUNT_MAX and 0 < data[3] <= SPEED_MAX):
            complaint = complain(self.facts.commands[LOAD_TRAJECTORY], data)
            if complaint:
                raise self.fault(f"load_trajectory: {complaint[0]}", "5.1 Load Trajectory")
        if not self.parameters_set:
            raise self.fault("Set Parameters must be issued before any motion", "5.1 Set Parameters")
        self._require_sure()
        start = self._starts_from(control) if for_rest else self.mode
        goal = GOALS[start][control & 0x0F]
        if goal is None:
            raise self.fault(self._table4_words(start, control), "5.1 Table 4")
        self._check_direction(goal, start, control)
        if goal is Mode.UNPROFILED and start is Mode.STOPPED and not endless:
            raise self.fault(
                "a count without a position from Stopped runs for ever; say so if it is meant", "5.1 Table 4"
            )
        self._check_held(goal, control)
        if control & LOAD_POSITION:
            self._check_distance(int.from_bytes(data[1:5], "little", signed=True), goal, start, control)
        self._intended = goal

    def _starts_from(self, control: int) -> Mode:
        """The mode in which a load that is kept for the coming rest will be started."""
        if control & LOAD_START_NOW:
            raise self.fault("a load for the coming rest must not be started at once", "5.1 Load Trajectory")
        ends = self.mode in (Mode.STOPPED, Mode.UNPROFILED_STOP, Mode.TRAPEZOID)
        return Mode.STOPPED if ends else self.mode

    def _check_distance(self, goal_steps: int, goal: Mode, start: Mode, control: int) -> None:
        """From a known position: not too far, not nowhere, and the direction bit must not point away from the stop."""
        at_stop = start is Mode.STOPPED and self.mode is Mode.UNPROFILED_STOP
        position = self.stop_position if at_stop else self.position
        if position is None:
            return
        distance = goal_steps - position
        if abs(distance) > POSITION_MAX:
            raise self.fault(f"the goal is {distance} steps away, more than 0x7FFFFFFF", "5.1 Load Trajectory")
        if not (self.at_known_rest or at_stop):
            return
        if distance == 0:
            raise self.fault("a move of no length: the sheet does not say what the chip does", "5.1 Load Trajectory")
        if goal is Mode.UNPROFILED_STOP and (distance < 0) is not bool(control & LOAD_REVERSE):
            raise self.fault(f"the stop is {distance} steps away but the direction bit points the other way", "4.1")

    def _check_held(self, goal: Mode, control: int) -> None:
        """A profile needs a speed and an acceleration; a load that is overwritten before its start gave none."""
        if goal not in (Mode.TRAPEZOID, Mode.VELOCITY):
            return
        if not (control | self.held) & LOAD_SPEED:
            raise self.fault("it holds no speed (a smooth stop sets it to 0): load one", "5.1 Stop Motor")
        if not (control | self.held) & LOAD_ACCELERATION:
            raise self.fault("it holds no acceleration time: load one", "5.1 Load Trajectory")

    def _check_direction(self, goal: Mode, start: Mode, control: int) -> None:
        turns = self.reverse is not None and bool(control & LOAD_REVERSE) != self.reverse
        if start is not Mode.STOPPED:
            if turns and goal is not Mode.TRAPEZOID:
                raise self.fault(
                    "the direction cannot be changed without first stopping the motor", "5.1 Load Trajectory"
                )
        elif not self.stop_issued:
            if not self.reached_stop_is_stopped:
                raise self.fault("a new run needs a Stop Motor first (reached_stop_is_stopped is off)", "4.1")
            if turns and goal is not Mode.TRAPEZOID:
                raise self.fault("a reversal needs a Stop Motor first", "4.1 and 4.2, notes")

    def _check_start(self, data: bytes) -> None:
        if data:
            raise self.fault("Start Motion carries no data", "5.1 Start Motion")
        self._require_sure()
        if not self.fresh:
            raise self.fault("Start Motion would execute an old load again", "5.1 Start Motion")
        goal = GOALS[self.mode][self.loaded & 0x0F]
        if goal is not self.loaded_goal:
            was = self.loaded_goal.name if self.loaded_goal is not None else "nothing"
            now = goal.name if goal is not None else "nothing allowed"
            raise self.fault(f"the pending load meant {was}; from {self.mode.name} it would mean {now}", "5.1 Table 4")
        if goal is not None:
            self._check_held(goal, self.loaded)

    def _require_sure(self) -> None:
        if self.unsure:
            raise self.fault(f"its state is unknown ({self.unsure}): send an abrupt Stop Motor first", "5.1 Stop Motor")

    def _table4_words(self, start: Mode, control: int) -> str:
        given = [
            word
            for bit, word in (
                (LOAD_POSITION, "position"),
                (LOAD_SPEED, "speed"),
                (LOAD_ACCELERATION, "acceleration"),
                (LOAD_COUNT, "timer count"),
            )
            if control & bit
        ]
        goals = [goal.name for goal in Mode if not isinstance(TABLE_4[goal, start], Refusal)]
        loaded = " + ".join(given) or "nothing"
        return f"no mode can be entered from {start.name} by loading {loaded} ({', '.join(goals)} can)"

    def executed(self, command: int, data: bytes) -> None:
        """Follow the command into the mode it leads to."""
        if command == LOAD_TRAJECTORY:
            self.loaded, self.loaded_goal, self.fresh = data[0], self._intended, True
            self.loaded_position = int.from_bytes(data[1:5], "little", signed=True) if data[0] & LOAD_POSITION else None
            if data[0] & LOAD_START_NOW:
                self._start()
        elif command == START_MOTION:
            self._start()
        elif command == STOP_MOTOR:
            self._stop(data[0])
        elif command == SET_PARAMETERS:
            self.parameters_set = True
        elif command == RESET_POSITION:
            self.position, self.at_known_rest = 0, True
        else:
            super().executed(command, data)

    def _start(self) -> None:
        goal = GOALS[self.mode][self.loaded & 0x0F]
        self.fresh = False
        self.stopping = False
        if goal is None:
            self.unsure = "a load was started that Table 4 forbids"
            return
        reverse: bool | None = bool(self.loaded & LOAD_REVERSE)
        if goal is Mode.TRAPEZOID:
            reverse = None  # the sign of the distance decides; a trapezoid may follow in any direction
        self.held |= self.loaded & (LOAD_SPEED | LOAD_ACCELERATION)
        if self.mode is Mode.STOPPED or goal is not Mode.UNPROFILED_STOP:
            self.stop_position = self.loaded_position if goal is Mode.UNPROFILED_STOP else None
        self.mode, self.reverse, self.stop_issued = goal, reverse, False
        self.position, self.at_known_rest = None, False

    def _stop(self, control: int) -> None:
        if control & STOP_ABRUPTLY:
            self.mode = Mode.STOPPED
            self.unsure = ""
            self.stop_issued = True
            self.stopping = False
        elif control & STOP_SMOOTHLY:
            self.held &= ~LOAD_SPEED
            self.stop_issued = True
            self.stopping = self.mode is not Mode.STOPPED

    def seen(self, status: int, extra: bytes, mask: int) -> None:
        """A clear moving bit means Stopped, whatever led there."""
        super().seen(status, extra, mask)
        if mask & 1:
            self.at_known_rest = not status & STATUS_MOVING
        if not status & STATUS_MOVING:
            self.at_rest()
            if self.unsure:
                self.unsure, self.fresh = "", False

    def answered(self, command: int, data: bytes, status: int, extra: bytes) -> None:
        """A PIC-STEP replies first and executes then: the reply shows the state before the command.

        Raises RemoteFault if that state turns a count-only load that was started at once into an endless run.
        """
        mask = data[0] if command in (DEFINE_STATUS, READ_STATUS) else self.mask or 0
        intended = self._intended
        self.seen(status, extra, mask)
        self.executed(command, data)
        starts = command == START_MOTION or (command == LOAD_TRAJECTORY and data[0] & LOAD_START_NOW)
        if starts and self.mode is Mode.UNPROFILED and self.loaded_goal is Mode.UNPROFILED_STOP:
            raise RemoteFault(
                f"it had already stopped: the count-only load (meant {intended and intended.name}) now runs for ever",
                address=self.address,
                status=status,
                executed=True,
            )

    def lost(self, command: int, data: bytes) -> None:
        """After a lost motion command nothing is known; after lost parameters they must be set again."""
        super().lost(command, data)
        if command in (LOAD_TRAJECTORY, START_MOTION, STOP_MOTOR):
            self.unsure = f"command 0x{command:X} went unanswered"
            self.fresh = False
        elif command == SET_PARAMETERS:
            self.parameters_set = False
        elif command == RESET_POSITION:
            self.position, self.at_known_rest = None, False

    @property
    def awaits_rest(self) -> bool:
        """A position was loaded for the rest at which its present move ends."""
        return self.fresh and self.mode is not Mode.STOPPED and GOALS[self.mode][self.loaded & 0x0F] is None

    def at_rest(self) -> None:
        """Stopped by reaching its stop position, a limit, or the end of a ramp."""
        self.mode = Mode.STOPPED
        self.stopping = False


__all__ = ["GOALS", "LOAD_ACCELERATION", "LOAD_BYTES", "TABLE_4", "Mode", "StepTracker", "Tracker"]
