"""Planning: job time, deviation, limits, agreement of the solvers, jerk filter, rate control, speed and memory.

python -m benchmarks.planning [--only times,agree,jerk,rate,speed] [--operations 1000] [--lines 1000000]

Limits v 60/60/20 mm/s, a 500/500/200 mm/s2, tolerance 0.010 mm. Times are CPU seconds of one process.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.planning_jobs import JOBS, LIMIT_II_S, text
from gcode.canon import Command
from gcode.interp import interpret
from gcode.run import Run
from gcode.setup import Setup
from gcode.textsource import FileSource
from planner.live import live
from planner.measure import Measured, measure
from planner.moves import Moves
from planner.paths import join_intervals
from planner.plan import plan, setting_of, windows
from planner.reader import MoveReader
from planner.timing import Rate, schedule, solve
from planner.types import Limits, Trajectory

LIMITS = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
START = np.zeros(3)
JERK = np.array([1e4, 1e4, 4e3])
TAUS_S = (0.005, 0.010, 0.020, 0.040)


def commands_of(job: str) -> list[Command]:
    found = interpret(text(job), Setup())
    assert not found.errors, found.errors[:3]
    return found.commands


def moves_of(commands: list[Command]) -> Moves:
    reader = MoveReader(LIMITS.axes, START, LIMITS.tolerance_mm)
    for command in commands:
        reader.read(command)
    return reader.take()[0]


def checked(trajectory: Trajectory, moves: Moves) -> Measured:
    return measure(trajectory, moves, LIMITS.velocity, LIMITS.acceleration)


def times(jobs: dict[str, list[Command]]) -> None:
    print(
        "\nJob time against limit (ii), deviation and vertex miss (at most 10 um), share of the axis limits at 0.1 ms"
    )
    print("job   time s     / (ii)   dev um  miss um  velocity  acceleration  intervals  plan CPU s  text to plan s")
    for job, commands in jobs.items():
        plan(commands, LIMITS, start=START, solver="kernel")
        t0 = time.process_time()
        p = plan(commands, LIMITS, start=START, solver="kernel")
        t1 = time.process_time()
        plan(Run(text(job), Setup()).stream(), LIMITS, start=START, solver="kernel")
        t2 = time.process_time()
        m, seconds = checked(p.trajectory, moves_of(commands)), p.trajectory.duration_s
        print(
            f"{job}  {seconds:9.3f}  {seconds / LIMIT_II_S[job]:8.5f}  {m.deviation_mm * 1e3:6.2f}"
            f"   {m.miss_mm * 1e3:6.2f}"
            f"  {m.velocity.max():8.6f}  {m.acceleration.max():8.6f}    {len(p.timed.intervals):9d}  {t1 - t0:9.3f}"
            f"  {t2 - t1:9.3f}"
        )


def agree(jobs: dict[str, list[Command]]) -> None:
    print("\nRelative difference in time from one global solve of the kernel")
    print("job   windows 200    windows 1000   windows 5000   toppra")
    constraints = setting_of(LIMITS, START).constraints
    for job, commands in jobs.items():
        whole = plan(commands, LIMITS, start=START, solver="kernel").trajectory.duration_s
        row = []
        for size in (200, 1000, 5000):
            parts = windows(commands, LIMITS, start=START, moves=size)
            row.append(sum(float(schedule(w, constraints)[0].duration_s.sum()) for w in parts))
        row.append(plan(commands, LIMITS, start=START, solver="toppra").trajectory.duration_s)
        print(job, " ".join(f"{seconds / whole - 1:14.1e}" for seconds in row))


def jerk(jobs: dict[str, list[Command]]) -> None:
    print("\nJerk filter: time over the plan without it, all deviation, largest axis jerk over its bound 2 a / tau")
    print("job  " + "".join(f"   tau {tau * 1e3:2.0f} ms: time   dev um miss um jerk  " for tau in TAUS_S))
    for job, commands in jobs.items():
        moves = moves_of(commands)
        without = plan(commands, LIMITS, start=START, solver="kernel").trajectory.duration_s
        cells = []
        for tau in TAUS_S:
            t = plan(commands, LIMITS, start=START, solver="kernel", filter_s=tau).trajectory
            m = checked(t, moves)
            share = float((m.jerk * tau / (2 * LIMITS.acceleration)).max())
            cost = 100 * (t.duration_s / without - 1)
            cells.append(f"{cost:14.2f} %  {m.deviation_mm * 1e3:5.2f}   {m.miss_mm * 1e3:5.2f}  {share:5.3f}")
        print(job, " ".join(cells))
    limits = replace(LIMITS, jerk=JERK)
    print("\nJerk limits 10000/10000/4000 mm/s3: width chosen, time, deviation, largest share of the limit")
    for job, commands in jobs.items():
        t = plan(commands, limits, start=START, solver="kernel").trajectory
        m = checked(t, moves_of(commands))
        worst = max(m.deviation_mm, m.miss_mm) * 1e3
        print(f"{job}  {t.tau_s * 1e3:5.1f} ms  {t.duration_s:8.2f} s  {worst:5.2f} um  {(m.jerk / JERK).max():8.6f}")


def rate(jobs: dict[str, list[Command]], operations: int) -> None:
    print(f"\n{operations} random holds, resumes and overrides on each job")
    print("job  velocity  acceleration  path off um  rest off s    rest off um  end off um  time s  CPU ms/operation")
    for job, commands in jobs.items():
        whole = plan(commands, LIMITS, start=START, solver="kernel").trajectory
        print(f"{job}    " + _disturbed(commands, whole, operations))


def _disturbed(commands: list[Command], whole: Trajectory, operations: int) -> str:
    from planner.follow import Follower

    rng = np.random.default_rng(1)
    line = whole.q(np.arange(0.0, whole.duration_s, 5e-4))
    line = line[np.concatenate([[True], np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-7])]
    t = live(commands, LIMITS, start=START, moves=500)
    follower = Follower(line, 0.3, 1e-4)
    now, checked_to, spent, done = 0.0, 0.0, 0.0, 0
    worst = np.zeros(5)
    while True:
        pause = rng.exponential(whole.duration_s / operations)
        now += pause if done < operations else 1.0
        if done >= operations and t.complete and now > t.settled_s:
            now = t.settled_s
        moments = np.arange(checked_to, now, 1e-4)
        if len(moments):
            worst[0] = max(worst[0], float((np.abs(t.v(moments)).max(axis=0) / LIMITS.velocity).max()))
            worst[1] = max(worst[1], float((np.abs(t.a(moments)).max(axis=0) / LIMITS.acceleration).max()))
            worst[2] = float(follower.take(t.q(moments))[0][-1])
        checked_to = now
        t.forget(now)
        if done >= operations and t.complete and now >= t.settled_s:
            break
        t0 = time.process_time()
        if done >= operations:
            t.override(now, Rate())
            t.resume(now)
            continue
        done += 1
        if rng.random() < 0.4:
            said = t.rest_if_held(now)
            rest = t.hold(now)
            worst[3] = max(worst[3], abs(said.time_s - rest.time_s))
            at = t.q(np.array([said.time_s, said.time_s + 1.0]))
            worst[4] = max(
                worst[4], float(np.abs(at - said.q).max()), float(np.abs(t.v(np.array([said.time_s]))).max())
            )
            if rng.random() < 0.5:
                now = max(now, rest.time_s) + 0.01
        elif t.held:
            t.resume(now)
        else:
            t.override(now, Rate(float(rng.uniform(0.05, 2.0)), float(rng.uniform(0.05, 1.0))))
        if t.held and rng.random() < 0.7:
            t.resume(now)
        spent += time.process_time() - t0
    end = np.abs(t.q(np.array([t.settled_s])) - whole.q(np.array([whole.duration_s]))).max()
    return (
        f"{worst[0]:8.6f}  {worst[1]:8.6f}    {worst[2] * 1e3:10.4f}  {worst[3]:8.1e}    {worst[4] * 1e3:10.1e}"
        f"  {end * 1e3:10.1e}  {t.settled_s:7.1f}  {spent / operations * 1e3:8.2f}"
    )


def stream(source: str | FileSource, moves: int) -> tuple[int, float, float]:
    """Segments, motion seconds and CPU seconds of planning the program text ``source`` window by window."""
    constraints = setting_of(LIMITS, START).constraints
    t0 = time.process_time()
    intervals, seconds = 0, 0.0
    for window in windows(Run(source, Setup()).stream(), LIMITS, start=START, moves=moves):
        intervals += len(window.intervals)
        seconds += float(schedule(window, constraints)[0].duration_s.sum())
    return intervals, seconds, time.process_time() - t0


def speed(lines: int) -> None:
    print("\nSpeed and memory on job c repeated, program text to trajectory, one core, warm")
    print("lines      segments/s   intervals  motion s   peak RSS MB")
    stream(text("c"), 8192)
    for repeat in sorted({max(lines // 200_000, 1), max(lines // 20_000, 1)}):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "long.nc"
            path.write_text(text("c", repeat))
            count = path.read_bytes().count(b"\n")
            _forget_peak()
            intervals, seconds, cpu = stream(FileSource(path), 8192)
        peak = _peak_mb()
        print(f"{count:9d}  {count / cpu:10.0f}  {intervals:10d}  {seconds:9.1f}  {peak:8.0f}")
    _first_window(text("c", max(lines // 20_000, 1)))
    _solvers()


def _forget_peak() -> None:
    """Begin a new high-water mark of resident memory: what the text took while it was written is not the planner's."""
    Path("/proc/self/clear_refs").write_text("5")


def _peak_mb() -> float:
    """High-water mark of resident memory in MB; of this process alone, unlike getrusage after a fork."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


FIRST = """
import sys, time
from pathlib import Path
import numpy as np
from gcode.run import Run
from gcode.setup import Setup
from planner.plan import windows
from planner.types import Limits
limits = Limits(("X", "Y", "Z"), np.array([60.0, 60, 20]), np.array([500.0, 500, 200]), 0.010)
source = Path(sys.argv[1]).read_text()
window = next(windows(Run(source, Setup()).stream(), limits, start=np.zeros(3), moves=2000))
print(len(window.intervals), time.process_time())
"""


def _first_window(source: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.nc"
        path.write_text(source)
        out = subprocess.run([sys.executable, "-c", FIRST, str(path)], capture_output=True, text=True, check=True)
    intervals, cpu = out.stdout.split()
    lines = source.count("\n")
    print(f"first window of {lines} lines: {intervals} intervals after {float(cpu):.2f} s CPU of process start")


def _solvers() -> None:
    from planner.stages import chunks

    setting = setting_of(LIMITS, START)
    path = join_intervals([c.intervals for c, _ in chunks(commands_of("c"), START, setting.rules, 8192)])
    cost: dict[str, float] = {}
    for name, runs in (("kernel", 9), ("toppra", 1)):
        best = np.inf
        for _ in range(runs):
            t0 = time.process_time()
            solve(path, setting.constraints, name)  # type: ignore[arg-type]
            best = min(best, time.process_time() - t0)
        cost[name] = best
    points = len(path) + 1
    print(
        f"solvers on {points} gridpoints of job c: kernel {points / cost['kernel'] / 1e6:.1f} M gridpoints/s, toppra "
        f"{points / cost['toppra'] / 1e3:.1f} k gridpoints/s, ratio {cost['toppra'] / cost['kernel']:.0f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="times,agree,jerk,rate,speed")
    parser.add_argument("--jobs", default="abcdef")
    parser.add_argument("--operations", type=int, default=1000)
    parser.add_argument("--lines", type=int, default=1_000_000)
    chosen = parser.parse_args()
    parts: dict[str, Callable[[dict[str, list[Command]]], None]] = {
        "times": times, "agree": agree, "jerk": jerk, "rate": lambda jobs: rate(jobs, chosen.operations),
        "speed": lambda _: speed(chosen.lines),
    }  # fmt: skip
    wanted = [name for name in parts if name in chosen.only.split(",")]
    if "speed" in wanted and len(wanted) > 1:
        wanted.remove("speed")  # in a process of its own, for its memory is measured
        alone = ["--only", "speed", "--lines", str(chosen.lines)]
    else:
        alone = []
    jobs = {job: commands_of(job) for job in JOBS if job in chosen.jobs} if wanted != ["speed"] else {}
    for name in wanted:
        parts[name](jobs)
    if alone:
        sys.stdout.flush()
        subprocess.run([sys.executable, "-m", "benchmarks.planning", *alone], check=True)


if __name__ == "__main__":
    main()
