"""What a program asks the machine: whether a probe has touched (G38), what an input says (M66).

A program is interpreted before anything moves, with assumed answers: probes touch at their target, waits end well,
inputs read 0. On the twin that is what happens. A real machine would drive a probe into the work, for no driver here
reads a probe or an input while a program runs; so it is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gcode.canon import Command, InputWait, MoveBlock, Probe
from gcode.errors import Diagnostic
from gcode.source import split_lines

UNANSWERED = "PR001"
NOBODY_READS = "nothing on this machine reads a probe or an input while a program runs"
_HINT = "measure by hand (groupstart jog) and give the place with --work-offset, or take the line out"


def questions(commands: Sequence[Command | MoveBlock]) -> Iterator[tuple[int, str]]:
    """Line and words of every question of a program."""
    for command in commands:
        if isinstance(command, Probe):
            yield command.line, "the probe is assumed to touch at the end of its move"
        elif isinstance(command, InputWait):
            value = "an analog input" if command.analog else "an input"
            yield command.line, f"{value} is assumed to say 0" + (" and the wait to end well" if command.mode else "")


def question_diagnostics(
    commands: Sequence[Command | MoveBlock], text: str, file: str, *, simulated: bool
) -> list[Diagnostic]:
    """One diagnostic a line that asks: an error on a real machine, a warning on the twin."""
    lines = split_lines(text)
    found, told = [], set()
    for line, words in questions(commands):
        if line in told:
            continue
        told.add(line)
        source = lines[line - 1] if 0 < line <= len(lines) else ""
        first = len(source) - len(source.lstrip()) + 1
        last = max(len(source.rstrip()), first) + 1
        if simulated:
            found.append(Diagnostic(file, line, first, last, UNANSWERED, "warning", words, "no real machine does this"))
        else:
            found.append(Diagnostic(file, line, first, last, UNANSWERED, "error", NOBODY_READS, _HINT))
    return found
