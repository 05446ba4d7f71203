"""What a stream raises when the chips do not do what the twins say they must."""

from __future__ import annotations


class StreamError(Exception):
    """A reply contradicts the twins: positions can no longer be vouched for and every group must be stopped.

    axis: motor name.
    """

    def __init__(self, message: str, axis: str) -> None:
        super().__init__(message)
        self.axis = axis
