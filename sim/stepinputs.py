"""The input pins of a PIC-STEP: switches on the mechanics, E-stop, general inputs, power sense, thermistor."""

from __future__ import annotations

from collections.abc import Sequence

from sim.spec import Switch
from sim.steptimer import FOREVER

_BIT = {"limit1": 0x08, "limit2": 0x10, "home": 0x20}


class StepInputs:
    """Pin levels. ``power``: PWR_SENSE HIGH; ``temperature``: TEMP_SENS as the A/D converter reads it, 0..255."""

    def __init__(self, switches: Sequence[Switch], temperature: int) -> None:
        self.estop = False
        self.in1 = False
        self.in2 = False
        self.power = True
        self.temperature = temperature
        self.stuck: dict[str, bool] = {}
        self._switches = list(switches)
        self._cached_at: tuple[int, int] = (1, 0)  # empty interval: nothing cached
        self._cached = 0

    def set(self, **levels: int | bool | None) -> None:
        """Set pins by name: estop, in1, in2, power (bool), temperature (0..255).

        ``limit1``, ``limit2``, ``home`` hold a pin at a level whatever the mechanics do; None sets it free.
        """
        for name, level in levels.items():
            if name in _BIT:
                if level is None:
                    self.stuck.pop(name, None)
                else:
                    self.stuck[name] = bool(level)
            elif name == "temperature":
                self.temperature = int(level or 0)
            elif name in ("estop", "in1", "in2", "power"):
                setattr(self, name, bool(level))
            else:
                raise ValueError(f"no input pin {name!r}")
        self._cached_at = (1, 0)

    def byte(self, mechanical: int) -> int:
        """Inputs byte of section 5.2; bits 6 and 7 are undefined there and zero here."""
        least, most = self._cached_at
        if not least <= mechanical <= most:
            self._refresh(mechanical)
        return self._cached | self.estop | self.in1 << 1 | self.in2 << 2

    def _refresh(self, mechanical: int) -> None:
        value = 0
        for switch in self._switches:
            inside = (switch.from_steps is None or mechanical >= switch.from_steps) and (
                switch.to_steps is None or mechanical <= switch.to_steps
            )
            if inside == switch.active_high:
                value |= _BIT[switch.pin]
        for name, level in self.stuck.items():
            value = value | _BIT[name] if level else value & ~_BIT[name]
        above, below = self.edges(mechanical)
        self._cached_at = (below + 1, above - 1)
        self._cached = value

    def edges(self, mechanical: int) -> tuple[int, int]:
        """The nearest positions above and below at which some switch changes."""
        above, below = FOREVER, -FOREVER
        for switch in self._switches:
            if switch.from_steps is not None:
                if mechanical < switch.from_steps:
                    above = min(above, switch.from_steps)
                else:
                    below = max(below, switch.from_steps - 1)
            if switch.to_steps is not None:
                if mechanical <= switch.to_steps:
                    above = min(above, switch.to_steps + 1)
                else:
                    below = max(below, switch.to_steps)
        return above, below
