"""M100 to M199: commands that the machine's owner has given a meaning.

LinuxCNC runs a program of that name. Here the code is only handed on, and only where the machine says what it means;
nothing that a G-code file names is ever executed on the host.
"""

from __future__ import annotations

from gcode.block import Block
from gcode.canon import UserCommand
from gcode.codes import USER
from gcode.errors import GcodeError
from gcode.machine import Machine


def user_command(machine: Machine, block: Block) -> None:
    """M100 to M199 with P and Q; the run waits until it is done. GC065 if the machine has no such command."""
    code, words = block.m[USER], block.words
    known = machine.setup.user_commands
    if known is None:
        machine.warn("GC218", f"M{code} means what the machine's owner has given it", _HINT, f"M{code}")
    elif code not in known:
        have = ", ".join(f"M{number}" for number in sorted(known)[:12])
        hint = f"it has {have}; remove the code, or describe it there" if have else _HINT
        raise GcodeError("GC065", f"the machine has no M{code}", hint, f"M{code}")
    machine.emit.command(UserCommand(machine.emit.line, code, words.get("p"), words.get("q")))
    if machine.compensation is None:
        machine.wait("user")


_HINT = "describe it in the machine file, in a table [user_command.M100]; or remove it"
