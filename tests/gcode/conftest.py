"""The tool table of the tests and, where it is installed, LinuxCNC's stand-alone interpreter as an oracle."""

import os
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from gcode.canontext import canon_lines
from gcode.interp import interpret
from gcode.setup import Setup, Tool

TOOL_TABLE = "T1 P1 Z1.5 D0.25\nT2 P2 Z2 D0.125\nT3 P3 X.1 Z.5 D0.118\nT99 P99 Z1\n"
"""In inches: that interpreter is always an inch machine."""

_COUNT = re.compile(r"^ *\d+ (?=N)")
_SEQUENCE = re.compile(r"^(N[\d.]+) *")
_NUMBER = re.compile(r"-?\d+\.\d+")


def tool(number, z=0.0, d=0.0, x=0.0):
    return Tool(number, number, (x, 0.0, z, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), d)


TOOLS = {1: tool(1, 1.5, 0.25), 2: tool(2, 2.0, 0.125), 3: tool(3, 0.5, 0.118, 0.1), 99: tool(99, 1.0)}
INCH_SETUP = Setup(machine_units="inch", tools=TOOLS, file="p.ngc")


def plain(line):
    """A canonical line without its counter and with one blank after the N column."""
    return _SEQUENCE.sub(r"\1 ", _COUNT.sub("", line)).rstrip()


def same(ours, theirs, tolerance=1.01e-4):
    """Equal up to the last printed digit of each number."""
    if ours == theirs:
        return True
    if _NUMBER.sub("#", ours) != _NUMBER.sub("#", theirs):
        return False
    pairs = zip(_NUMBER.findall(ours), _NUMBER.findall(theirs), strict=True)
    return all(abs(float(a) - float(b)) <= tolerance for a, b in pairs)


def with_line_numbers(text):
    """Every line begins with N<physical line>, so that the oracle's N column tells it."""
    lines = []
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip() or line.strip() == "%":
            lines.append(line)
            continue
        match = re.match(r"^(\s*/?\s*)([nN]\s*\d+(?:\.\d+)?)?(.*)$", line, re.DOTALL)
        lines.append(f"{match.group(1)}N{number} {match.group(3)}")
    return "\n".join(lines)


def ours(text, setup=INCH_SETUP):
    return [plain(line) for line in canon_lines(interpret(text, setup).commands)]


def run_rs274(text, folder: Path, tools=TOOL_TABLE, timeout=20):
    """The canonical text and the exit status of ``rs274`` for ``text``, N column = physical line."""
    (folder / "p.ngc").write_text(with_line_numbers(text))
    (folder / "t.tbl").write_text(tools)
    (folder / "rs274.var").write_text("")
    command = ["rs274", "-t", "t.tbl", "-v", "rs274.var", "-g", str(folder / "p.ngc")]
    result = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "HOME": str(folder)},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=timeout,
        check=False,
    )
    lines = [plain(line) for line in result.stdout.decode("utf-8", "replace").split("\n") if line.strip()]
    return SimpleNamespace(lines=lines, ok=result.returncode == 0, message=result.stderr.decode("utf-8", "replace"))


@pytest.fixture
def canon():
    """Our canonical text, and how lines compare."""
    return SimpleNamespace(ours=ours, same=same, plain=plain, setup=INCH_SETUP)


@pytest.fixture
def rs274(tmp_path):
    """Runs the oracle in a fresh folder."""
    return lambda text, **options: run_rs274(text, tmp_path, **options)
