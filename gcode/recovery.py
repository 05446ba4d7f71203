"""After a refused line: what its author most probably meant, so that the check can go on without echoes of one mistake.

Nothing here is ever executed: no command is yielded after the first error. Only position, motion mode and feed are
guessed, to judge the lines that follow.
"""

from __future__ import annotations

import re

from gcode.block import AXIS_LETTERS, Block
from gcode.codes import MOTION
from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.motion import find_end
from gcode.resolve import resolve
from gcode.scanner import scan_line
from gcode.source import columns
from gcode.state import AXIS_INDEX

_REPAIRS = (
    (re.compile("\u2212"), "-"),
    (re.compile(r"(?<=\d),(?=\d)"), "."),
    (re.compile(r"(?<=[0-9.])[oO]|[oO](?=[0-9.])"), "0"),
)


def meant(machine: Machine, text: str, number: int, error: GcodeError) -> Block | None:
    """The block that a line with a reading error was meant to be, or None; broken words are repaired or left out."""
    repaired = text
    for pattern, replacement in _REPAIRS:
        repaired = pattern.sub(replacement, repaired)
    candidates = [repaired]
    if isinstance(error.at, tuple):
        candidates.append(text[: columns(text, *error.at)[0] - 1])
        candidates.append(candidates[-1].rstrip()[:-1])
    for candidate in candidates:
        try:
            return resolve(scan_line(candidate, number), machine.parameters)
        except GcodeError:
            continue
    return None


def recover(machine: Machine, block: Block | None, text: str) -> set[int]:
    """Moves the state to where the refused line meant to go. Returns the axes whose position is now unknown."""
    named = {AXIS_INDEX[letter] for letter in AXIS_LETTERS if letter in text.lower()}
    if block is None:
        return named
    motion = block.motion if block.motion is not None else block.g.get(MOTION)
    if "f" in block.words:
        machine.state.feed = block.words["f"]
    if motion is not None:
        machine.state.motion = motion
    try:
        machine.state.position = find_end(machine, block)
    except GcodeError:
        return named
    return named - {AXIS_INDEX[letter] for letter in AXIS_LETTERS if letter in block.words}
