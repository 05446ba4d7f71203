"""A watchdog over a simulated port, for tests of what a session does with it."""

from __future__ import annotations

from typing import Any

from nmc.watchdog import GuardedLink, Phase, Ward, Watchdog


class Supervised(GuardedLink):
    """A link under a watchdog as a session finds one on a port."""

    def watch(self, wards: list[Ward], groups: tuple[int, ...], *, timeout_ns: int, baud: int, switches: Any) -> None:
        self.watchdog = Watchdog(wards, groups, baud=baud, timeout_ns=timeout_ns, switches=switches)

    def arm(self) -> None:
        self.watchdog.arm(self.inner.now_ns())

    def beat(self) -> None:
        self.watchdog.beat(self.inner.now_ns())

    def disarm(self) -> None:
        self.watchdog.disarm()

    @property
    def fenced(self) -> bool:
        return self.watchdog.fenced

    @property
    def motors_stand(self) -> bool:
        return self.watchdog.motors_stand

    @property
    def standing(self) -> bool:
        return self.watchdog.phase is Phase.STANDING
