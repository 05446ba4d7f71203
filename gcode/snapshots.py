"""The state before any line of a program: modes, offsets, parameters, tool, position.

Running from a line, and editors that show what holds at the cursor, need it without moving anything again. The program
is interpreted up to the line; in loops and subprograms the first passage counts.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass

from gcode.canon import Position
from gcode.codes import g_name
from gcode.offsets import SYSTEMS
from gcode.run import Run
from gcode.setup import Setup
from gcode.state import State, position_of
from gcode.synch import Assumptions


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What holds before ``line``. ``position``: absolute machine mm and degrees. ``state`` is a copy."""

    line: int
    position: Position
    state: State
    parameters: dict[int, float]
    named: dict[str, float]
    calls: tuple[str, ...]

    def modal_words(self) -> str:
        """The modes as a line of codes, as an operator's screen shows them."""
        state = self.state
        codes = [
            state.motion,
            state.plane,
            200 if state.unit_mm != 1.0 else 210,
            910 if state.incremental else 900,
            901 if state.ijk_absolute else 911,
            state.feed_mode,
            state.compensation,
            state.tool_length,
            SYSTEMS[state.system - 1],
            state.control,
            state.retract,
            state.spindle_mode,
        ]
        spindle = {1: "M3", -1: "M4", 0: "M5"}[state.spindle_direction]
        coolant = " ".join(name for name, on in (("M7", state.mist), ("M8", state.flood)) if on) or "M9"
        words = " ".join(g_name(code) for code in codes)
        return f"{words} {spindle} {coolant} T{state.tool_in_spindle} F{state.feed:g} S{state.spindle_rpm:g}"

    def preamble(self) -> list[str]:
        """Lines that bring a machine at rest into these modes, without motion: what a run from ``line`` begins with."""
        state = self.state
        lines = [f"G{20 if state.unit_mm != 1.0 else 21} {g_name(state.plane)} G90 {g_name(SYSTEMS[state.system - 1])}"]
        if state.tool_in_spindle:
            lines.append(f"T{state.tool_in_spindle} M6")
        if any(state.tool_offset):
            words = " ".join(
                f"{axis}{value:g}" for axis, value in zip("XYZABCUVW", state.tool_offset, strict=True) if value
            )
            lines.append(f"G43.1 {words}")
        if state.spindle_rpm or state.spindle_direction:
            lines.append(f"S{state.spindle_rpm:g} " + {1: "M3", -1: "M4", 0: "M5"}[state.spindle_direction])
        lines += [code for code, on in (("M7", state.mist), ("M8", state.flood)) if on]
        path = g_name(state.control)
        if state.control == 640 and state.tolerance is not None:
            path += f" P{state.tolerance:g}"
        feed = f" F{state.feed:g}" if state.feed and state.feed_mode != 930 else ""
        lines.append(f"{g_name(state.feed_mode)}{feed} {path}")
        lines.append(f"{'G91' if state.incremental else 'G90'} {'G90.1' if state.ijk_absolute else 'G91.1'}")
        return lines


class _ReachedError(Exception):
    """The line was reached."""


class _Watched(Run):
    """A run that stops before a line."""

    stop_line = 0

    def execute_text(self, number: int, text: str) -> None:
        """As ``Run``, but stops before the line."""
        if number >= self.stop_line:
            raise _ReachedError
        super().execute_text(number, text)

    def before_line(self, number: int, *, main: bool) -> None:
        """Stops before the line, if it is one of the main program."""
        if main and number == self.stop_line:
            raise _ReachedError

    def may_run_columns(self) -> bool:
        """Line by line, so that the stop is exact."""
        return False


def snapshot_before(text: str, setup: Setup, line: int, assumptions: Assumptions | None = None) -> Snapshot | None:
    """The state before physical line ``line`` (from 1) of the main program; None if execution never comes there."""
    run = _Watched(text, setup)
    run.stop_line = line
    try:
        for _ in run.stream(assumptions):
            pass
    except _ReachedError:
        pass
    else:
        return None
    machine = run.machine
    state = deepcopy(machine.state)
    position = machine.emit.frame.to_machine(position_of(state.position))
    named = {**machine.parameters.globals, **machine.parameters.frames[-1]}
    return Snapshot(line, position, state, dict(machine.parameters.values), named, run.flow.call_stack())
