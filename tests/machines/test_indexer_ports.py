"""The whole of it in real time: a virtual machine on two terminals, and a run on these ports as on metal."""

import subprocess
import sys
from pathlib import Path

import pytest

from machines.load import read_machine

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = "G21 G90 G64 P0.01\nG0 X3 Y2\nG0 A30\nG1 X6 F600\nG0 A-15\nG0 X0 Y0\nM2\n"


def on_ports(main: str, line: str) -> str:
    """The shipped machine on two ports; a terminal has no modem lines, so nothing is wired to them."""
    text = read_machine("mill3-indexer").text
    home = text[text.index("[axis.A.home]") : text.index("# What the simulated machine adds")]
    for old, new in (
        ('[bus.main]\nport = "sim"', f'[bus.main]\nport = "{main}"'),
        ('[bus.indexer]\nport = "sim"', f'[bus.indexer]\nport = "{line}"'),
        ('abort_line = "rts" ', 'abort_line = "none" '),
        (home, ""),
    ):
        assert old in text
        text = text.replace(old, new)
    return text


@pytest.mark.slow
def test_a_run_on_two_ports_ends_on_every_step(tmp_path: Path) -> None:
    groupstart = [sys.executable, "-m", "groupstart"]
    serving = subprocess.Popen(
        [*groupstart, "sim", "-m", "mill3-indexer", "--pty"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert serving.stdout is not None
        main, line = serving.stdout.readline().strip(), serving.stdout.readline().strip()
        (tmp_path / "ports.toml").write_text(on_ports(main, line))
        (tmp_path / "job.nc").write_text(PROGRAM)
        places = [str(tmp_path / "job.nc"), "-m", str(tmp_path / "ports.toml"), "--runs", str(tmp_path / "runs")]
        run = [*groupstart, "run", *places]
        done = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert "X 0  Y 0  Z 0  A 0 steps" in done.stdout
    finally:
        serving.terminate()
        _, said = serving.communicate()
    assert "0 violations" in said
