"""Steps of spindle, coolant, overrides and outputs: what the machine does beside moving."""

from __future__ import annotations

import math

from gcode.block import Block
from gcode.canon import InputWait, Output
from gcode.codes import COOLANT, IO, OVERRIDE, SPINDLE, SPINDLE_MODE, g_name
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.modes import refuse_under_compensation


def check_spindle_number(block: Block) -> None:
    """The machine has one spindle: ``$0`` (``$-1``: all of them)."""
    number = block.words.get("$")
    if number is not None and number not in {0.0, -1.0}:
        raise GcodeError("GC071", f"spindle {number:g} does not exist", "there is one spindle: $0", "$")


def set_spindle_mode(machine: Machine, block: Block) -> None:
    """G96 D S (surface speed, at most D rpm) and G97."""
    check_spindle_number(block)
    code = block.g[SPINDLE_MODE]
    state = machine.state
    followed = state.spindle_mode == 960
    state.spindle_mode = code
    if code == 970:
        state.spindle_limit_rpm = math.inf
        if followed and "s" not in block.words:
            machine.emit.spindle("SET_SPINDLE_MODE(0 0.0000)")  # S is a speed in rpm from here on
        else:
            machine.emit.text("SET_SPINDLE_MODE(0 0.0000)")
        return
    machine.warn(
        "GC203",
        f"{g_name(code)} is followed only by a machine with a [spindle] whose speed can be set",
        "use G97 and a speed in rpm",
        "g",
    )
    state.spindle_limit_rpm = abs(block.words.get("d", math.inf))
    machine.emit.text(f"SET_SPINDLE_MODE(0 {abs(block.words.get('d', 1e30)):.4f})")


def set_speed(machine: Machine, block: Block) -> None:
    """S."""
    check_spindle_number(block)
    machine.state.spindle_rpm = block.words["s"]
    machine.emit.spindle(f"SET_SPINDLE_SPEED(0, {block.words['s']:.4f})")


def turn_spindle(machine: Machine, block: Block) -> None:
    """M3, M4, M5 and M19."""
    code = block.m[SPINDLE]
    check_spindle_number(block)
    state, emit = machine.state, machine.emit
    if code == 3:
        state.spindle_direction = 1
        emit.spindle("START_SPINDLE_CLOCKWISE(0)")
    elif code == 4:
        state.spindle_direction = -1
        emit.spindle("START_SPINDLE_COUNTERCLOCKWISE(0)")
    elif code == 5:
        state.spindle_direction = 0
        emit.spindle("STOP_SPINDLE_TURNING(0)")
    else:
        _orient(machine, block)
    if code in {3, 4} and state.spindle_rpm == 0.0:
        machine.warn("GC204", f"M{code} without a speed", "give S before or with it", f"M{code}")


def _orient(machine: Machine, block: Block) -> None:
    """M19 R P Q: turn the spindle to an angle and wait at most Q seconds."""
    words = block.words
    angle, how = words.get("r", 0.0), words.get("p", 0.0)
    if not 0.0 <= angle <= 360.0:
        raise GcodeError("GC072", "R of M19 must be an angle from 0 to 360", "R is in degrees", "r")
    if how not in {0.0, 1.0, 2.0}:
        raise GcodeError("GC072", "P of M19 must be 0, 1 or 2", "0 shortest way, 1 clockwise, 2 counter-clockwise", "p")
    if words.get("q", 1.0) <= 0.0:
        raise GcodeError("GC072", "Q of M19 must be above zero", "Q is the longest wait in seconds", "q")
    machine.state.spindle_direction = 0
    spelled = []
    if "r" in words or "p" in words:
        spelled.append(f"ORIENT_SPINDLE(0, {angle:.4f}, {int(how)})")
    if "q" in words:
        spelled.append(f"SPINDLE.0.WAIT_ORIENT_COMPLETE({words['q']:.4f})")
    if spelled:
        machine.emit.spindle("\n".join(spelled))


def set_coolant(machine: Machine, block: Block) -> None:
    """M7, M8 and M9."""
    code = block.m[COOLANT]
    state, emit = machine.state, machine.emit
    if code == 7:
        state.mist = True
        emit.coolant("MIST_ON()")
    elif code == 8:
        state.flood = True
        emit.coolant("FLOOD_ON()")
    else:
        state.mist = state.flood = False
        emit.coolant("MIST_OFF()\nFLOOD_OFF()")


def set_override(machine: Machine, block: Block) -> None:
    """M48 and M49 (feed and speed), M50 to M53 with P (feed, speed, adaptive feed, feed hold)."""
    code = block.m[OVERRIDE]
    refuse_under_compensation(machine, "a change of overrides", f"M{code}")
    on = code == 48 if code in {48, 49} else block.words.get("p", 1.0) != 0.0
    state, emit = machine.state, machine.emit
    word = "ENABLE" if on else "DISABLE"
    if code in {48, 49, 50}:
        state.feed_override = on
        emit.text(f"{word}_FEED_OVERRIDE()")
    if code in {48, 49, 51}:
        state.speed_override = on
        emit.text(f"{word}_SPEED_OVERRIDE(0)")
    if code == 52:
        state.adaptive_feed = on
        emit.text(f"{word}_ADAPTIVE_FEED()")
    if code == 53:
        state.feed_hold = on
        emit.text(f"{word}_FEED_HOLD()")


def set_output(machine: Machine, block: Block) -> None:
    """M62 to M65 (digital, P) and M67, M68 (analog, E and Q)."""
    code = block.m[IO]
    if code == 66:
        wait_for_input(machine, block)
        return
    refuse_under_compensation(machine, "an output", f"M{code}")
    letter = "e" if code in {67, 68} else "p"
    if letter not in block.words:
        raise GcodeError(
            "GC025", f"M{code} without {letter.upper()}", f"{letter.upper()} is the number of the output", f"M{code}"
        )
    index = block.whole(letter)
    if index < 0:
        raise GcodeError("GC015", "a negative output number", "outputs are numbered from 0", letter)
    if code in {67, 68}:
        value = block.words.get("q", 0.0)
        machine.emit.command(Output(machine.emit.line, index, value, True, code == 67))
    else:
        machine.emit.command(Output(machine.emit.line, index, float(code in {62, 64}), False, code in {62, 63}))


def wait_for_input(machine: Machine, block: Block) -> None:
    """M66 P (digital) or E (analog), L (how to wait), Q (longest wait, s). The answer goes to #5399."""
    words = block.words
    digital, analog = "p" in words, "e" in words
    mode = block.whole("l") if "l" in words else 0
    timeout = words.get("q", 0.0)
    if digital == analog:
        raise GcodeError("GC073", "M66 needs P or E", "P is a digital input, E an analog one", "M66")
    if not 0 <= mode <= 4:
        raise GcodeError("GC073", "L of M66 must be 0 to 4", "0 at once, 1 rise, 2 fall, 3 high, 4 low", "l")
    if mode > 0 and timeout <= 0.0:
        raise GcodeError("GC073", "M66 waits without a time limit", "Q is the longest wait in seconds", "M66")
    if analog and mode != 0:
        raise GcodeError("GC073", "an analog input cannot be waited for", "use L0 with E", "l")
    index = block.whole("p" if digital else "e")
    if index < 0:
        raise GcodeError("GC015", "a negative input number", "inputs are numbered from 0", "p" if digital else "e")
    refuse_under_compensation(machine, "reading an input", "M66")
    machine.emit.command(InputWait(machine.emit.line, index, analog, mode, timeout))
    machine.wait("input", index=index, analog=analog, mode=mode, timeout_s=timeout)
