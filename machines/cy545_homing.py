"""Homing of an axis on a CY545: continuous mode towards the switch, abort, and the edge by single steps.

    switch ####|                       1 continuous until it closes, abort: the chip stands somewhere on it
        <======|=====================  2 continuous the other way until it opens, abort, and ``backoff`` further
           ====|=>                     3 slowly on to it again
            <--|-                      4 single steps until it opens: the edge, whatever the host's delay was
              >|

The chip answers nothing while it moves, so the host watches the switch on a line of its own. After each search the chip
is reset (I): nothing is assumed of what ends continuous mode.
"""

from __future__ import annotations

from machines.homing import GRACE_S, MARGIN, Homed
from machines.schema import Cy545Axis, HomeTable
from nmc.chips.cy545 import ramp_entry_ns
from nmc.cy545 import Cy545
from nmc.errors import RemoteFault
from planner.cy545 import Indexer, RampSettings, choose, profile
from planner.quantize import NS_PER_S

POLL_NS = 1_000_000
SINGLE_STEPS_MAX = 2000


def home_indexer(axis: str, table: Cy545Axis, indexer: Indexer, chip: Cy545) -> Homed:
    """Home an axis; it ends at machine zero. Raises RemoteFault where the switch is not found; the motor then stands.

    Raises LocalFault without a line to INHIBIT_ABORT, ValueError without a home table.
    """
    home = table.home
    if home is None:
        raise ValueError(f"axis {axis} has no [axis.{axis}.home] in its machine file")
    return _Search(axis, table, home, indexer, chip).run()


class _Search:
    def __init__(self, axis: str, table: Cy545Axis, home: HomeTable, indexer: Indexer, chip: Cy545) -> None:
        self.axis = axis
        self.home = home
        self.indexer = indexer
        self.chip = chip
        self.scale = table.steps_per_unit
        self.sign = 1 if (home.direction == "positive") == (self.scale > 0) else -1
        self.length = table.travel[1] - table.travel[0] + 2 * home.backoff
        self.away = -self.sign * max(round(home.backoff * abs(self.scale)), 1)

    def run(self) -> Homed:
        """The whole of it."""
        home, chip = self.home, self.chip
        seen = None if chip.lines.switch_closed() else self._seek(True, home.velocity)
        opened = self._seek(False, home.slow_velocity)
        self._go(chip.position + self.away, home.velocity)
        self._seek(True, home.slow_velocity)
        edge = self._edge()
        self._go(edge - round(home.position * self.scale), home.velocity)
        chip.set_position(0)
        return Homed(self.axis, edge, (opened if seen is None else seen) - edge)

    def _seek(self, closed: bool, velocity: float) -> int:
        """Run until the switch is ``closed``, or open; where it was seen, reckoned back from where the chip stopped."""
        chip, link = self.chip, self.chip.link
        settings = choose(self.indexer, feed=velocity)
        ramp_steps, slowing_ns = self._ramp(settings)
        chip.set_rates(settings.first, settings.rate, settings.slope)
        way = self.sign if closed else -self.sign
        deadline_ns = link.now_ns() + round((MARGIN * self.length / velocity + GRACE_S) * NS_PER_S)
        chip.run_continuous(way > 0, slowing_ns)
        while chip.lines.switch_closed() != closed:
            if link.now_ns() > deadline_ns:
                chip.stop()
                words = "home switch not found" if closed else "home switch stays closed"
                raise RemoteFault(f"{chip.name}: {words} within the travel")
            link.sleep_until(link.now_ns() + POLL_NS)
        stopped = chip.stop()
        chip.initialize()
        chip.set_position(stopped)
        return stopped - way * ramp_steps

    def _edge(self) -> int:
        """From on the switch off it, step by step; the last step at which it was closed."""
        for _ in range(SINGLE_STEPS_MAX):
            if not self.chip.lines.switch_closed():
                return self.chip.position + self.sign
            self._go(self.chip.position - self.sign, self.home.slow_velocity)
        raise RemoteFault(f"{self.chip.name}: home switch stays closed within {SINGLE_STEPS_MAX} steps")

    def _go(self, target: int, velocity: float) -> None:
        if target == self.chip.position:
            return
        settings = choose(self.indexer, feed=velocity)
        self.chip.set_rates(settings.first, settings.rate, settings.slope)
        steps = abs(target - self.chip.position)
        self.chip.move_to(target, profile(self.indexer, settings, steps).duration_ns)

    def _ramp(self, settings: RampSettings) -> tuple[int, int]:
        """Steps and time of the way down from the top rate, at most."""
        entry_ns = ramp_entry_ns(settings.slope, self.indexer.crystal_mhz)
        slowest_ns = self.indexer.rates.period_ns(settings.first, self.indexer.crystal_mhz)
        entries = settings.rate - settings.first
        long = profile(self.indexer, settings, 1 << 24)
        half = len(long.count) // 2
        return int(long.count[:half].sum()), entries * entry_ns + 2 * slowest_ns
