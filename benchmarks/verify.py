"""How fast offline runs are, from the sources and compiled, side by side: python -m benchmarks.verify

Jobs a to f (``benchmarks.planning_jobs``) through ``groupstart verify`` on mill3-step, from the command to its verdict:
seconds of motion over CPU seconds (user and system) and over the wall clock. Then an exchange of the adaptive stream,
three axes at 20 mm/s: with the simulator, and of the host alone, against a link that hands out what the simulator has
answered before. Medians; goals: 30 times real time, 0.1 ms an exchange of the host. Exit status 1 if what is compiled
misses one. Compile first: python -m groupstart.compiling
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from groupstart.compiled import FINDER, ROOMS, SWITCH

# isort: split
# groupstart comes first, so that the rooms are imported compiled
from benchmarks.paths import ClosedForm, random_path
from benchmarks.planning_jobs import LIMIT_II_S, text
from benchmarks.rig import Conditions, module_of, start_bus, timing_of
from nmc.bus import Bus
from nmc.executor import play
from nmc.link import Link
from planner.motors import Motor
from planner.stream import lead_in_ns, make_source
from sim.build import build
from sim.spec import BusSpec

RATIO_GOAL, HOST_GOAL_MS = 30.0, 0.1
PATH: ClosedForm = random_path(1, 20.0)
CONDITIONS = Conditions(jitter_ms=0.2)
MODES = {"sources": "0", "compiled": "1"}
VERIFY = ("groupstart", "verify", "-m", "mill3-step", "--json")
WARMING = "G21 G90 F1200\nG1 X1\nG1 Y1\nM2\n"
"""A program that is run first: then bytecode and numba's code are there, as in every run but the first."""


class Recorder:
    """A link around another that keeps, in order, what came and when."""

    def __init__(self, inner: Link) -> None:
        self.inner = inner
        self.answers: list[tuple[bytes, int]] = []
        self.now_ns, self.write = inner.now_ns, inner.write
        self.set_baud, self.flush_input, self.close = inner.set_baud, inner.flush_input, inner.close

    def read(self, count: int, deadline_ns: int) -> bytes:
        data = self.inner.read(count, deadline_ns)
        self.answers.append((data, self.inner.now_ns()))
        return data

    def sleep_until(self, time_ns: int) -> None:
        self.inner.sleep_until(time_ns)
        self.answers.append((b"", self.inner.now_ns()))


class Replay:
    """A link that gives recorded answers at once."""

    def __init__(self, answers: list[tuple[bytes, int]]) -> None:
        self._answers = iter(answers)
        self._now_ns = 0

    def now_ns(self) -> int:
        return self._now_ns

    def read(self, count: int, deadline_ns: int) -> bytes:
        data, self._now_ns = next(self._answers)
        return data

    def sleep_until(self, time_ns: int) -> None:
        _, self._now_ns = next(self._answers)

    def write(self, data: bytes) -> None:
        pass

    def set_baud(self, baud: int) -> None:
        pass

    def flush_input(self) -> None:
        pass

    def close(self) -> None:
        pass


def simulated() -> Link:
    """The host's end of a fresh simulation."""
    modules = tuple(module_of(name, CONDITIONS) for name in PATH.axes)
    return build([BusSpec("main", modules, round(CONDITIONS.jitter_ms * 1e6))], CONDITIONS.seed).links[0]


def streamed(link: Link) -> tuple[int, float]:
    """Exchanges of the stream on this link, and the CPU seconds that they took."""
    bus, motors = start_bus(link, PATH.axes, CONDITIONS)
    return timed(bus, motors)


def timed(bus: Bus, motors: list[Motor]) -> tuple[int, float]:
    timing = timing_of(CONDITIONS)
    start_ns = bus.link.now_ns() + lead_in_ns(motors, timing)
    source = make_source(PATH, motors, timing=timing, start_ns=start_ns, profile="adaptive")
    begin_s = time.process_time()
    count = sum(1 for _ in play(bus, source))
    return count, time.process_time() - begin_s


def exchanges(repeats: int) -> dict[str, float]:
    """CPU time of an exchange in ms: with the simulator, and of the host alone."""
    recorder = Recorder(simulated())
    recorded, _ = streamed(recorder)
    whole, host = [], []
    for _ in range(repeats):
        count, spent_s = streamed(simulated())
        whole.append(1e3 * spent_s / count)
        count, spent_s = streamed(Replay(recorder.answers))
        assert count == recorded
        host.append(1e3 * spent_s / count)
    return {"with simulator": statistics.median(whole), "host alone": statistics.median(host)}


def in_mode(mode: str, command: list[str]) -> tuple[str, float, float]:
    """Output, CPU seconds and seconds of a command of this Python."""
    before, begin_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    environment = os.environ | {SWITCH: MODES[mode]}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # what is installed has its bytecode
    done = subprocess.run(
        [sys.executable, "-m", *command], env=environment, capture_output=True, text=True, check=False
    )
    wall_s, after = time.perf_counter() - begin_s, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 1) or not done.stdout:
        raise SystemExit(done.stderr)
    return done.stdout, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall_s


def verified(program: str, mode: str, repeats: int) -> tuple[float, int, float, float]:
    """Seconds of motion, exchanges, and the medians of CPU and wall clock seconds of a verify."""
    runs = [in_mode(mode, [*VERIFY, program]) for _ in range(repeats)]
    verdict = json.loads(runs[0][0])
    cpu_s, wall_s = (statistics.median(run[k] for run in runs) for k in (1, 2))
    return verdict["sim_time_s"], verdict["bus"]["packets"], cpu_s, wall_s


def jobs(names: str, modes: list[str], repeats: int) -> bool:
    """One line a job; whether every ratio of what is compiled reaches its goal."""
    reached = True
    print("job  motion s  exchanges " + "".join(f"{mode:>10s}: CPU s  x real time (wall)" for mode in modes))
    with tempfile.TemporaryDirectory() as folder:
        warming = Path(folder) / "warming.nc"
        warming.write_text(WARMING)
        for mode in modes:
            in_mode(mode, [*VERIFY, str(warming)])
        for name in names:
            program = Path(folder) / f"{name}.nc"
            program.write_text(text(name))
            told = ""
            for mode in modes:
                motion_s, packets, cpu_s, wall_s = verified(str(program), mode, repeats)
                told += f"{cpu_s:17.2f} {motion_s / cpu_s:9.1f} {f'({motion_s / wall_s:.1f})':>12s}"
                reached &= mode != "compiled" or motion_s / cpu_s >= RATIO_GOAL
            print(f"{name:3s} {motion_s:9.1f} {packets:10d} {told}", flush=True)
    return reached


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", default="".join(LIMIT_II_S), help="letters of the jobs (all)")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--exchanges", action="store_true", help="of this process, as JSON: what the other rows run")
    options = parser.parse_args()
    if options.exchanges:
        print(json.dumps(exchanges(options.repeats)))
        return 0
    FINDER.find_spec(ROOMS[0], None)
    print(FINDER.state)
    modes = list(MODES) if FINDER.active else ["sources"]
    reached = jobs(options.jobs, modes, options.repeats)
    found = {}
    for mode in modes:
        command = ["benchmarks.verify", "--exchanges", "--repeats", str(options.repeats)]
        found[mode] = json.loads(in_mode(mode, command)[0])
    for row in ("with simulator", "host alone"):
        print(f"an exchange, {row:15s}", "".join(f"{mode:>10s} {found[mode][row]:.3f} ms" for mode in modes))
    return int(not reached or found.get("compiled", {"host alone": 0.0})["host alone"] > HOST_GOAL_MS)


if __name__ == "__main__":
    sys.exit(main())
