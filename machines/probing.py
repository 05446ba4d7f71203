"""``probe-latch`` of whole axes: each module in the slowest speed mode, probed, put back; what is written about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from machines.bringup import Connection, bus_of, set_step_parameters
from machines.commission import Asker, StopRequested
from machines.latchprobe import STEPS_MOST, LatchFinding, LatchProbe
from machines.schema import MachineConfig
from machines.silences import STEPS_MOST as RUN_AWAY_STEPS
from machines.silences import Answer, Silences
from machines.toml_lines import KeyPath
from machines.tomledit import Value, set_values
from machines.wiring import bus_timing, motor_tables, nmc_buses, speed_mode
from nmc.picstep import PicStep


@dataclass(frozen=True, slots=True)
class Probed:
    """What was found out about the module of one motor."""

    motor: str
    version: int
    latch: LatchFinding
    answers: tuple[Answer, ...]


def reach(config: MachineConfig, motor: str) -> tuple[int, float]:
    """How far a probe moves a motor from where it stands, at most: steps, and mm or degrees."""
    steps = max(STEPS_MOST, RUN_AWAY_STEPS + 2)
    return steps, steps / abs(motor_tables(config)[motor][1].steps_per_unit)


def probe_motor(
    connection: Connection,
    motor: str,
    *,
    amplifier_off: bool = False,
    stop_requested: StopRequested,
    progress: Callable[[], None],
) -> Probed:
    """All trials and questions of one motor; it ends where it began, its parameters as the machine file has them.

    Raises what ``at_work`` expects; UndecidedError where the axis does not move as a free one does.
    """
    config = connection.config
    axis, table = motor_tables(config)[motor]
    bus = bus_of(connection, table.bus)
    chip = PicStep(bus, table.address)
    timing = bus_timing(config, list(nmc_buses(config)).index(table.bus), connection.simulation is not None)
    version = chip.type_version()[1]
    set_step_parameters(chip, table, "1x")
    latch = LatchProbe(chip, timing, Asker(bus, stop_requested)).measure(progress)
    answers = Silences(chip, connection, stop_requested).ask_all(amplifier_off)
    chip.stop_motor("abruptly")
    set_step_parameters(chip, table, f"{speed_mode(config, axis, table)}x")
    return Probed(motor, version, latch, tuple(answers))


def table_of(config: MachineConfig, motor: str) -> KeyPath:
    """The table of the machine file that describes a motor."""
    return ("axis" if motor in config.axis else "motor", motor)


def with_probed(text: str, config: MachineConfig, probed: Probed, place: str, date: str) -> str:
    """The text of the machine file with what was found out. Raises ValueError where it cannot be changed safely."""
    found = probed.latch
    path = table_of(config, probed.motor)
    text = set_values(text, path, {"count_latch": found.count_latch, "first_step": found.first_step})
    record: dict[str, Value] = {
        "date": date,
        "measured_on": place,
        "version": probed.version,
        "load_trials": found.load_trials,
        "start_trials": found.start_trials,
        "start_delay_ms": round(found.delay_ms, 3),
        "start_delay_error_ms": round(found.delay_error_ms, 3),
    }
    return set_values(text, (*path, "probed"), record)


def evidence_lines(probed: Probed) -> list[str]:
    """What was seen, for whoever reads it."""
    found = probed.latch
    lines = [
        f"motor {probed.motor}: PIC-STEP version {probed.version}",
        f"  X-61 a new count while moving: {_latch_words(found)}",
        f"       {found.load_trials} trials: {found.only_rollover} allow the next roll-over only, "
        f"{found.only_immediate} at once only, {found.neither} neither",
        f"  X-62 the first step: {_first_words(found)}",
        f"       {found.start_trials} trials: {found.only_period} allow a period only, "
        f"{found.only_at_once} at once only",
    ]
    if found.first_step != "unknown":
        lines.append(
            f"       a start is executed {found.delay_ms:.2f} ms after its last byte on average "
            f"(standard error {found.delay_error_ms:.2f}); surely {found.delay_least_ms:.2f} ms once"
        )
    for answer in probed.answers:
        mark = "" if answer.as_assumed else "  NOT as the simulator has it"
        lines.append(f"  {answer.rule} {answer.question}: {answer.answer}{mark}")
    return lines


def _latch_words(found: LatchFinding) -> str:
    return {
        "rollover": 'takes effect at the next roll-over (count_latch = "rollover")',
        "immediate": 'takes effect at once (count_latch = "immediate")',
        "unknown": 'not decided (count_latch = "unknown")',
    }[found.count_latch]


def _first_words(found: LatchFinding) -> str:
    return {
        "period": 'comes one period after the start (first_step = "period")',
        "immediate": 'comes at once (first_step = "immediate")',
        "unknown": 'not decided (first_step = "unknown")',
    }[found.first_step]


def as_record(probed: Probed) -> dict[str, object]:
    """Everything by name."""
    found = probed.latch
    return {
        "motor": probed.motor,
        "version": probed.version,
        "count_latch": found.count_latch,
        "first_step": found.first_step,
        "load_trials": found.load_trials,
        "only_rollover": found.only_rollover,
        "only_immediate": found.only_immediate,
        "neither": found.neither,
        "start_trials": found.start_trials,
        "only_period": found.only_period,
        "only_at_once": found.only_at_once,
        "start_delay_ms": round(found.delay_ms, 4),
        "start_delay_error_ms": round(found.delay_error_ms, 4),
        "start_delay_least_ms": round(found.delay_least_ms, 4),
        "answers": [
            {"rule": a.rule, "question": a.question, "answer": a.answer, "as_assumed": a.as_assumed}
            for a in probed.answers
        ],
    }
