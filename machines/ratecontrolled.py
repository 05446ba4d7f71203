"""What rate control asks of a stream, and at run time whether a stream has it: not all, with index moves."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from planner.stream_strain import Off
from planner.timing import Rate
from planner.types import Trajectory


@runtime_checkable
class Planned(Protocol):
    """A stream whose plan begins at a time."""

    plan_start_ns: int


@runtime_checkable
class Assuming(Protocol):
    """A stream that can be told what to assume of its host."""

    def assume(self, jitter_max_ns: int) -> None:
        """What the host may add before a packet."""


@runtime_checkable
class RateControlled(Protocol):
    """A stream that can be held and overridden; ``planner.stream.StreamSource`` is one."""

    trajectory: Trajectory
    plan_start_ns: int

    def hold(self) -> float:
        """Come to rest; s of the plan. Raises ValueError where that cannot be."""

    def resume(self) -> None:
        """Go on."""

    def override(self, rate: Rate) -> None:
        """Change the rate of what has not been sent."""

    def assume(self, jitter_max_ns: int) -> None:
        """What the host may add before a packet."""

    def offs(self) -> list[Off]:
        """How far behind its plan each motor is believed to be."""

    @property
    def held(self) -> bool:
        """A hold is on."""

    @property
    def holding(self) -> bool:
        """A hold is on and every axis stands."""
