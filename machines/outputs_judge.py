"""What the output pins did against what was planned of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from machines.outputs import switched_pins, valued_pins
from machines.outputs_events import Switched
from machines.schema import MachineConfig
from machines.verdict import OutputUse, Verdict
from sim.trace import Trace

BEFORE_NS = 20_000_000
"""What changed more than this before t = 0 belongs to the start-up."""


def with_outputs_judged(
    verdict: Verdict, config: MachineConfig, switched: Sequence[Switched], trace: Trace | None, plan_start_ns: int
) -> Verdict:
    """The verdict with what is to be said of the outputs: how far off in time, and which did not change at all."""
    if not switched:
        return verdict
    off_ms, reasons = (_said(switched), []) if trace is None else _seen(config, switched, trace, plan_start_ns)
    worst = float(np.max(np.abs(off_ms), initial=0.0))
    if trace is not None and worst > config.verify.output_ms:
        reasons.append(f"an output changed {worst:.1f} ms off its planned instant")
    rms = float(np.sqrt(np.mean(np.square(off_ms)))) if len(off_ms) else 0.0
    reasons = [*verdict.reasons, *reasons]
    use = OutputUse(len(off_ms), worst, rms)
    return replace(verdict, ok=not reasons, reasons=tuple(reasons), outputs=use)


def _said(switched: Sequence[Switched]) -> list[float]:
    """As the commands left, on a port: nothing tells when a pin changes there."""
    return [(item.sent_ns - item.planned_ns) / 1e6 for item in switched if item.name != "spindle"]


def _seen(
    config: MachineConfig, switched: Sequence[Switched], trace: Trace, plan_start_ns: int
) -> tuple[list[float], list[str]]:
    """As the pins changed: every planned change against the change of its pin, one after the other."""
    pins = {name: (pin, pin.active_low) for name, pin in switched_pins(config).items()}
    pins |= {name: (value.pin, False) for name, value in valued_pins(config).items()}
    off_ms: list[float] = []
    reasons: list[str] = []
    for name, (pin, low) in pins.items():
        wanted = [item for item in switched if item.name == name]
        label = f"{pin.module}.{pin.pin}"
        index = trace.pin_names.index(label) if label in trace.pin_names else -1
        mine = (trace.pin_index == index) & (trace.pin_ns >= plan_start_ns - BEFORE_NS)
        found = list(zip(trace.pin_ns[mine].tolist(), trace.pin_value[mine].tolist(), strict=True))
        levels = [int(item.value) ^ 1 if low else int(item.value) for item in wanted]
        if [value for _, value in found] != levels:
            reasons.append(f"{name} ({label}) did not change as planned: {len(found)} of {len(levels)} changes seen")
            continue
        off_ms += [(at_ns - item.planned_ns) / 1e6 for (at_ns, _), item in zip(found, wanted, strict=True)]
    return off_ms, reasons
