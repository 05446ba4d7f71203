"""A virtual bus on a pseudo-terminal, and the command that serves a whole machine there.

These tests run against the wall clock because the clients do; they have their own command: pytest -m clients.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from nmc.serial_link import DescriptorLink
from sim.build import Simulation, build
from sim.spec import BusSpec, Module
from sim.virtualport import VirtualPort

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def device() -> Iterator[str]:
    """The terminal of a machine in real time."""
    command = [sys.executable, "-m", "groupstart", "sim", "--pty", "-m", "mill3-step"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as served:
        assert served.stdout is not None
        yield served.stdout.readline().strip()
        served.terminate()


@pytest.fixture
def serve() -> Iterator[Callable[..., tuple[Simulation, str]]]:
    """Serve these modules in a thread: (simulation, device path). Look at the simulation after ``stop`` only."""
    stop = threading.Event()
    threads: list[threading.Thread] = []
    ports: list[VirtualPort] = []

    def start(*modules: Module, unpaced: bool = True) -> tuple[Simulation, str]:
        simulation = build([BusSpec("bus", modules)], 1)
        port = VirtualPort(simulation, DescriptorLink(-1, "clock"), unpaced=unpaced)
        thread = threading.Thread(target=port.serve, args=(stop.is_set,), daemon=True)
        thread.start()
        threads.append(thread)
        ports.append(port)
        return simulation, port.device

    yield start
    stop.set()
    for thread in threads:
        thread.join(5)
    for port in ports:
        port.close()


@pytest.fixture
def serve_machine() -> Iterator[Callable[[str], str]]:
    """``groupstart sim --pty`` for a machine: the device path it prints. It must end well on SIGTERM."""
    running: list[subprocess.Popen[str]] = []

    def start(machine: str) -> str:
        command = [sys.executable, "-m", "groupstart", "sim", "-m", machine, "--pty", "--unpaced"]
        child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        running.append(child)
        assert child.stdout is not None
        return child.stdout.readline().strip()

    yield start
    for child in running:
        child.terminate()
        _, errors = child.communicate(timeout=20)
        assert child.returncode == 0, errors
