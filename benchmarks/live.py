"""What a running program costs its host: python -m benchmarks.live

``groupstart sim --pty`` serves mill3-step in real time; a program of ten seconds runs on its terminal from the sources
and compiled. CPU time (user and system, all threads) of the running process from the first to the last exchange of the
stream, over their number; goal: 0.5 ms. A run that stops on its own, because this computer is too busy, is tried again.
Exit status 1 if an exchange costs more, 2 if no run came to its end.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from groupstart.compiled import FINDER, ROOMS, SWITCH

# isort: split
# groupstart comes first, so that the rooms are imported compiled
from gcode.setup import Setup
from machines.job import plan_job, read_job
from machines.load import MachineFile, read_machine
from machines.runner import RunOptions, perform
from nmc.program import Evidence

GOAL_MS = 0.5
TRIES = 5
PATIENCE_MS = 2000.0
PROGRAM = """G21 G90 G64 P0.01 F1200
G1 X20 Y8
G3 X20 Y28 I0 J10
G1 X8 Y20 Z2
G2 X8 Y0 I0 J-10
G1 X40 Y20 Z0
G3 X20 Y40 I-20 J0
G1 X0 Y0
M2
"""
MODES = {"sources": "0", "compiled": "1"}


class Meter:
    """Told of every exchange of a run."""

    def __init__(self) -> None:
        self.exchanges = 0
        self._begun_s = self._last_s = 0.0

    def __call__(self, evidence: Evidence) -> None:
        self._last_s = time.process_time()
        if not self.exchanges:
            self._begun_s = self._last_s
        self.exchanges += 1

    @property
    def ms(self) -> float:
        """CPU time an exchange."""
        return 1e3 * (self._last_s - self._begun_s) / max(self.exchanges - 1, 1)


def patient(machine: MachineFile) -> MachineFile:
    """Its watchdog waits for a computer that has much else to do: what is measured is no time but work."""
    buses = {name: bus.model_copy(update={"watchdog_ms": PATIENCE_MS}) for name, bus in machine.config.bus.items()}
    return replace(machine, config=machine.config.model_copy(update={"bus": buses}))


def run(device: str, profile: str) -> dict[str, float | str]:
    """Run the program on a terminal; what its exchanges cost."""
    machine = patient(read_machine("mill3-step"))
    job = read_job(PROGRAM, Setup(), machine.config)
    plan = plan_job(job, machine.config)
    meter = Meter()
    options = replace(RunOptions(port=device, profile=profile, ask=lambda request: True), watch=meter)
    result = perform(job, plan, machine, options)
    late = 0 if result.verdict is None else result.verdict.late_slices
    motion_s = plan.trajectory.duration_s
    return {
        "fault": result.fault, "exchanges": meter.exchanges, "ms": meter.ms, "late": late,
        "share": meter.exchanges * meter.ms / 1e3 / motion_s,
    }  # fmt: skip


@contextmanager
def served() -> Iterator[str]:
    """A simulated machine in a process of its own; its terminal."""
    command = [sys.executable, "-m", "groupstart", "sim", "--pty", "-m", "mill3-step"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()


def measured(mode: str, profile: str) -> dict[str, float | str]:
    """What a run costs in a mode: the first of a few that comes to its end, or the last."""
    for _ in range(TRIES):
        told = once(mode, profile)
        if not told["fault"]:
            break
    return told


def once(mode: str, profile: str) -> dict[str, float | str]:
    """One run."""
    with served() as device:
        command = [sys.executable, "-m", "benchmarks.live", "--run", device, "--profile", profile]
        done = subprocess.run(
            command, env=os.environ | {SWITCH: MODES[mode]}, stdout=subprocess.PIPE, text=True, check=True
        )
    told: dict[str, float | str] = json.loads(done.stdout)
    return told


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--profile", default="adaptive")
    parser.add_argument("--run", metavar="DEVICE", help="run on this terminal and print JSON: what the others call")
    options = parser.parse_args()
    if options.run:
        print(json.dumps(run(options.run, options.profile)))
        return 0
    FINDER.find_spec(ROOMS[0], None)
    status = 0
    for mode in MODES if FINDER.active else ("sources",):
        told = measured(mode, options.profile)
        if told["fault"]:
            print(f"{mode}: {told['fault']}")
            return 2
        share = f"{100 * float(told['share']):.0f} % of a core"
        cost = f"{told['ms']:.3f} ms an exchange, {told['exchanges']} exchanges, {share}"
        print(f"{mode:9s} {cost}, {told['late']} late slices", flush=True)
        status |= float(told["ms"]) > GOAL_MS
    return status


if __name__ == "__main__":
    sys.exit(main())
