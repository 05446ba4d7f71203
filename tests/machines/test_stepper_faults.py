"""What a PIC-STEP protects its motor from in a run is told: which motor; limit switch, emergency stop or supply."""

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from altered import machine_of

from gcode.canon import ORIGIN
from gcode.setup import Setup
from machines.job import plan_job, read_job
from machines.load import MachineFile
from machines.runner import RunOptions, RunResult, perform
from machines.session import Session, SessionError
from machines.troubles import ESTOP, LIMIT1, LIMIT2, SUPPLY, Trouble, servo_troubles, stepper_troubles
from nmc.program import Evidence
from sim.build import Simulation
from sim.faults import Dead, Fault, Inputs, Noise, schedule

PROGRAM = "G21 G90 G64 P0.01\nG0 X5 Y5 Z1\nF900\nG1 X15 Y8 Z0.5\nG2 X15 Y18 I0 J5\nG1 X6 Y9 Z1\nM2\n"
AT_NS = 2_000_000_000
LIMIT = "its limit switch LIMIT1 (forward) is on: move it off the switch, then home again ("


def ran(machine: MachineFile, *faults: Fault, profile: str = "auto", seed: int = 1, text: str = PROGRAM) -> RunResult:
    job = read_job(text, Setup(file="job.nc", start=ORIGIN), machine.config)
    assert not job.errors
    told: list[Simulation] = []

    def disturb(simulation: Simulation, _evidence: Evidence) -> None:
        if not told:
            told.append(simulation)
            schedule(simulation, faults)

    options = RunOptions(seed=seed, profile=profile, disturb=disturb)
    return perform(job, plan_job(job, machine.config, "kernel"), machine, options)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("profile", ["adaptive", "group", "exact"])
def test_a_limit_switch_is_named(profile: str, seed: int, tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "mill3-step", ("limit1_at = 118", "limit1_at = 10"))
    result = ran(machine, profile=profile, seed=seed)
    assert result.fault.startswith(f"line 4: motor X: {LIMIT}")
    assert "every motor stands, at X10.000 " in result.fault
    assert result.verdict is None


@pytest.mark.parametrize("profile", ["adaptive", "group", "exact"])
def test_an_emergency_stop_is_told_for_every_motor_that_it_is_wired_to(profile: str, tmp_path: Path) -> None:
    pressed = [Inputs(name, AT_NS, {"estop": True}) for name in ("X", "Y", "Z")]
    result = ran(machine_of(tmp_path, "mill3-step"), *pressed, profile=profile)
    place, told = result.fault.split(": ", 1)
    assert place in ("line 4", "line 5")
    first, rest = told.split(": ", 1)
    assert sorted(first.removeprefix("motors ").split(", ")) == ["X", "Y", "Z"]
    assert rest.startswith("its emergency stop input is on: release it, then home again (")


def test_a_lost_supply_names_the_motor(tmp_path: Path) -> None:
    result = ran(machine_of(tmp_path, "mill3-step"), Inputs("Y", AT_NS, {"power": False}))
    found = "motor Y: its supply is off: switch it on, then home again (module 2: "
    assert result.fault.split(": ", 1)[1].startswith(found)


def test_a_lost_supply_on_one_of_two_buses_names_the_motor_there(tmp_path: Path) -> None:
    result = ran(machine_of(tmp_path, "gantry4-twobus"), Inputs("Y2", AT_NS, {"power": False}))
    assert "motor Y2: its supply is off: switch it on, then home again (bus right, module " in result.fault


def test_a_limit_of_another_motor_is_told_behind_the_fault(tmp_path: Path) -> None:
    """A bus that falls silent is what stops the machine; that Z is on its switch is told, but not as the reason."""
    on_switch = Inputs("Z", AT_NS - 1_500_000_000, {"limit2": True})
    silent = Noise(lose=1.0, from_ns=AT_NS, until_ns=AT_NS + 30_000_000, command=False)
    flat = "G21 G90 G64 P0.01\nF900\nG1 X5 Y5\nG1 X15 Y8\nG1 X15 Y18\nG1 X6 Y9\nM2\n"
    result = ran(machine_of(tmp_path, "mill3-step"), on_switch, silent, text=flat)
    where, told = result.fault.split(": ", 1)
    assert where in ("line 4", "line 5")
    assert re.match(r"motor [XY]: module [12]: 0 of \d bytes came", told)
    assert "; motor Z: its limit switch LIMIT2 (reverse) is on: move it off" in told


def test_a_module_that_died_is_named(tmp_path: Path) -> None:
    result = ran(machine_of(tmp_path, "mill3-step"), Dead("Y", AT_NS))
    assert re.match(r"line [45]: motor Y: module 2: \d of \d bytes came", result.fault)
    assert "MOTORS MAY STILL BE MOVING" in result.fault


def test_an_emergency_stop_that_the_chip_does_not_heed_is_not_told(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "mill3-step", ("running_current = 160", "running_current = 160\nestop = false"))
    result = ran(machine, Inputs("X", AT_NS, {"estop": True}), Inputs("Y", AT_NS, {"power": False}))
    assert "emergency stop" not in result.fault
    assert "motor Y: its supply is off" in result.fault


def test_outputs_of_a_module_without_supply_are_switched_off_and_the_fault_is_told(tmp_path: Path) -> None:
    """Coolant hangs on the PIC-STEP of Z: that it has lost its supply must not look like a stop that failed."""
    text = "G21 G90\nM8\nF900\nG1 X15 Y8 Z0.5\nG1 X1 Y1 Z0\nM9\nM2\n"
    result = ran(machine_of(tmp_path, "mill3-spindle"), Inputs("Z", AT_NS, {"power": False}), text=text)
    assert "motor Z: its supply is off" in result.fault
    assert "every motor stands, at" in result.fault
    assert "MAY STILL" not in result.fault


def test_a_limit_switch_met_while_homing_is_named(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "mill3-step", ("limit2_at = -8", "limit2_at = -3"))
    words = r"^homing X: motor X: its limit switch LIMIT2 \(reverse\) is on"
    with Session(machine.config, seed=1) as session:
        session.connect()
        with pytest.raises(SessionError, match=words):
            session.home(["X"])


@pytest.mark.parametrize(
    ("status", "inputs", "estop", "limits", "found"),
    [
        (0x0C, 0x00, True, True, []),
        (0x0C, 0x01, True, True, [ESTOP]),
        (0x0C, 0x01, False, True, []),
        (0x0C, 0x08, True, True, [LIMIT1]),
        (0x0C, 0x10, True, True, [LIMIT2]),
        (0x0C, 0x18, True, False, []),
        (0x04, 0x01, True, True, [ESTOP, SUPPLY]),
        (0x0C, 0xE6, True, True, []),
    ],
)
def test_bits_of_a_stepper(status: int, inputs: int, estop: bool, limits: bool, found: list[Trouble]) -> None:
    """PIC-STEP sections 4.5 and 5.2."""
    assert stepper_troubles(status, inputs, estop=estop, limits=limits) == found


@pytest.mark.parametrize(
    ("status", "what"),
    [(0x09, None), (0x6D, None), (0x19, "position error"), (0x11, "supply"), (0x01, "supply")],
)
def test_bits_of_a_servo(status: int, what: str | None) -> None:
    """PIC-SERVO sections 4.5 and 5.3: without supply position error is set as well; overcurrent is no trip."""
    found = servo_troubles(status)
    assert [what in trouble.what for trouble in found if what] == ([True] if what else [])
    assert len(found) == (what is not None)
