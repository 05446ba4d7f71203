"""A PIC-SERVO that switches itself off, or loses its supply, stops the machine; the fault names motor and line."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from altered import machine_of

from gcode.canon import ORIGIN
from gcode.setup import Setup
from machines.commission import Asker, at_work
from machines.control import Script
from machines.job import Job, plan_job, read_job
from machines.load import MachineFile
from machines.runner import RunOptions, RunResult, perform
from machines.schema import MachineConfig
from machines.servobench import ServoBench
from machines.session import Session, SessionError, State
from nmc.chips import picservo
from nmc.picservo import Gains, PicServo
from nmc.program import Evidence
from planner.plan import Plan
from sim.build import Simulation
from sim.faults import Fault, Supply, schedule
from sim.trace import Trace

PROGRAM = """G21 G90 G64 P0.01
G0 X5 Y5 Z1
F900
G1 X15 Y8 Z0.5
G2 X15 Y18 I0 J5
G1 X6 Y9 Z1
G0 X5 Y5
M2
"""
TRIPPED = r"position error, its servo has switched itself off: look what blocks or pushes it, then home again"
PROFILES = ("smooth", "stop-here")
TOLD_WITHIN_NS = 60_000_000
"""From the trip of a chip to the fault: its next word, and on a bus of four axes not much more."""
X2 = """
[motor.X2]
axis = "X"
chip = "pic-servo"
bus = "main"
address = 4
counts_per_unit = 400

[motor.X2.servo]
kp = 220
kd = 2640
ki = 150
integration_limit = 4000
position_error_limit = 300

"""


@dataclass
class Ran:
    """A run with its journal and its twin."""

    result: RunResult
    notes: list[tuple[str, int, dict[str, Any]]]
    twin: list[Simulation] = field(default_factory=list)

    def first(self, event: str) -> int:
        return next(time_ns for name, time_ns, _ in self.notes if name == event)

    @property
    def simulation(self) -> Simulation:
        return self.twin[0]

    def tripped_ns(self, motor: str) -> int:
        """When the chip switched its servo off for the first time in the run."""
        begins_ns = self.first("run_begins")
        said = [each for each in self.simulation.log.incidents if each.what.startswith("servo disabled")]
        return next(each.time_ns for each in said if each.module == motor and each.time_ns > begins_ns)


def blocked(tmp_path: Path, name: str = "mill3-servo", *changes: tuple[str, str]) -> MachineFile:
    """X has an end stop at 12, and its servo gives up 0.75 mm from its command."""
    limit = ("position_error_limit = 2000", "position_error_limit = 300")
    return machine_of(tmp_path, name, limit, ("[sim.axis.X.plant]", "[sim.axis.X.plant]\nstop_high_at = 12"), *changes)


def prepared(machine: MachineFile, text: str = PROGRAM) -> tuple[Job, Plan]:
    job = read_job(text, Setup(file="job.nc", start=ORIGIN), machine.config)
    assert not job.errors
    return job, plan_job(job, machine.config, "kernel")


def ran(
    machine: MachineFile,
    *,
    profile: str = "auto",
    seed: int = 1,
    faults: Sequence[Fault] = (),
    text: str = PROGRAM,
    control: Script | None = None,
) -> Ran:
    job, plan = prepared(machine, text)
    notes: list[tuple[str, int, dict[str, Any]]] = []
    twin: list[Simulation] = []

    def disturb(simulation: Simulation, _evidence: Evidence) -> None:
        if not twin:
            twin.append(simulation)
            schedule(simulation, faults)

    result = perform(
        job,
        plan,
        machine,
        RunOptions(seed=seed, profile=profile, disturb=disturb, control=control),
        note=lambda event, time_ns, **fields: notes.append((event, time_ns, fields)),
    )
    return Ran(result, notes, twin)


def counts(simulation: Simulation) -> dict[str, int]:
    simulation.trace()
    return {name: int(servo.position) for name, servo in simulation.servos().items()}


def all_stand(simulation: Simulation, but: str = "") -> bool:
    """Nothing moves any more once what the integral terms hold has gone; a shaft that stands may swing by a count.

    but: a motor without supply, which its load pulls.
    """
    simulation.world.run_until(simulation.world.now_ns + 1_500_000_000)
    before = counts(simulation)
    steps = {name: module.position for name, module in simulation.steppers().items()}
    simulation.world.run_until(simulation.world.now_ns + 1_000_000_000)
    still = all(abs(now - before[name]) <= 1 for name, now in counts(simulation).items() if name != but)
    return still and steps == {name: module.position for name, module in simulation.steppers().items()}


def pins(trace: Trace, name: str) -> int:
    """Where the pulses of a stepper ended."""
    axis = trace.axes.index(name)
    mine = trace.run_axis == axis
    return int(trace.start_steps[axis] + (trace.run_dir[mine].astype(np.int64) * trace.run_count[mine]).sum())


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("profile", PROFILES)
def test_a_servo_that_trips_stops_every_motor(profile: str, seed: int, tmp_path: Path) -> None:
    run = ran(blocked(tmp_path), profile=profile, seed=seed)
    assert run.result.fault.startswith(f"line 4: motor X: {TRIPPED} (module 1: position_error is set); every motor")
    assert run.result.verdict is None
    assert 0 < run.first("fault") - run.tripped_ns("X") < TOLD_WITHIN_NS
    assert all_stand(run.simulation)


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("motor", ["X", "Y"])
def test_a_servo_that_loses_its_supply_stops_every_motor(motor: str, profile: str, tmp_path: Path) -> None:
    lost_ns = 2_300_000_000
    run = ran(machine_of(tmp_path, "mill3-servo"), profile=profile, faults=[Supply(motor, lost_ns, 0.0)])
    found = f"motor {motor}: its supply is off: switch it on, then home again ("
    assert run.result.fault.split(": ", 1)[1].startswith(found)
    assert run.result.fault.startswith("line ")
    assert 0 < run.first("fault") - lost_ns < TOLD_WITHIN_NS
    assert all_stand(run.simulation)


@pytest.mark.parametrize("profile", PROFILES)
def test_one_side_of_a_gantry_that_trips_stops_the_other(profile: str, tmp_path: Path) -> None:
    machine = machine_of(
        tmp_path,
        "mill3-servo",
        ("position_error_limit = 2000", "position_error_limit = 300"),
        ("[axis.Y]", f"{X2.strip()}\n\n[axis.Y]"),
        (
            "[sim.axis.X.plant]",
            "[sim.axis.X2.plant]\nlead_mm = 5\nload_mass_kg = 5\nstop_high_at = 12\n\n[sim.axis.X.plant]",
        ),
    )
    run = ran(machine, profile=profile)
    assert run.result.fault.startswith(f"line 4: motor X2: {TRIPPED} (module 4: position_error is set)")
    assert all_stand(run.simulation)
    ends = counts(run.simulation)
    assert abs(ends["X2"] - 4800) <= 1
    tripped_at = 4800 + 300
    speed = 15.0 * 400  # mm/s in counts a second
    assert ends["X"] < tripped_at + speed * TOLD_WITHIN_NS / 1e9


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("buses", [1, 2])
def test_a_servo_that_trips_stops_a_stepper_too(buses: int, profile: str, tmp_path: Path) -> None:
    second: list[tuple[str, str]] = []
    if buses == 2:
        second = [
            ("[axis.X]", '[bus.side]\nport = "sim"\nbaud = 115200\n\n[axis.X]'),
            ('chip = "pic-step"\nbus = "main"\naddress = 3', 'chip = "pic-step"\nbus = "side"\naddress = 1'),
        ]
    run = ran(blocked(tmp_path, "mill3-mixed", *second), profile=profile)
    assert run.result.fault.startswith(f"line 4: motor X: {TRIPPED}")
    assert run.result.trace is not None
    [told] = [fields["positions"] for event, _, fields in run.notes if event == "all_stopped"]
    assert told["Z"] != 0
    assert told["Z"] == pins(run.result.trace, "Z")
    assert all_stand(run.simulation)
    assert run.simulation.steppers()["Z"].position == told["Z"]


LONG = "G21 G90\nF600\nG1 X15 Y8\nG1 X1 Y1\nM2\n"
DWELL = "G21 G90\nF900\nG1 X5 Y5 Z1\nG4 P4\nG1 X1 Y1\nM2\n"
NOTICED_WITHIN_NS = 650_000_000
"""A servo that rests is asked after half a second of silence at the latest."""


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("name", ["mill3-servo", "mill3-mixed"])
def test_a_servo_that_rests_is_asked_while_others_move(name: str, profile: str, tmp_path: Path) -> None:
    lost_ns = 2_000_000_000
    motor = "Z" if name == "mill3-servo" else "Y"
    text = LONG if motor == "Z" else "G21 G90\nF600\nG1 X25 Z-5\nG1 X1 Z0\nM2\n"
    run = ran(machine_of(tmp_path, name), profile=profile, faults=[Supply(motor, lost_ns, 0.0)], text=text)
    assert run.result.fault.startswith(f"line 3: motor {motor}: its supply is off")
    assert 0 < run.first("fault") - lost_ns < NOTICED_WITHIN_NS
    assert all_stand(run.simulation, but=motor)


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize(("name", "motor"), [("mill3-servo", "X"), ("mill3-servo", "Z"), ("mill3-mixed", "Y")])
def test_in_a_dwell_every_servo_is_asked(name: str, motor: str, profile: str, tmp_path: Path) -> None:
    lost_ns = 3_000_000_000
    run = ran(machine_of(tmp_path, name), profile=profile, faults=[Supply(motor, lost_ns, 0.0)], text=DWELL)
    assert f": motor {motor}: its supply is off" in run.result.fault
    assert 0 < run.first("fault") - lost_ns < NOTICED_WITHIN_NS


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("motor", ["X", "Y", "Z"])
def test_in_a_hold_every_servo_is_asked(motor: str, profile: str, tmp_path: Path) -> None:
    lost_ns = 3_000_000_000
    held = Script([(1.0, "hold"), (6.0, "resume")])
    faults = [Supply(motor, lost_ns, 0.0)]
    run = ran(machine_of(tmp_path, "mill3-servo"), profile=profile, faults=faults, control=held)
    assert f": motor {motor}: its supply is off" in run.result.fault
    assert 0 < run.first("fault") - lost_ns < NOTICED_WITHIN_NS


def test_a_servo_that_rests_is_noticed_at_the_end_at_the_latest(tmp_path: Path) -> None:
    run = ran(machine_of(tmp_path, "mill3-servo"), faults=[Supply("Z", 2_000_000_000, 0.0)], text=LONG)
    assert "motor Z: its supply is off" in run.result.fault
    assert run.result.fault.startswith("line ")
    assert run.result.verdict is None


def test_a_servo_that_has_lost_its_supply_since_does_not_set_out(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "mill3-servo")
    _, plan = prepared(machine)
    with Session(machine.config, seed=1) as session:
        session.connect()
        assert session.simulation is not None
        session.simulation.servos()["Y"].set_supply(0.0)
        link = session.connection.links[0]
        link.sleep_until(link.now_ns() + 10_000_000)
        before = counts(session.simulation)
        with pytest.raises(SessionError, match=r"^motor Y: its supply is off"):
            session.run(plan.trajectory)
        assert session.state is State.FAULTED
        assert all(abs(now - before[name]) <= 1 for name, now in counts(session.simulation).items())


def test_a_servo_that_trips_at_start_up_is_named(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "mill3-servo", ("position_error_limit = 2000", "position_error_limit = 20"))
    with Session(machine.config, seed=1) as session:
        with pytest.raises(SessionError, match=rf"^the machine does not start: motor Z: {TRIPPED}"):
            session.connect()
        assert session.state is State.FAULTED


def test_a_servo_that_trips_while_it_is_waited_for_is_named(tmp_path: Path) -> None:
    """The sag comes slowly: the servo is ready when it is asked, and trips in the wait for its shaft to stand."""
    pull = ("load_nm = -0.016", "load_nm = -0.016\ninertia_kgm2 = 0.02")
    machine = machine_of(tmp_path, "mill3-servo", ("position_error_limit = 2000", "position_error_limit = 20"), pull)
    words = rf"motor Z: {TRIPPED} \(module 3: position_error is set\)"
    with Session(machine.config, seed=1) as session, pytest.raises(SessionError, match=words):
        session.connect()


def test_a_shaft_that_does_not_come_to_rest_is_a_fault_of_the_start(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "mill3-servo", ("kp = 220\nkd = 2640", "kp = 2000\nkd = 0"))
    words = r"motor [XYZ]: module \d: its shaft does not come to rest within 3 s"
    with Session(machine.config, seed=1) as session, pytest.raises(SessionError, match=words):
        session.connect()


def test_a_servo_that_trips_while_it_looks_for_home_is_named(tmp_path: Path) -> None:
    machine = machine_of(
        tmp_path,
        "mill3-servo",
        ("position_error_limit = 2000", "position_error_limit = 300"),
        ("[sim.axis.X.plant]", "[sim.axis.X.plant]\nstop_low_at = -4"),
    )
    with Session(machine.config, seed=1) as session:
        session.connect()
        with pytest.raises(SessionError, match=rf"^homing X: motor X: {TRIPPED}"):
            session.home(["X"])
        assert session.state is State.FAULTED
        assert session.simulation is not None
        assert all_stand(session.simulation)


def test_a_servo_in_current_limit_is_no_fault(tmp_path: Path) -> None:
    with Session(machine_of(tmp_path, "mill3-servo").config, seed=1) as session:
        session.connect()
        tracker = session.connection.buses[0].guard.modules[1]
        good = picservo.STATUS_POWER_ON | picservo.STATUS_MOVE_DONE
        switches = picservo.STATUS_OVERCURRENT | picservo.STATUS_LIMIT1 | picservo.STATUS_LIMIT2
        assert tracker.judge(good | switches | picservo.STATUS_HOMING) is None
        assert tracker.judge(good | picservo.STATUS_POSITION_ERROR) is not None
        assert tracker.judge(good & ~picservo.STATUS_POWER_ON) is not None


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("name", ["mill3-servo", "mill3-mixed"])
def test_a_good_run_raises_no_alarm(name: str, profile: str, tmp_path: Path) -> None:
    run = ran(machine_of(tmp_path, name), profile=profile)
    assert run.result.fault == ""
    assert run.result.verdict is not None
    assert run.result.outcome is not None
    assert run.result.outcome.finished
    assert [fields["state"] for event, _, fields in run.notes if event == "state"] == ["running", "idle"]


def lose_supply_at_work(config: MachineConfig) -> None:
    with at_work(config) as connection:
        assert connection.simulation is not None
        connection.simulation.servos()["Y"].set_supply(0.0)
        PicServo(connection.buses[0], 2).poll(50_000_000)


def test_a_servo_that_trips_beside_a_measurement_is_named(tmp_path: Path) -> None:
    config = machine_of(tmp_path, "mill3-servo").config
    with pytest.raises(SessionError, match=r"^motor Y: its supply is off") as caught:
        lose_supply_at_work(config)
    assert caught.value.positions is not None


def test_on_the_bench_a_trip_is_a_finding(tmp_path: Path) -> None:
    """Gains that trip the axis end the trial; the axis is then held again by its own and brought back."""
    config = machine_of(tmp_path, "mill3-servo").config
    safe = Gains(220, 2640, 150, 4000, position_error_limit=2000)
    with at_work(config) as connection:
        bench = ServoBench(PicServo(connection.buses[0], 1), safe, 400, Asker(connection.buses[0]))
        response = bench.step(replace(safe, position_error_limit=5), 100, 60)
        assert not response.whole
        assert abs(bench.chip.position() - bench.home) <= 4
