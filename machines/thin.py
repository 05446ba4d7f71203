"""Thinning of saved traces: servo samples come at every servo tick, two thousand a second and motor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sim.trace import Trace


def thin_servo(trace: Trace, every: int) -> Trace:
    """Keep each motor's first sample and every ``every``-th after it, and its last; steps and bus stay whole."""
    if every <= 1 or not len(trace.servo_axis):
        return trace
    keep = np.zeros(len(trace.servo_axis), dtype=np.bool_)
    for motor in np.unique(trace.servo_axis):
        mine = np.flatnonzero(trace.servo_axis == motor)
        keep[mine[::every]] = True
        keep[mine[-1]] = True
    return replace(
        trace,
        servo_axis=trace.servo_axis[keep],
        servo_ns=trace.servo_ns[keep],
        servo_command=trace.servo_command[keep],
        servo_position=trace.servo_position[keep],
        servo_fraction=trace.servo_fraction[keep] if len(trace.servo_fraction) else trace.servo_fraction,
    )
