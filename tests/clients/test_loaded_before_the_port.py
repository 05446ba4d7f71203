"""A run on a port loads all its code before the port is opened: while a machine moves nothing is imported."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from groupstart.compiled import SWITCH

pytestmark = pytest.mark.clients

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import sys
from groupstart.compiled import FINDER, KERNELS, LIBRARY, ROOMS
from nmc import serial_link, watchdog_process
opened, closed = [], []
class Link(serial_link.SerialLink):
    def __init__(self, *args):
        opened.append(set(sys.modules))
        super().__init__(*args)
    def close(self):
        closed.append(set(sys.modules))
        super().close()
serial_link.SerialLink = watchdog_process.SerialLink = Link
from groupstart.cli import main
try:
    main(sys.argv[1:])
except SystemExit as end:
    status = end.code
slow = {*ROOMS, "numba", "scipy", "toppra", LIBRARY, KERNELS}
late = sorted(name for name in closed[-1] - opened[0] if name.split(".")[0] in slow)
print("STATUS", status, "LATE", late, "COMPILED", FINDER.active, {LIBRARY, KERNELS} <= opened[0], flush=True)
"""
PROGRAM = "G21 G90 G64 P0.01 F1200\nG1 X5 Y2\nG3 X5 Y8 I0 J3\nG1 X0 Y0\nM2\n"


@pytest.mark.parametrize("switch", ["0", "1"], ids=["sources", "compiled"])
def test_nothing_is_imported_once_the_port_is_open(device: str, tmp_path: Path, switch: str) -> None:
    (tmp_path / "job.nc").write_text(PROGRAM)
    arguments = ["run", str(tmp_path / "job.nc"), "--port", device, "--runs", str(tmp_path / "runs"), "--yes"]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *arguments],
        cwd=ROOT, env=os.environ | {SWITCH: switch}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    told = done.stdout.splitlines()[-1]
    if "STATUS 2" in told:
        pytest.skip("this computer is too busy for a program in real time: " + done.stderr[-200:])
    if switch == "1" and "COMPILED False" in told:
        pytest.skip("nothing is compiled from these sources")
    assert told == f"STATUS 0 LATE [] COMPILED {switch == '1'} {switch == '1'}", done.stderr
