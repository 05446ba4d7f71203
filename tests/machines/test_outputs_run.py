"""Spindle, coolant and outputs of whole runs on the twin: pins against the plan, and off after whatever happens."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gcode.canon import ORIGIN
from gcode.setup import Setup
from machines import bringup
from machines.bringup import Connection
from machines.control import Script
from machines.job import Job, plan_job, read_job
from machines.load import MachineFile, parse_machine, read_machine
from machines.outputs_hook import switches_of
from machines.runner import RunOptions, RunResult, perform
from machines.session import Session, SessionError
from machines.wiring import bus_specs
from nmc.bus import Bus
from nmc.errors import LinkTimeout
from nmc.program import Evidence
from nmc.watchdog import Phase, Ward, Watchdog, patrol
from planner.plan import Plan
from sim import servokernel
from sim.build import Simulation, build
from sim.violations import OutputChange

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "04_spindle.nc"
SHIPPED = read_machine("mill3-spindle")
SPINDLE = SHIPPED.text[SHIPPED.text.index("[spindle]") : SHIPPED.text.index("[coolant]")]
PWM = """[spindle]
drive = "pwm"
bus = "main"
address = 4
counts_per_rev = 400
max_rpm = 4000
ramp_time = 1.0
settle_time = 0.5
at_speed = 0.15
pwm_at_max = 143
"""
PINS = """[spindle]
drive = "output"
max_rpm = 4000
ramp_time = 0.5
on = { module = "io", pin = "bit4" }
reverse = { module = "io", pin = "bit5" }
speed = { module = "io", pin = "pwm2" }
"""
PROGRAM = "G21 G90 G64 P0.01\nM64 P0\nM3 S2000\nM8\nG1 X20 F1200\nM62 P1\nG1 X30\nM63 P1\nG1 X40\nM2\n"
ON = {"flood": ("Z", "out1", 1), "mist": ("Z", "out2", 0), "vacuum": ("io", "bit0", 1), "pen": ("io", "bit1", 1)}


def changed(*pairs: tuple[str, str]) -> MachineFile:
    text = SHIPPED.text
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    return MachineFile("m.toml", text, parse_machine(text, "m.toml"))


@dataclass
class Ran:
    """A run with everything that it has left."""

    result: RunResult
    simulation: Simulation
    notes: list[tuple[str, int, dict[str, Any]]] = field(default_factory=list)

    @property
    def start_ns(self) -> int:
        assert self.result.outcome is not None
        return self.result.outcome.plan_start_ns

    def changes(self, module: str, pin: str) -> list[OutputChange]:
        return [each for each in self.simulation.log.outputs if (each.module, each.pin) == (module, pin)]

    def level(self, name: str) -> bool:
        """Whether a pin is on at the end."""
        module, pin, on = ON[name]
        found = self.changes(module, pin)
        return bool(found) and found[-1].value == on

    def spindle(self) -> tuple[float, bool]:
        """Speed in rpm and whether its amplifier is on."""
        chip = self.simulation.servos()["spindle"]
        return float(chip.f[servokernel.OMEGA]) / 400 * 60, bool(chip.n[servokernel.AMP])

    def of(self, event: str) -> list[tuple[int, dict[str, Any]]]:
        return [(time_ns, fields) for name, time_ns, fields in self.notes if name == event]


def prepared(machine: MachineFile, text: str) -> tuple[Job, Plan]:
    job = read_job(text, Setup(file="job.nc", start=ORIGIN), machine.config)
    assert not job.errors, job.errors
    return job, plan_job(job, machine.config, "kernel")


def run(
    text: str = PROGRAM,
    machine: MachineFile = SHIPPED,
    profile: str = "auto",
    script: list[tuple[float, str]] | None = None,
    disturb: Callable[[Simulation, Evidence], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Ran:
    seen: list[Simulation] = []
    notes: list[tuple[str, int, dict[str, Any]]] = []

    def look(simulation: Simulation, evidence: Evidence) -> None:
        seen[:] = [simulation]
        if disturb is not None:
            disturb(simulation, evidence)

    options = RunOptions(profile=profile, disturb=look, control=Script(script) if script else None)
    result = perform(
        *prepared(machine, text),
        machine,
        options,
        note=lambda event, time_ns, **fields: notes.append((event, time_ns, fields)),
        stop_requested=stop,
    )
    return Ran(result, seen[0], notes)


def assert_good(ran: Ran, within_ms: float) -> None:
    verdict = ran.result.verdict
    assert ran.result.fault == ""
    assert verdict is not None
    assert verdict.ok, verdict.reasons
    assert ran.result.violations == ()
    assert set(verdict.end_error_steps.values()) == {0}
    assert verdict.outputs is not None
    assert verdict.outputs.off_ms_max <= within_ms


# --- against the plan -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("profile", "within_ms"), [("adaptive", 2.0), ("group", 4.0)])
def test_the_example_switches_every_pin_at_its_instant(profile: str, within_ms: float) -> None:
    ran = run(EXAMPLE.read_text(), profile=profile)
    assert_good(ran, within_ms)
    assert ran.result.verdict is not None
    assert ran.result.verdict.outputs is not None
    assert ran.result.verdict.outputs.changes == 10
    plan = ran.result.plan.trajectory
    assert ran.result.outcome is not None
    for pin, line in (("bit1", 10), ("bit1", 12)):  # the pen, in motion: where the path passes the corner
        [at_ns] = [e.time_ns for e in ran.changes("io", pin) if (line == 10) == bool(e.value)]
        [event] = [event for event in plan.events if event.command.line == line]
        time_s = (at_ns - ran.start_ns) / 1e9
        speed = np.linalg.norm(plan.v(np.array([event.time_s])))
        assert speed > 1
        assert abs(time_s - event.time_s) * 1e3 <= within_ms
    for module, pin in (("Z", "out1"), ("Z", "out2"), ("io", "bit0")):  # at rest: nothing moves as they change
        times = np.array([(each.time_ns - ran.start_ns) / 1e9 for each in ran.changes(module, pin)])
        times = times[times > 0]
        assert len(times)
        assert np.abs(plan.v(times)).max() == 0


def test_nothing_moves_before_the_spindle_is_at_speed() -> None:
    speeds: list[tuple[float, float]] = []
    places: list[tuple[int, ...]] = [()]

    def look(simulation: Simulation, evidence: Evidence) -> None:
        chip = simulation.servos()["spindle"]
        place = tuple(module.position for module in simulation.steppers().values())
        if places[-1] not in ((), place):  # a timer that runs has not stepped yet
            speeds.append((evidence.replied_ns, float(chip.f[servokernel.OMEGA]) / 400 * 60))
        places.append(place)

    ran = run("G21 G90\nM3 S3000\nG1 X5 F1200\nS1000\nG1 X0\nM4\nG1 X5\nM5\nG0 X0\nM2\n", disturb=look)
    assert ran.result.fault == ""
    times, rpm = np.array(speeds).T
    lines = ran.result.plan.trajectory.line((times - ran.start_ns) / 1e9)
    for line, wanted in ((3, 3000), (5, 1000), (7, -1000), (9, 0)):
        assert np.abs(rpm[lines == line] - wanted).max() < 0.05 * max(abs(wanted), 2000), line
    told = [fields["wanted_rpm"] for _, fields in ran.of("spindle_at_speed")]
    assert told == [3000, 1000, -1000, 0]


@pytest.mark.parametrize(("table", "others"), [(PWM, ()), (PINS, (("address = 5", "address = 4"),))])
def test_other_drives_do_the_same(table: str, others: tuple[tuple[str, str], ...]) -> None:
    machine = changed((SPINDLE, table), *others)
    ran = run(PROGRAM.replace("M62 P1", "M4 S1000\nM62 P1"), machine)
    assert_good(ran, 4.0)
    if table == PINS:
        on, reverse = ran.changes("io", "bit4"), ran.changes("io", "bit5")
        assert [each.value for each in on] == [1, 0, 1, 0]
        assert on[1].time_ns < reverse[0].time_ns < on[2].time_ns  # it stops before it turns round
        assert reverse[0].time_ns - on[1].time_ns > 0.2e9
        assert [each.value for each in ran.changes("io", "pwm2")] == [128, 0, 64, 0]
    else:
        pwm = np.array([each.value for each in ran.changes("spindle", "pwm")])
        assert np.abs(np.diff(pwm, prepend=0)).max() <= 4  # 20 ms of a ramp of 1 s to 143
        assert (pwm.max(), pwm.min(), pwm[-1]) == (72, -36, 0)
        rpm, powered = ran.spindle()
        assert (abs(rpm) < 1, powered) == (True, False)


@pytest.mark.parametrize("z", ["main", "second"])
def test_spindle_and_outputs_may_hang_on_a_bus_without_motors(z: str) -> None:
    second = '[bus.second]\nport = "sim"\n' if z == "second" else ""
    place = ('bus = "main"\naddress = 3', f'bus = "{z}"\naddress = {1 if second else 3}')
    machine = changed(
        ("\n[axis.X]", f'\n{second}[bus.third]\nport = "sim"\n\n[axis.X]'),
        place,
        ('bus = "main"\naddress = 4', 'bus = "third"\naddress = 1'),
        ('bus = "main"\naddress = 5', 'bus = "third"\naddress = 2'),
    )
    ran = run(PROGRAM.replace("G1 X20", "G1 X20 Z2"), machine)
    assert_good(ran, 3.0)
    assert ran.result.verdict is not None
    assert ran.result.verdict.outputs is not None
    assert ran.result.verdict.outputs.changes == 5
    assert [fields["wanted_rpm"] for _, fields in ran.of("spindle_at_speed")] == [2000, 0]


def test_surface_speed_follows_x() -> None:
    seen: list[tuple[int, float]] = []

    def look(simulation: Simulation, evidence: Evidence) -> None:
        chip = simulation.servos()["spindle"]
        if not seen or evidence.replied_ns - seen[-1][0] > 50_000_000:
            seen.append((evidence.replied_ns, chip.mechanical_counts))

    text = "G21 G90\nG0 X40\nG96 D2500 S120 M3\nG1 X8 F600\nG1 X40\nG97 S1000\nG1 Y5 F600\nM5\nM2\n"
    ran = run(text, disturb=look)
    assert ran.result.fault == ""
    times, counts = np.array(seen).T
    middle_s = ((times[1:] + times[:-1]) / 2 - ran.start_ns) / 1e9
    rpm = np.diff(counts) / 400 / (np.diff(times) / 1e9) * 60
    plan = ran.result.plan.trajectory
    cuts = np.isin(plan.line(middle_s), [4, 5]) & (np.abs(plan.v(middle_s)).max(axis=1) > 9)
    x = plan.q(middle_s)[cuts, 0]
    wanted = np.minimum(120e3 / (2 * np.pi * x), 2500)
    assert cuts.sum() > 80
    assert np.abs(rpm[cuts] / wanted - 1).max() < 0.08
    assert np.sqrt(np.mean((rpm[cuts] / wanted - 1) ** 2)) < 0.02
    assert wanted.max() > 2200
    assert wanted.min() < 500


def test_a_synchronised_output_waits_for_its_motion_and_without_one_never_comes() -> None:
    ran = run("G21 G90\nG1 X5 F600\nM62 P1\nG4 P0.5\nG1 X10\nM63 P1\nM2\n")
    assert_good(ran, 2.0)
    [on] = ran.changes("io", "bit1")
    plan = ran.result.plan.trajectory
    [dwell] = [event for event in plan.events if event.command.line == 4]
    assert (on.time_ns - ran.start_ns) / 1e9 == pytest.approx(dwell.time_s + 0.5, abs=2e-3)
    assert ran.level("pen")  # the program has not switched it off, and its end is no stop


def test_the_pwm_of_a_servo_that_moves_nothing_is_an_analog_output() -> None:
    lamp = (
        '\n[module.lamp]\nchip = "pic-servo"\nbus = "main"\naddress = 6\n\n[analog.1]\nmodule = "lamp"\npin = "pwm"\n'
    )
    machine = changed(
        ("\n# What the simulated machine adds", f"{lamp}least = -1\ngreatest = 1\n\n# What the simulated machine adds")
    )
    ran = run("G21 G90\nM68 E1 Q0.5\nG1 X5 F600\nM67 E1 Q1\nG1 X10\nM68 E1 Q-1\nM2\n", machine)
    assert_good(ran, 2.0)
    assert [each.value for each in ran.changes("lamp", "pwm")] == [191, 255, 0]


def test_outputs_move_with_the_times_of_a_hold() -> None:
    ran = run(PROGRAM, script=[(1.2, "hold"), (1.9, "resume"), (2.2, "feed 50")])
    assert_good(ran, 2.0)
    plan = ran.result.plan.trajectory
    on, off = ran.changes("io", "bit1")
    for change, line in ((on, 6), (off, 8)):
        [event] = [event for event in plan.events if event.command.line == line]
        assert (change.time_ns - ran.start_ns) / 1e9 == pytest.approx(event.time_s, abs=2e-3)
        x = plan.q(np.array([event.time_s]))[0][0]
        assert x == pytest.approx(20 if line == 6 else 30, abs=0.02)


# --- off after whatever happens ---------------------------------------------------------------------------------------


def after(calls: int) -> Callable[[], bool]:
    left = [calls]

    def asked() -> bool:
        left[0] -= 1
        return left[0] <= 0

    return asked


def assert_off(ran: Ran) -> None:
    assert not ran.level("flood")
    assert not ran.level("mist")
    assert not ran.level("pen")
    assert not ran.spindle()[1]


@pytest.mark.parametrize("calls", [5, 60, 150, 300, 500])
def test_a_stop_request_stops_the_motion_first_then_switches_off(calls: int) -> None:
    ran = run(PROGRAM.replace("M8", "M7\nM8"), stop=after(calls))
    assert "stopped on request" in ran.result.fault
    assert_off(ran)
    assert ran.level("vacuum") == (calls > 5)  # on_stop = "keep"
    assert ran.result.trace is not None
    ends = [ran.result.trace.pulses_ns(axis) for axis in "XYZ"]
    last_pulse_ns = max((float(pulses[-1]) for pulses in ends if len(pulses)), default=0.0)
    for module, pin in (("Z", "out1"), ("Z", "out2")):
        if len(found := ran.changes(module, pin)) > 1:
            assert found[-1].time_ns > last_pulse_ns
    assert ran.result.violations == ()


def test_a_bus_fault_switches_off_too(monkeypatch: pytest.MonkeyPatch) -> None:
    left = [400]
    inner = Bus.exchange

    def failing(self: Bus, exchange: Any, **named: Any) -> Evidence:
        left[0] -= 1
        if left[0] == 0:
            raise LinkTimeout("nobody answers", address=1)
        return inner(self, exchange, **named)

    monkeypatch.setattr(Bus, "exchange", failing)
    ran = run()
    assert "nobody answers" in ran.result.fault
    assert_off(ran)


def test_a_spindle_that_does_not_come_to_speed_is_a_fault_before_anything_moves() -> None:
    weak = changed(("supply_v = 36", "supply_v = 13"))
    ran = run("G21 G90\nM3 S4000\nG1 X5 F600\nM2\n", weak)
    assert "rpm, 4000 wanted, after the whole time that line 2 was given" in ran.result.fault
    assert_off(ran)
    assert ran.result.trace is not None
    assert len(ran.result.trace.run_count) == 0


def test_a_spindle_that_stalls_in_the_cut_stops_the_machine() -> None:
    stalled: list[int] = []

    def stall(simulation: Simulation, evidence: Evidence) -> None:
        chip = simulation.servos()["spindle"]
        if evidence.exchange.line == 7:
            stalled.append(evidence.replied_ns)
            chip.f[servokernel.COULOMB] = 1e9

    ran = run(disturb=stall)
    assert "the spindle has come to 0 rpm, 2000 wanted" in ran.result.fault
    assert_off(ran)
    [(stopped_ns, _)] = ran.of("all_stopped")
    assert stopped_ns - stalled[0] < 800_000_000  # two looks, 0.25 s apart


def test_the_end_of_a_program_stops_spindle_and_coolant_without_m5_and_m9() -> None:
    ran = run("G21 G90\nM3 S2000\nM7\nM64 P1\nG1 X5 F600\n")
    assert ran.result.fault == ""
    assert not ran.level("mist")
    rpm, powered = ran.spindle()
    assert (abs(rpm) < 100, powered) == (True, False)
    assert ran.level("pen")


# --- on ports ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def port(monkeypatch: pytest.MonkeyPatch) -> Simulation:
    """Chips that the session takes for real ones, and that outlive it."""
    simulation = build(bus_specs(SHIPPED.config), 3)

    def connect(*_args: object, **_named: object) -> Connection:
        links = list(simulation.links)
        return Connection(SHIPPED.config, links, [Bus(link) for link in links], None)

    monkeypatch.setattr(bringup, "connect", connect)
    return simulation


TOOLS = "G21 G90\nT1 M6\nM3 S2000\nM8\nG1 X5 F600\nM5\nM9\nT2 M6\nM3 S1000\nG1 X0\nM2\n"


def test_nobody_is_asked_to_start_a_spindle_that_the_machine_has_and_it_stands_at_a_tool_change(
    port: Simulation,
) -> None:
    asked: list[str] = []
    stood: list[tuple[float, int]] = []

    def ask(request: str) -> bool:
        asked.append(request)
        chip = port.servos()["spindle"]
        chip.synchronise()
        stood.append((abs(float(chip.f[servokernel.OMEGA])), port.steppers()["Z"].outputs & 1))
        return True

    result = perform(*prepared(SHIPPED, TOOLS), SHIPPED, RunOptions(ask=ask))
    assert result.fault == ""
    assert asked == ["line 2: put tool 1 into the spindle", "line 8: put tool 2 into the spindle"]
    assert all(speed < 60 and not flood for speed, flood in stood), stood
    assert result.verdict is not None
    assert result.verdict.ok, result.verdict.reasons
    assert port.violations == []


def test_whoever_says_no_at_a_wait_leaves_nothing_running(port: Simulation) -> None:
    text = "G21 G90\nM3 S2000\nM8\nG1 X5 F600\nM0\nG1 X0\nM2\n"
    result = perform(*prepared(SHIPPED, text), SHIPPED, RunOptions(ask=lambda _request: False))
    assert "not confirmed" in result.fault
    port.world.run_until(port.world.now_ns + 100_000_000)
    assert not port.steppers()["Z"].outputs & 1
    assert not port.servos()["spindle"].n[servokernel.AMP]


def test_the_next_session_takes_over_beside_a_spindle_that_is_off(port: Simulation) -> None:
    kept: list[bool] = []

    def note(event: str, _time_ns: int, **fields: bool) -> None:
        if event == "connected":
            kept.append(fields["kept_positions"])

    for _ in range(2):
        with Session(SHIPPED.config, note=note) as session:
            session.connect()
    assert kept == [False, True]


@pytest.mark.parametrize("calls", [100, 250])
def test_the_watchdog_switches_off_what_a_dead_host_leaves_on(port: Simulation, calls: int) -> None:
    """The host dies in mid-stream; the watchdog's words alone bring everything to rest."""
    left = [calls]

    class Died(BaseException):
        pass

    def die(_evidence: Evidence) -> None:
        left[0] -= 1
        if left[0] == 0:
            raise Died

    _, plan = prepared(SHIPPED, PROGRAM)
    session = Session(SHIPPED.config)
    session.connect()
    connection = session.connection
    dog = Watchdog(
        [Ward(address, "pic-step") for address in (1, 2, 3)],
        (0x81, 0x82),
        baud=115200,
        switches=switches_of(connection.rig, 0),
    )
    session.watch = die
    stopping = bringup.stop_everything
    bringup.stop_everything = lambda _connection: 0  # a dead host stops nothing
    try:
        with pytest.raises((Died, SessionError)):
            session.run(plan.trajectory)
    finally:
        bringup.stop_everything = stopping
    assert port.servos()["spindle"].n[servokernel.AMP]
    link = connection.links[0]
    dog.arm(link.now_ns())
    assert dog.due_ns is not None
    link.sleep_until(dog.due_ns)
    assert dog.check(link.now_ns())
    patrol(dog, link, rounds=20)
    assert dog.phase is Phase.STANDING
    assert not port.steppers()["Z"].outputs & 1
    assert not port.servos()["spindle"].n[servokernel.AMP]
    assert not any(module.moving for module in port.steppers().values())
