"""Several buses of one simulated machine behind pseudo-terminals, served together: one world, one clock."""

from __future__ import annotations

import select
from collections.abc import Callable, Sequence

from sim.virtualport import VirtualPort


def serve_all(ports: Sequence[VirtualPort], stopped: Callable[[], bool]) -> None:
    """Serve the clients of all ports until ``stopped()`` says so; it is asked at least every 50 ms."""
    while not stopped():
        ready, _, _ = select.select([port.master for port in ports], [], [], min(port.patience_s() for port in ports))
        for port in ports:
            port.turn(port.master in ready)
