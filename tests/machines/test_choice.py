"""Which profile ``auto`` takes for servos, what is refused, and what is told."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from supervised import Supervised

from gcode.canon import ORIGIN
from gcode.setup import Setup
from machines import bringup
from machines.bringup import Connection
from machines.choice import choose
from machines.job import plan_job, read_job
from machines.load import MachineFile, parse_machine, read_machine
from machines.profiles import choose_profile
from machines.runner import RunOptions, RunResult, perform
from machines.wiring import bus_specs
from nmc.bus import Bus
from nmc.link import Link
from nmc.recording_link import RecordingLink
from nmc.watchdog import Watchdog
from sim.build import build

PROGRAM = "G21 G90\nG1 X2 Y1 Z0.5 F300\nG0 X0 Y0 Z0\nM2\n"
Ran = Callable[..., tuple[RunResult, list[str], list[dict[str, object]]]]


def changed(name: str, *pairs: tuple[str, str]) -> MachineFile:
    text = read_machine(name).text
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new)
    return MachineFile(name, text, parse_machine(text, name))


def bus_key(line: str) -> tuple[str, str]:
    return "[bus.main]", f"[bus.main]\n{line}"


def jitter(ms: float) -> tuple[str, str]:
    return "host_jitter_ms = 0.2", f"host_jitter_ms = {ms}"


@pytest.fixture
def on_port(monkeypatch: pytest.MonkeyPatch) -> Ran:
    """Run on a port that is simulated: the session knows of no twin."""

    def run(machine: MachineFile, profile: str = "auto") -> tuple[RunResult, list[str], list[dict[str, object]]]:
        simulation = build(bus_specs(machine.config), 3)
        guarded = machine.config.bus["main"].watchdog_ms > 0
        inner = Supervised(simulation.links[0], Watchdog([], (), baud=115_200)) if guarded else simulation.links[0]
        recorded: list[Link] = [RecordingLink(inner)]
        connection = Connection(machine.config, recorded, [Bus(recorded[0])], None)
        monkeypatch.setattr(bringup, "connect", lambda *_args, **_named: connection)
        job = read_job(PROGRAM, Setup(file="job.nc", start=ORIGIN), machine.config)
        told: list[str] = []
        notes: list[dict[str, object]] = []
        result = perform(
            job,
            plan_job(job, machine.config, "kernel"),
            machine,
            RunOptions(profile=profile, tell=told.append),
            note=lambda event, _time_ns, **fields: notes.append({"event": event, **fields}),
        )
        return result, told, notes

    return run


def used(result: RunResult) -> str:
    assert result.verdict is not None, result.fault
    return result.verdict.profiles["main"]


@pytest.mark.parametrize("name", ["mill3-servo", "mill3-mixed"])
def test_a_quiet_host_on_a_port_gets_smooth(on_port: Ran, name: str) -> None:
    result, told, notes = on_port(read_machine(name))
    assert used(result) == "smooth"
    [words] = told
    assert words.startswith("profile smooth: the host was up to 0.")
    [note] = [each for each in notes if each["event"] == "profile_chosen"]
    assert note["message"] == words
    assert result.verdict is not None
    assert result.verdict.profile_notes == (words,)
    fed = [each["profile"] for each in notes if each["event"] == "profile"]
    assert fed == ["smooth"]


def test_a_hesitating_host_on_a_port_gets_stop_here(on_port: Ran) -> None:
    result, told, _ = on_port(changed("mill3-servo", jitter(4)))
    assert used(result) == "stop-here"
    [words] = told
    assert "profile stop-here: the host was up to 3." in words
    assert "smooth wants 2 ms" in words


def test_nothing_is_measured_where_the_file_says_that_the_host_is_slow(on_port: Ran) -> None:
    result, told, _ = on_port(changed("mill3-servo", bus_key("host_jitter_ms = 6")))
    assert used(result) == "stop-here"
    assert told == ["profile stop-here: host_jitter_ms of bus main is 6 ms, smooth wants 2 ms"]


def test_without_a_watchdog_auto_takes_stop_here(on_port: Ran) -> None:
    result, told, _ = on_port(changed("mill3-servo", bus_key("watchdog_ms = 0")))
    assert used(result) == "stop-here"
    assert told == ["profile stop-here: bus main has no watchdog (watchdog_ms = 0), which smooth needs"]


def test_without_a_watchdog_smooth_is_refused_on_a_port(on_port: Ran) -> None:
    machine = changed("mill3-servo", bus_key("watchdog_ms = 0"))
    result, _, notes = on_port(machine, "smooth")
    assert "smooth needs a watchdog" in result.fault
    assert "watchdog_ms of [bus.main] is 0" in result.fault
    assert not [each for each in notes if each["event"] == "run_begins"]
    assert choose_profile(machine.config, "smooth", simulated=True) == "smooth"


@pytest.mark.parametrize("profile", ["smooth", "stop-here"])
def test_a_profile_given_by_hand_is_taken(on_port: Ran, profile: str) -> None:
    result, told, _ = on_port(changed("mill3-servo", jitter(4)), profile)
    assert used(result) == profile
    assert [words for words in told if words.startswith("profile")] == []


@pytest.mark.parametrize(("ms", "wanted"), [(0.2, "smooth"), (2, "smooth"), (20, "stop-here")])
def test_the_twin_takes_smooth_as_far_as_its_jitter_allows(ms: float, wanted: str) -> None:
    config = changed("mill3-servo", jitter(ms)).config

    def never() -> int:
        raise AssertionError("the twin is not measured")

    chosen = choose(config, "auto", True, never)
    assert chosen.profile == wanted
    assert bool(chosen.notes) == (wanted == "stop-here")


@pytest.mark.parametrize("profile", ["exact", "group", "adaptive"])
def test_what_steppers_beside_servos_get_is_told(on_port: Ran, profile: str) -> None:
    result, told, _ = on_port(read_machine("mill3-mixed"), profile)
    assert used(result) == "stop-here"
    words = f"profile {profile}: on bus main servos (X, Y) get stop-here, and steppers beside them (Z) are led as in"
    assert [each.startswith(words) for each in told] == [True]


@pytest.mark.parametrize("profile", ["auto", "exact", "smooth"])
def test_a_stepper_whose_counts_act_at_once_is_refused_beside_servos(on_port: Ran, profile: str) -> None:
    machine = changed("mill3-mixed", ("[axis.Z]\n", '[axis.Z]\ncount_latch = "immediate"\n'))
    result, _, notes = on_port(machine, profile)
    assert 'axis Z on bus main: count_latch = "immediate" ([axis.Z])' in result.fault
    assert "bus of its own" in result.fault
    assert not [each for each in notes if each["event"] == "run_begins"]
    assert choose_profile(machine.config, "auto", simulated=True) == "smooth"
    twin = changed("mill3-mixed", ('count_latch = "rollover"', 'count_latch = "immediate"')).config
    with pytest.raises(ValueError, match=r"\[sim\]"):
        choose_profile(twin, profile, simulated=True)
