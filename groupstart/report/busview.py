"""The bus over time: every exchange with its time on the wire, what it was for, and how late it left.

Watching a run gives more than its bytes: when each exchange was due. Slack is the time between the moment the bus was
free and the moment an exchange had to leave; an exchange that left after its time is late.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nmc.chips.common import NOP
from nmc.program import Evidence
from planner.types import F8

LATE_NS = 300_000
"""Later than this after its time an exchange counts as late here; below it the host's jitter is at work."""
KINDS = ("load", "start", "status", "other")
LOAD, START = 4, 5
STEP_LOAD_WITH_START = 0x04


class BusWatch:
    """Give its ``watch`` to a run; afterwards ``view`` tells what the buses did."""

    def __init__(self) -> None:
        self._columns = {name: array("q") for name in ("bus", "address", "command", "due", "sent", "replied", "line")}
        self._bytes = array("q")

    def watch(self, evidence: Evidence) -> None:
        """Note one exchange."""
        exchange, columns = evidence.exchange, self._columns
        columns["bus"].append(exchange.bus)
        columns["address"].append(exchange.address)
        columns["command"].append(exchange.command)
        columns["due"].append(exchange.send_at_ns)
        columns["sent"].append(evidence.sent_ns)
        columns["replied"].append(evidence.replied_ns)
        columns["line"].append(exchange.line)
        self._bytes.append(len(exchange.data))

    def view(self, plan_start_ns: int) -> BusView:
        """What was noted, on the plan's clock."""
        c = {name: np.array(values, dtype=np.int64) for name, values in self._columns.items()}
        order = np.argsort(c["sent"], kind="stable")  # exchanges of several buses end in another order than they begin
        c = {name: values[order] for name, values in c.items()}
        free = c["sent"].copy()
        for bus in np.unique(c["bus"]):
            mine = np.flatnonzero(c["bus"] == bus)
            free[mine[1:]] = c["replied"][mine[:-1]]
        due = np.where(c["due"] > 0, c["due"], c["sent"])
        kind = np.full(len(free), 3, np.uint8)
        kind[c["command"] == LOAD] = 0
        kind[c["command"] == START] = 1
        kind[(c["command"] == NOP)] = 2
        return BusView(
            c["bus"], c["address"], kind, np.asarray((c["sent"] - plan_start_ns) * 1e-9),
            np.asarray((c["replied"] - plan_start_ns) * 1e-9), np.asarray((due - free) * 1e-6),
            np.maximum(c["sent"] - due, 0) * 1e-6, c["line"],
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class BusView:
    """N exchanges in the order in which they left. bus, address, line i8[N]; kind u1[N] index into ``KINDS``.

    begin_s, end_s f8[N] on the plan's clock; slack_ms f8[N] (negative: the bus was not free when it was due); late_ms
    f8[N] after its time.
    """

    bus: npt.NDArray[np.int64]
    address: npt.NDArray[np.int64]
    kind: npt.NDArray[np.uint8]
    begin_s: F8
    end_s: F8
    slack_ms: F8
    late_ms: F8
    line: npt.NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.begin_s)

    @property
    def late(self) -> npt.NDArray[np.bool_]:
        """Exchanges that left more than ``LATE_NS`` after their time."""
        late: npt.NDArray[np.bool_] = self.late_ms > LATE_NS * 1e-6
        return late

    def utilisation(self, end_s: float, bins: int) -> tuple[F8, F8]:
        """Middle of each of ``bins`` stretches of time and the share of it in which a bus was busy, on average."""
        edges = np.linspace(0.0, max(end_s, 1e-9), bins + 1)
        buses = np.unique(self.bus).tolist()
        shares = [np.clip(np.diff(self._busy_s(bus, edges)) / np.diff(edges), 0.0, 1.0) for bus in buses]
        return 0.5 * (edges[:-1] + edges[1:]), np.mean(shares, axis=0) if shares else np.zeros(bins)

    def _busy_s(self, bus: int, at_s: F8) -> F8:
        """Busy time of a bus before given instants: whole exchanges, and the part of the one that is under way."""
        begin_s, end_s = (column[self.bus == bus] for column in (self.begin_s, self.end_s))
        busy = np.concatenate([[0.0], np.cumsum(end_s - begin_s)])
        at = np.searchsorted(begin_s, at_s, side="right")
        last = np.maximum(at - 1, 0)
        over: F8 = np.where(at > 0, np.maximum(end_s[last] - at_s, 0.0), 0.0)
        return np.asarray(busy[at] - over)
