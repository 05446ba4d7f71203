"""Digests: what ran and what came out, as one short text each, equal if and only if every bit is.

Times and bytes are integers and the arithmetic of the twin is exact or IEEE double in a fixed order, so program,
machine and seed decide them, whatever the platform and however many workers share the work.
"""

from __future__ import annotations

import hashlib

import numpy as np

from sim.trace import Trace

LENGTH = 32
_BUS = ("bus_ns", "bus_line", "bus_byte")
_PINS = (
    "run_axis", "run_first_ns", "run_period_ns", "run_count", "run_dir", "start_steps",
    "servo_axis", "servo_ns", "servo_command", "servo_position", "slip_axis", "slip_ns", "slip_steps",
)  # fmt: skip


def text_digest(text: str) -> str:
    """Of a text, line ends as they are."""
    return hashlib.sha256(text.encode("utf-8")).hexdigest()[:LENGTH]


def exchanges_digest(trace: Trace) -> str:
    """Of every byte on the buses with its time."""
    return _digest(trace, _BUS)


def trace_digest(trace: Trace) -> str:
    """Of every pulse, servo sample and slip with its time."""
    return _digest(trace, _PINS)


def _digest(trace: Trace, names: tuple[str, ...]) -> str:
    total = hashlib.sha256(",".join(trace.axes).encode())
    for name in names:
        values = np.ascontiguousarray(getattr(trace, name))
        total.update(f"{name}:{len(values)}:".encode())
        total.update(values.astype(values.dtype.newbyteorder("<")).tobytes())
    return total.hexdigest()[:LENGTH]
