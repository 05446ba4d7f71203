"""A talk: the steps of an exchange with a bus, and the waits between them, apart from how the waiting is done.

A talk is a generator. It yields a ``Wait`` and is sent the bytes that came meanwhile; its value is what it was about.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeVar

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Wait:
    """Until a time or, if ``count`` is not 0, until so many bytes are in, whichever is first. All ns of the link.

    leave_ns: a talk that is given up here waits at least until then, or for its bytes, so that the line falls silent;
    0: nothing is on the line.
    """

    until_ns: int
    count: int = 0
    leave_ns: int = 0


Talk = Generator[Wait, bytes, T]
