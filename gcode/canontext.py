"""Canonical commands as text, in the spelling of LinuxCNC's stand-alone interpreter.

Positions are printed as that interpreter prints them: in the program's units and work coordinates. The commands hold
machine coordinates, so the printer follows the frame changes and goes back. The N column is the physical line.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from gcode.canon import (
    Arc,
    Command,
    Coolant,
    Dwell,
    End,
    Feed,
    InputWait,
    Message,
    MoveBlock,
    Nurbs,
    Output,
    PathControl,
    Position,
    Printed,
    Probe,
    Rapid,
    RigidTap,
    Spindle,
    SpindleSynch,
    Stop,
    Text,
    TiltedArc,
    ToolChange,
    UserCommand,
)
from gcode.emit import PLANE_AXES
from gcode.expand import expanded
from gcode.frame import Frame, FrameChange
from gcode.state import position_of

_PLANE_CODE = {"XY": 170, "ZX": 180, "YZ": 190}
_SETTLE = 10
"""Decimals to which positions are rounded before they are printed: what leaving and entering the frame may cost."""


class Printer:
    """Turns commands into lines; holds the frame and the number of the next line."""

    def __init__(self, digits: int = 4) -> None:
        self.digits = digits
        self.frame = Frame()
        self.count = 0

    def lines(self, command: Command) -> Iterator[str]:
        """The lines of one command: none for what the text does not show."""
        if isinstance(command, Printed):
            yield command.function
            return
        for function in self.functions(command):
            self.count += 1
            line = f"N{command.line:<6d}" if command.line else "N..... "
            yield f"{self.count:5d} {line}{function}"

    def functions(self, command: Command) -> list[str]:
        """The canonical functions of one command as text."""
        if isinstance(command, FrameChange):
            self.frame = command.frame
        if isinstance(command, Text):
            return [command.function]
        if isinstance(command, Spindle | Coolant) and command.spelled:
            return command.spelled.split("\n")
        return _FUNCTIONS[type(command)](self, command)

    def numbers(self, values: Iterable[float]) -> str:
        """Numbers separated by ", "; what is zero has no sign."""
        return ", ".join(f"{round(value, _SETTLE) + 0.0:.{self.digits}f}" for value in values)

    def position(self, position: Position) -> Position:
        """A machine position in the program's coordinates."""
        return self.frame.to_program(position)


def _straight(name: str) -> Callable[[Printer, Command], list[str]]:
    def text(printer: Printer, command: Command) -> list[str]:
        assert isinstance(command, Rapid | Feed | Probe)
        return [f"{name}({printer.numbers(printer.position(command.end)[:6])})"]

    return text


def _probe(printer: Printer, command: Command) -> list[str]:
    return ["TURN_PROBE_ON()", *_straight("STRAIGHT_PROBE")(printer, command), "TURN_PROBE_OFF()"]


def _arc(printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, Arc | TiltedArc)
    first, second, third = PLANE_AXES[_PLANE_CODE[command.plane]]
    end = printer.position(command.end)
    if isinstance(command, TiltedArc):
        center = printer.position(command.center)
    else:
        machine_center = list(command.end)
        machine_center[first], machine_center[second] = command.center
        center = printer.position(position_of(machine_center))
    plane = printer.numbers((end[first], end[second], center[first], center[second]))
    rest = printer.numbers((end[third], *end[3:6]))
    return [f"ARC_FEED({plane}, {command.turns}, {rest})"]


def _rigid_tap(printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, RigidTap)
    return [f"RIGID_TAP({printer.numbers(printer.position(command.end)[:3])})"]


def _synch(printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, SpindleSynch)
    if command.pitch_mm is None:
        return ["STOP_SPEED_FEED_SYNCH()"]
    return [f"START_SPEED_FEED_SYNC({command.pitch_mm / printer.frame.unit_mm:.6f},0)"]


def _nurbs(_printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, Nurbs)
    return [f"NURBS_FEED({len(command.points)}, ...)"]


def _path_control(printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, PathControl)
    if command.mode != "continuous":
        return [f"SET_MOTION_CONTROL_MODE(CANON_{command.mode.upper()})"]
    unit = printer.frame.unit_mm
    tolerance = (command.tolerance_mm or 0.0) / unit
    merge = tolerance if command.merge_mm is None else command.merge_mm / unit
    return [
        f"SET_MOTION_CONTROL_MODE(CANON_CONTINUOUS, {tolerance:.6f})",
        f"SET_NAIVECAM_TOLERANCE({printer.numbers((merge,))})",
    ]


def _spindle(printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, Spindle)
    speed = f"SET_SPINDLE_SPEED(0, {printer.numbers((command.speed_rpm,))})"
    turn = {1: "START_SPINDLE_CLOCKWISE(0)", -1: "START_SPINDLE_COUNTERCLOCKWISE(0)", 0: "STOP_SPINDLE_TURNING(0)"}
    return [speed, turn[command.direction]]


def _coolant(_printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, Coolant)
    return [f"MIST_{'ON' if command.mist else 'OFF'}()", f"FLOOD_{'ON' if command.flood else 'OFF'}()"]


def _output(_printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, Output)
    where = "MOTION" if command.synchronised else "AUX"
    if command.analog:
        return [f"SET_{where}_OUTPUT_VALUE({command.index},{command.value:.6f})"]
    return [f"{'SET' if command.value else 'CLEAR'}_{where}_OUTPUT_BIT({command.index})"]


def _dwell(printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, Dwell)
    return [f"DWELL({printer.numbers((command.seconds,))})"]


def _stop(_printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, Stop)
    return ["OPTIONAL_PROGRAM_STOP()" if command.optional else "PROGRAM_STOP()"]


def _end(_printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, End)
    return [command.spelled] if command.spelled else []


def _message(_printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, Message)
    return [f'MESSAGE("{command.text}")']


def _tool_change(_printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, ToolChange)
    return [f"CHANGE_TOOL({command.tool})"]


def _user_command(printer: Printer, command: Command) -> list[str]:
    assert isinstance(command, UserCommand)
    words = (0.0 if word is None else word for word in (command.p, command.q))
    return [f"USER_DEFINED_FUNCTION({command.number}, {printer.numbers(words)})"]


def _nothing(_printer: Printer, _command: Command) -> list[str]:
    return []


_FUNCTIONS: dict[type[Command], Callable[[Printer, Command], list[str]]] = {
    Rapid: _straight("STRAIGHT_TRAVERSE"),
    Feed: _straight("STRAIGHT_FEED"),
    Probe: _probe,
    Arc: _arc,
    TiltedArc: _arc,
    RigidTap: _rigid_tap,
    Nurbs: _nurbs,
    SpindleSynch: _synch,
    PathControl: _path_control,
    Spindle: _spindle,
    Coolant: _coolant,
    Output: _output,
    Dwell: _dwell,
    Stop: _stop,
    End: _end,
    Message: _message,
    ToolChange: _tool_change,
    UserCommand: _user_command,
    InputWait: _nothing,
}


def canon_lines(commands: Iterable[Command | MoveBlock], digits: int = 4) -> Iterator[str]:
    """The canonical text of ``commands``, one function a line.

    digits: decimals of positions. Offsets and rates keep the four decimals of the spelling.
    """
    printer = Printer(digits)
    for command in expanded(commands):
        yield from printer.lines(command)
