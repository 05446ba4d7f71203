"""What went against the data sheets, with time, module, rule and consequence; and what merely happened.

A violation is something a correct host never causes. A limit stop or a captured home position is an event: it is what
the chip is for.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Violation:
    """One breach. rule: item of the conformance list (``N-``, ``ST-``, ``SV-``, ``X-`` with its number)."""

    time_ns: int
    module: str
    rule: str
    consequence: str


@dataclass(frozen=True, slots=True)
class Incident:
    """Something a chip did on its own account: a limit stop, a thermal shut-down, a captured home position."""

    time_ns: int
    module: str
    what: str


@dataclass(frozen=True, slots=True)
class OutputChange:
    """An output pin has changed. value: level 0 or 1 of a pin, 0 to 255 of a PWM (negative in reverse)."""

    time_ns: int
    module: str
    pin: str
    value: int


class Log:
    """Everything worth telling of one simulation, in the order in which it happened."""

    def __init__(self) -> None:
        self.violations: list[Violation] = []
        self.incidents: list[Incident] = []
        self.outputs: list[OutputChange] = []

    def pins(self, time_ns: int, module: str, names: Sequence[str], before: int, after: int) -> None:
        """Note every pin whose bit differs; ``names`` from bit 0 on."""
        for bit, name in enumerate(names):
            if (before ^ after) >> bit & 1:
                self.outputs.append(OutputChange(time_ns, module, name, after >> bit & 1))

    def pwm(self, time_ns: int, module: str, name: str, before: int, after: int) -> None:
        """Note a PWM output that has changed."""
        if before != after:
            self.outputs.append(OutputChange(time_ns, module, name, after))

    def violation(self, time_ns: int, module: str, rule: str, consequence: str) -> None:
        """Note a breach of a data sheet."""
        self.violations.append(Violation(time_ns, module, rule, consequence))

    def incident(self, time_ns: int, module: str, what: str) -> None:
        """Note something that happened."""
        self.incidents.append(Incident(time_ns, module, what))

    def counts(self) -> dict[str, int]:
        """How often each rule was broken."""
        return dict(sorted(Counter(v.rule for v in self.violations).items()))
