"""Servos and mixed buses over a pseudo-terminal: commands end exact, shafts where they have come to rest."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from groupstart.api import plan
from machines.control import Control, Script
from machines.load import parse_machine, read_machine
from machines.runner import RunOptions, RunResult, perform
from machines.wiring import bus_specs
from nmc.serial_link import DescriptorLink
from sim.build import Simulation, build
from sim.virtualport import VirtualPort

pytestmark = pytest.mark.clients

PROGRAM = "G21 G90 G64 P0.01\nG0 X5 Y5 Z1\nG1 X12 Y8 Z0.5 F900\nG2 X12 Y14 I0 J3\nG1 X5 Y5\nM2\n"
Serve = Callable[[str], tuple[Simulation, str]]


@pytest.fixture
def serve_text() -> Iterator[Serve]:
    """The machine of a text behind a pseudo-terminal, in real time."""
    stop = threading.Event()
    served: list[tuple[threading.Thread, VirtualPort]] = []

    def start(text: str) -> tuple[Simulation, str]:
        simulation = build(bus_specs(parse_machine(text, "m")), 1)
        port = VirtualPort(simulation, DescriptorLink(-1, "clock"))
        thread = threading.Thread(target=port.serve, args=(stop.is_set,), daemon=True)
        thread.start()
        served.append((thread, port))
        return simulation, port.device

    yield start
    stop.set()
    for thread, port in served:
        thread.join(5)
        port.close()


def run_on(
    device: str, machine: str, profile: str = "auto", control: Control | None = None, text: str = PROGRAM
) -> RunResult:
    """Run a program; its stream must be there before its plan begins."""
    ready = plan(text, machine, solver="kernel")
    options = RunOptions(port=device, profile=profile, control=control)
    begun: list[int] = []

    def note(event: str, time_ns: int, **fields: Any) -> None:
        if event == "run_begins":
            begun.append(fields["plan_start_ns"] - time_ns)

    result = perform(ready.job, ready.plan, ready.machine, options, note=note)
    assert min(begun) > 0, "something long was done between the source and its stream"
    if "bytes came in answer" in result.fault:
        pytest.skip("this computer is too busy for a program in real time: " + result.fault)
    return result


@pytest.mark.parametrize("profile", ["auto", "smooth"])
@pytest.mark.parametrize("machine", ["mill3-servo", "mill3-mixed"])
def test_a_run_waits_until_the_shafts_stand_and_judges_commands_and_shafts_apart(
    serve_text: Serve, machine: str, profile: str
) -> None:
    _, device = serve_text(read_machine(machine).text)
    verdict = run_on(device, machine, profile).verdict
    assert verdict is not None
    assert verdict.end_error_steps == {"X": 0, "Y": 0, "Z": 0}
    assert verdict.shafts is not None
    assert set(verdict.shafts.end_counts) == ({"X", "Y"} if machine == "mill3-mixed" else {"X", "Y", "Z"})
    assert all(abs(off) <= 4 for off in verdict.shafts.end_counts.values())
    assert verdict.shafts.off_um == {}
    assert verdict.ok, verdict.reasons


def test_after_a_hold_it_ends_as_well(serve_text: Serve) -> None:
    _, device = serve_text(read_machine("mill3-mixed").text)
    verdict = run_on(device, "mill3-mixed", control=Script([(0.4, "hold"), (0.9, "resume")])).verdict
    assert verdict is not None
    assert len(verdict.holds) == 1
    assert verdict.end_error_steps == {"X": 0, "Y": 0, "Z": 0}
    assert verdict.ok, verdict.reasons


def test_a_shaft_that_cannot_reach_its_place_is_no_go(serve_text: Serve) -> None:
    text = read_machine("mill3-servo").text
    _, device = serve_text(text.replace("[sim.axis.X.plant]\n", "[sim.axis.X.plant]\nstop_high_at = 4\n"))
    verdict = run_on(device, "mill3-servo", text="G21 G90\nG1 X4.2 F600\nM2\n").verdict
    assert verdict is not None
    assert verdict.end_error_steps == {"X": 0, "Y": 0, "Z": 0}  # the command was right
    assert verdict.shafts is not None
    off = verdict.shafts.end_counts["X"]
    assert off == pytest.approx(-80, abs=4)  # 0.2 mm, 400 counts/mm
    assert verdict.reasons == (f"the shaft of X ends {off:+d} counts from its place, more than 4",)
