"""A host of a few lines for one simulated CY545, for experiments and tests; it shares nothing with the driver."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from nmc.chips.cy545 import RateTable
from sim.build import Simulation, build
from sim.cy545 import Cy545
from sim.cy545_line import Cy545Link
from sim.cy545_spec import Cy545Port

_NS_PER_S = 1_000_000_000


class TextHost:
    """One chip named A on a port, and what can be done to it from outside."""

    def __init__(self, rates: RateTable, seed: int = 1, **choices: Any) -> None:
        self.sim: Simulation = build([Cy545Port("A", "indexer", rates, **choices)], seed)
        link = self.sim.links[0]
        assert isinstance(link, Cy545Link)
        self.link = link
        self.chip: Cy545 = link.chip
        link.set_baud(int(self.chip.rx_baud))

    def send(self, text: str) -> None:
        """Characters to the chip, waiting until the last one is in."""
        self.link.write(text.encode("ascii"))
        self.wait(len(text) * 10 / self.link.baud + 1e-6)

    def do(self, *commands: str) -> None:
        """Commands one after another, each followed by a carriage return and by the time it takes."""
        for command in commands:
            self.send(command + "\r")
            self.until_ready()

    def until_ready(self, limit_s: float = 1e5) -> None:
        """Let time pass until the chip takes commands again."""
        end_ns = self.link.now_ns() + round(limit_s * _NS_PER_S)
        world = self.sim.world
        while self.chip.busy and world.next_event_ns() <= end_ns:
            world.step()
        self.wait(0)

    def ask(self, about: str) -> str:
        """The answer to a query, without its carriage return."""
        self.link.flush_input()
        self.send(f"?{about}\r")
        answer = bytearray()
        while not answer.endswith(b"\r"):
            more = self.link.read(1, self.link.now_ns() + _NS_PER_S // 10)
            if not more:
                break
            answer += more
        return answer.decode("ascii").rstrip("\r")

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.link.sleep_until(self.link.now_ns() + round(seconds * _NS_PER_S))
        self.chip.settle()

    def rules(self) -> list[str]:
        """Rules broken so far."""
        return [violation.rule for violation in self.sim.violations]

    def pulses_s(self) -> npt.NDArray[np.float64]:
        """Instants of all steps so far."""
        return np.asarray(self.sim.trace().pulses_ns("A") * 1e-9)
