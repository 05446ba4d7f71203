"""VCD: step and direction pins of steppers and the PWM of servos, for logic-analyser viewers such as GTKWave.

Value change dump of IEEE 1364-2005, section 18. Times are ns from power-up of the twin.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from groupstart.report.servo import servo_views
from machines.schema import MachineConfig
from nmc.chips import picstep
from planner.types import F8
from sim.trace import Trace

PULSE_NS = picstep.STEP_PULSE_NS


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """A pin. time_ns i8[N] ascending; values: bits 0 and 1 (width 1), or real numbers."""

    name: str
    time_ns: npt.NDArray[np.int64]
    values: F8
    real: bool = False


def step_signals(trace: Trace) -> list[Signal]:
    """Step and direction of every stepper."""
    found = []
    for number, name in enumerate(trace.axes):
        mine = trace.run_axis == number
        if not mine.any():
            continue
        rise = np.rint(trace.pulses_ns(name)).astype(np.int64)
        width = np.minimum(PULSE_NS, np.maximum(np.diff(rise, append=rise[-1] + 2 * PULSE_NS) // 2, 1))
        edges = np.stack([rise, rise + width], axis=1).ravel()
        found.append(Signal(f"{name}_step", edges, np.tile([1.0, 0.0], len(rise))))
        # the level stands before the pulse that it belongs to
        turns = np.flatnonzero(np.diff(trace.run_dir[mine], prepend=0))
        set_ns = np.maximum(trace.run_first_ns[mine][turns] - PULSE_NS, 0)
        found.append(Signal(f"{name}_dir", set_ns, (trace.run_dir[mine][turns] > 0).astype(np.float64)))
    return found


def pwm_signals(config: MachineConfig, trace: Trace) -> list[Signal]:
    """Signed PWM share of every servo where it is known, at each change."""
    found = []
    for view in servo_views(config, trace):
        if view.pwm is not None and len(view.pwm):
            change = np.flatnonzero(np.diff(view.pwm, prepend=np.nan) != 0)
            time_ns = np.rint(view.t_s[change] * 1e9).astype(np.int64) + trace.plan_start_ns
            found.append(Signal(f"{view.name}_pwm", time_ns, view.pwm[change], real=True))
    return found


def vcd_lines(signals: list[Signal]) -> Iterator[str]:
    """The lines of the file, without line ends."""
    yield "$timescale 1 ns $end"
    yield "$scope module machine $end"
    for k, signal in enumerate(signals):
        kind = "real 64" if signal.real else "wire 1"
        yield f"$var {kind} {_code(k)} {signal.name} $end"
    yield from ("$upscope $end", "$enddefinitions $end", "#0", "$dumpvars")
    yield from (f"r0 {_code(k)}" if signal.real else f"0{_code(k)}" for k, signal in enumerate(signals))
    yield "$end"
    if not signals:
        return
    times = np.concatenate([signal.time_ns for signal in signals])
    which = np.repeat(np.arange(len(signals)), [len(signal.time_ns) for signal in signals])
    values = np.concatenate([signal.values for signal in signals])
    order = np.argsort(times, kind="stable")
    now = -1
    for time_ns, k, value in zip(times[order].tolist(), which[order].tolist(), values[order].tolist(), strict=True):
        if time_ns != now:
            now = time_ns
            yield f"#{now}"
        yield f"r{value:.6g} {_code(k)}" if signals[k].real else f"{int(value)}{_code(k)}"


def _code(number: int) -> str:
    """The short name of a signal: digits out of the 94 printing characters."""
    text = ""
    while True:
        number, digit = divmod(number, 94)
        text += chr(33 + digit)
        if number == 0:
            return text
