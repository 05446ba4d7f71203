"""Speed of the interpreter: a CAM file of 300,000 lines, loops of O-words, expressions on every line, memory, start.

    python benchmarks/interpreter.py            all figures, and LinuxCNC's rs274 beside them where it is installed
    python benchmarks/interpreter.py --write F  only writes the CAM file

CPU time (user + system) of whole processes, and the steady rate inside one. The figures of one run are comparable with
each other only: run on a quiet machine.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

REPEATS = 3


def number(value: float, decimals: int) -> str:
    """As CAM writes it: trailing and leading zeros dropped."""
    text = f"{value:.{decimals}f}".rstrip("0")
    if text in {"0.", "-0."}:
        return "0."
    return text.replace("0.", ".", 1) if text.startswith(("0.", "-0.")) else text


def cam_program(lines: int = 300_000, seed: int = 1) -> str:
    """Raster finishing of a wavy surface: modal G1 with changed words only, arcs and helices between the rows."""
    rng = np.random.default_rng(seed)
    out = ["%", "(RASTER FINISHING)", "G21 G90 G17 G94", "G91.1", "T1 M6", "G54", "G43 H1", "S12000 M3", "M8"]
    out += ["G53 G0 Z0.", "G0 X-120. Y-80.", "G0 Z15.", "G1 Z2. F300.", "F1800."]
    x, y, z, row = -120.0, -80.0, 2.0, 0
    while len(out) < lines - 6:
        direction = 1 if row % 2 == 0 else -1
        for _ in range(int(rng.integers(120, 240))):
            x += direction * rng.uniform(0.25, 0.45)
            y += rng.uniform(0.0002, 0.0009)
            z = round(12.0 + 5.0 * np.sin(x / 7.0) * np.cos(y / 5.0), 4)
            decimals = 4 if rng.random() < 0.7 else 3
            words = f"X{number(x, decimals)} Y{number(y, decimals)} Z{number(z, decimals)}"
            out.append("G1 " + words if rng.random() < 0.01 else words)
        x, y = round(x, 3), round(y, 3)
        out.append(f"G1 X{number(x, 3)} Y{number(y, 3)}")
        for _ in range(int(rng.integers(10, 40))):
            radius = round(rng.uniform(0.2, 2.2), 3)
            code = "G2" if rng.random() < 0.5 else "G3"
            helix = ""
            if rng.random() < 0.2:
                z = round(z + 0.01, 4)
                helix = f" Z{number(z, 4)}"
            side = 1 if rng.random() < 0.5 else -1
            x = round(x + side * 2 * radius, 3)
            out.append(f"{code} X{number(x, 3)} Y{number(y, 3)}{helix} I{number(side * radius, 3)} J0.")
        y = round(y + 0.3, 3)
        out.append(f"G1 Y{number(y, 3)}")
        row += 1
        if row % 40 == 0:
            out += ["G0 Z25.", "(NEXT REGION)", f"G1 Z{number(z, 4)} F300.", "F1800."]
    out += ["G0 Z25.", "M9", "M5", "G49", "M30", "%"]
    return "\n".join(out) + "\n"


LOOP = """G21 G90 G17 G94
F1000
#1=0
o100 while [#1 LT 100000]
#2=[SIN[#1]*10+#1/3]
G1 X#2 Y[#2*0.5+COS[#1]]
#1=[#1+1]
o100 endwhile
M2
"""

CALLS = """G21 G90 G17 G94
F1000
o200 sub
#<r>=#1
o201 if [#<r> GT 50]
G1 X[#<r>] Y#2
o201 else
G1 X[#<r>+1] Y[#2-1]
o201 endif
o200 endsub
#1=0
o100 while [#1 LT 20000]
o200 call [#1 MOD 100] [#1/2]
#1=[#1+1]
o100 endwhile
M2
"""


def expressions(lines: int = 100_000) -> str:
    """Every line an expression, every line another one."""
    rng = np.random.default_rng(3)
    out = ["G21 G90 F1000", "#1=2.5"]
    for n in range(lines):
        a, b = rng.uniform(-50, 50, 2)
        out.append(
            f"G1 X[{a:.3f}+#1*{b:.2f}] Y[SIN[{n % 360}]*{abs(b):.3f}/2]" if n % 3 else f"#1=[{a:.4f}/{abs(b) + 1:.3f}]"
        )
    return "\n".join([*out, "M2", ""])


CHILD = """
import sys
from pathlib import Path
from gcode.interp import FileRun
rows = 0
run = FileRun(Path(sys.argv[1]))
for item in run:
    rows += len(item) if type(item).__name__ == "MoveBlock" else 1
status = Path("/proc/self/status").read_text()
resident = int(status.split("VmHWM:")[1].split()[0]) if "VmHWM:" in status else 0
print(rows, resident, sum(d.severity == "error" for d in run.diagnostics))
"""


def cpu(command: list[str], **options: Any) -> tuple[float, str]:
    """CPU seconds of a child process (the least of some repeats) and what it printed."""
    best, text = float("inf"), ""
    for _ in range(REPEATS):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        result = subprocess.run(command, capture_output=True, check=False, stdin=subprocess.DEVNULL, **options)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        if used < best:
            best, text = used, result.stdout.decode("utf-8", "replace")
    return best, text


def ours(path: Path) -> tuple[float, int, int, int]:
    """CPU seconds, rows, resident kB and errors of the interpreter as a whole process."""
    root = Path(__file__).resolve().parent.parent
    seconds, text = cpu([sys.executable, "-c", CHILD, str(path)], env={**os.environ, "PYTHONPATH": str(root)})
    rows, kilobytes, errors = (int(word) for word in text.split())
    return seconds, rows, kilobytes, errors


def theirs(path: Path, folder: Path) -> float:
    """CPU seconds of rs274 writing to a file."""
    (folder / "t.tbl").write_text("T1 P1 Z1 D0.25\n")
    (folder / "f.ini").write_text("[RS274NGC]\nPARAMETER_FILE = rs274.var\n")
    (folder / "rs274.var").write_text("")
    command = ["rs274", "-t", "t.tbl", "-v", "rs274.var", "-i", "f.ini", "-g", str(path), "out.txt"]
    return cpu(command, cwd=folder, env={**os.environ, "HOME": str(folder)})[0]


def steady(text: str) -> float:
    """CPU seconds inside the process for one pass over ``text``, tables warm."""
    from gcode.run import Run
    from gcode.setup import Setup
    from gcode.textsource import TextSource

    best = float("inf")
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_SELF)
        for _item in Run(TextSource(text), Setup()).stream():
            pass
        after = resource.getrusage(resource.RUSAGE_SELF)
        best = min(best, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return best


def check_of_a_short_program(folder: Path) -> float:
    """CPU seconds of ``groupstart check`` of a hundred lines, the whole process."""
    path = folder / "short.ngc"
    lines = [f"G1 X{n * 0.5:.3f} Y{n % 7}.25 Z-{n * 0.01:.3f} F{300 + n}" for n in range(93)]
    path.write_text("\n".join(["G21 G90 G17", "T1 M6", "S1000 M3", "G0 X0 Y0 Z5", *lines, "G0 Z5", "M5", "M2", ""]))
    root = Path(__file__).resolve().parent.parent
    command = [sys.executable, "-m", "groupstart", "check", str(path)]
    return cpu(command, env={**os.environ, "PYTHONPATH": str(root)})[0]


def executed_lines(name: str, lines: int) -> int:
    return {"loop": 500_000, "calls": 20_000 * 9}.get(name, lines)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--write")
    arguments = parser.parse_args()
    if arguments.write:
        Path(arguments.write).write_text(cam_program())
        return
    has_oracle = shutil.which("rs274") is not None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        heads = ("CPU s", "lines/s", "steady/s", "rs274 CPU s", "ratio", "MB")
        print(f"{'program':12s} " + " ".join(f"{head:>12s}" for head in heads))
        programs = {"cam 300k": cam_program(), "loop": LOOP, "calls": CALLS, "expressions": expressions()}
        for title, text in programs.items():
            path = folder / "program.ngc"
            path.write_text(text)
            lines = executed_lines(title, text.count("\n"))
            seconds, _rows, kilobytes, errors = ours(path)
            other = theirs(path, folder) if has_oracle else float("nan")
            rate = lines / steady(text)
            note = f"  {errors} errors" if errors else ""
            figures = (seconds, lines / seconds, rate, other, other / seconds, kilobytes / 1024)
            texts = [f"{value:12,.0f}" if value > 1000 else f"{value:12.3f}" for value in figures]
            print(f"{title:12s} " + " ".join(texts) + note)
        for lines in (500_000, 5_000_000):
            path.write_text(cam_program(lines))
            seconds, rows, kilobytes, _ = ours(path)
            print(f"{lines:9,d} lines: {seconds:.2f} s, {rows:,d} rows, {kilobytes / 1024:.0f} MB resident")
        print(f"check of 100 lines: {check_of_a_short_program(folder):.3f} s")


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
    main()
