"""A machine with spindle and coolant on a port: a program that is killed leaves nothing on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from machines.load import read_machine
from machines.wiring import bus_specs
from nmc.serial_link import DescriptorLink
from sim import servokernel

pytestmark = pytest.mark.clients

ROOT = Path(__file__).resolve().parents[2]
MACHINE = "mill3-spindle"
PROGRAM = "G21 G90\nM3 S2000\nM8\nM64 P1\nG1 X20 F600\nG1 X0\nM2\n"
CLOCK = DescriptorLink(-1, "clock")


def wait_for(condition, timeout_ms: int) -> bool:
    deadline_ns = CLOCK.now_ns() + timeout_ms * 1_000_000
    while not condition():
        if CLOCK.now_ns() > deadline_ns:
            return False
        CLOCK.sleep_until(CLOCK.now_ns() + 5_000_000)
    return True


def begin(port: str, folder: Path) -> subprocess.Popen[str]:
    """``groupstart run`` on a port."""
    (folder / "job.nc").write_text(PROGRAM)
    command = [sys.executable, "-m", "groupstart", "run", "job.nc", "-m", MACHINE, "--port", port, "--yes"]
    place = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, cwd=folder, env=place, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def host(serve, tmp_path: Path):
    """A program on the port of virtual chips: (simulation, process)."""
    simulation, port = serve(*bus_specs(read_machine(MACHINE).config)[0].modules, unpaced=False)
    child = begin(port, tmp_path)
    yield simulation, child
    child.kill()
    child.communicate()


def is_on(simulation) -> bool:
    return bool(simulation.modules["Z"].outputs & 1 and simulation.modules["io"].outputs & 2)


def is_off(simulation) -> bool:
    chips = simulation.modules
    return not (chips["Z"].outputs & 1 or chips["io"].outputs & 2 or chips["spindle"].n[servokernel.AMP])


def test_a_killed_program_leaves_spindle_and_outputs_off(host) -> None:
    simulation, child = host
    assert wait_for(lambda: is_on(simulation) and simulation.modules["X"].moving, 60_000)
    assert simulation.modules["spindle"].n[servokernel.AMP]
    child.kill()
    assert wait_for(lambda: is_off(simulation), 3000)
    assert not any(simulation.modules[axis].moving for axis in "XYZ")
