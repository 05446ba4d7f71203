"""Points at which the interpreter must wait for the machine, and what the machine answers.

``check``, ``plan`` and ``verify`` have no machine: they answer with a stated assumption. Only then is a run of the
program ahead of time the same run as on the machine.
"""

from __future__ import annotations

from typing import Literal

from gcode.canon import Command, Position
from gcode.records import dataclass


@dataclass(frozen=True, slots=True)
class Synch(Command):
    """The interpreter stops here until it is told the answer.

    kind: "probe" (after a probe move), "input" (M66), "tool" (M6), "user" (M100 to M199), "position" (the machine's
    position is needed).
    target: where the machine should stand now, absolute mm. index, analog, mode, timeout_s: of M66.
    """

    kind: Literal["probe", "input", "tool", "user", "position"]
    target: Position
    index: int = 0
    analog: bool = False
    mode: int = 0
    timeout_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Answer:
    """What the machine says at a synch point.

    position: where it stands, absolute mm (None: at the target). probe, tripped: where the probe tripped and whether.
    value: of the input, -1 if the wait of M66 ended by its timeout.
    """

    position: Position | None = None
    probe: Position | None = None
    tripped: bool = True
    value: float = 0.0


@dataclass(frozen=True, slots=True)
class Assumptions:
    """The answers of a check without a machine: probes trip at their target, waits succeed, inputs read ``value``.

    backoff_mm: how far the machine rests before the point where the probe tripped.
    """

    value: float = 0.0
    backoff_mm: float = 0.0

    def answer(self, synch: Synch, before: Position) -> Answer:
        """The answer to ``synch``; ``before`` is where the move began."""
        if synch.kind != "probe" or self.backoff_mm == 0.0:
            return Answer(value=self.value)
        back = [b - t for b, t in zip(before[:3], synch.target[:3], strict=True)]
        length = sum(value * value for value in back) ** 0.5
        if length == 0.0:
            return Answer(value=self.value)
        x, y, z = (t + d * self.backoff_mm / length for t, d in zip(synch.target[:3], back, strict=True))
        _, _, _, a, b, c, u, v, w = synch.target
        return Answer((x, y, z, a, b, c, u, v, w), synch.target, value=self.value)
