"""The preview page of a long program: time against ``plan``, memory, size, and what a browser makes of it.

python -m benchmarks.preview [--lines 1000000] [--no-browser]

Times are CPU seconds of a process of its own for each command. The browser is a headless Chromium with software WebGL,
found as the browser tests find it; times in it are wall times.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]


def write_program(path: Path, lines: int) -> None:
    """A finishing pass over a wavy surface of 100 mm by 100 mm, in rows."""
    rows = max(int((lines / 4) ** 0.5), 1)
    along = lines // rows - 1
    with path.open("w") as file:
        file.write("G21 G90 G64 P0.01\nG0 Z5\nG0 X0 Y0\nG1 Z0 F600\nF1800\n")
        for row in range(rows):
            x = np.linspace(0, 100, along)[:: 1 if row % 2 == 0 else -1]
            y = row * 100 / rows
            z = -2 + 1.5 * np.sin(x * 0.3 + y * 0.1) * np.cos(y * 0.2)
            file.writelines(f"G1 X{a:.3f} Y{y:.3f} Z{b:.3f}\n" for a, b in zip(x, z, strict=True))
            file.write(f"G1 Y{y + 100 / rows:.3f}\n")
        file.write("G0 Z5\nM2\n")


def cost(*arguments: str) -> tuple[float, float]:
    """CPU seconds and peak memory in GB of ``groupstart`` with these arguments."""
    script = (
        "import resource, sys\nfrom groupstart.cli import main\nsys.argv[1:] = " + repr(list(arguments)) + "\n"
        "try:\n    main()\nexcept SystemExit as leaving:\n    assert not leaving.code, leaving.code\n"
        "use = resource.getrusage(resource.RUSAGE_SELF)\n"
        "print(use.ru_utime + use.ru_stime, use.ru_maxrss / 1e6)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True)
    seconds, memory = done.stdout.split("\n")[-2].split()
    return float(seconds), float(memory)


def in_browser(page: Path) -> str:
    """Time of the first picture, of everything, and the longest task afterwards while it is used."""
    sys.path.insert(0, str(ROOT / "tests" / "groupstart"))
    from report_browser import Browser, find_chromium  # type: ignore[import-not-found]

    chromium = find_chromium()
    if chromium is None:
        return "no Chromium found"
    with Browser(chromium) as browser:
        browser.open(page)
        browser.run(
            "window.__long = []; new PerformanceObserver((list) => window.__long.push(...list.getEntries()"
            ".map((e) => e.duration))).observe({ type: 'longtask' }); 0"
        )
        for script in (
            "groupstart.setTime(groupstart.page.duration_s / 3)", "groupstart.legend.set('cause')",
            "groupstart.plots.zoom(100, 200)", "groupstart.toLine(Math.floor(groupstart.program.count * 0.7))",
            "groupstart.legend.set('accel')", "groupstart.scene.look('top')", "groupstart.plots.zoom(0, 1e9)",
        ):  # fmt: skip
            browser.run(script)
            browser.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        longest = max([0.0, *browser.run("window.__long")])
        state = browser.run("window.__state")
        faults = browser.faults or "none"
    return (
        f"first picture {state['first_picture_ms'] / 1e3:.2f} s, all {state['ready_ms'] / 1e3:.2f} s, "
        f"longest task afterwards {longest:.0f} ms, faults: {faults}"
    )


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--lines", type=int, default=1_000_000)
    parser.add_argument("--no-browser", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        program, page = Path(folder, "surface.nc"), Path(folder, "surface.html")
        write_program(program, options.lines)
        short, warm = Path(folder, "short.nc"), Path(folder, "short.html")
        write_program(short, 200)
        cost("preview", str(short), "-o", str(warm))  # compiles what is to be compiled
        plan_s, plan_gb = cost("plan", str(program))
        preview_s, preview_gb = cost("preview", str(program), "-o", str(page))
        print(f"{options.lines} lines, {program.stat().st_size / 1e6:.1f} MB")
        print(f"plan     {plan_s:6.1f} s CPU, {plan_gb:.2f} GB")
        print(f"preview  {preview_s:6.1f} s CPU, {preview_gb:.2f} GB, {preview_s / plan_s:.2f} times plan")
        print(f"page     {page.stat().st_size / 1e6:.1f} MB")
        if not options.no_browser:
            print("browser ", in_browser(page))


if __name__ == "__main__":
    main()
