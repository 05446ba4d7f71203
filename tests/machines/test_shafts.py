"""Shafts of PIC-SERVOs in the verdict: where they end, how far off the path they may be, and what GO then claims."""

from pathlib import Path

import pytest

from groupstart import verify
from groupstart.verdicttable import words_of_go
from machines.load import parse_machine, read_machine
from machines.settling import LastCommands
from machines.shafts import ShaftUse, reasons_of_shafts, shaft_limits_um
from machines.verdict import Verdict
from nmc.chips.common import LOAD_TRAJECTORY, STOP_MOTOR
from nmc.program import Evidence, Exchange

PROGRAM = "G21 G90\nG0 X5 Y5\nG1 X14 Y7 F1200\nG1 X5 Y5\nM2\n"
ENDS_OUT = "G21 G90\nG0 X5 Y5\nG1 X14 Y7 F1200\nM2\n"


def machine(folder: Path, stop_high_at: float | None = None, verify_table: str = "") -> str:
    """mill3-servo, X with a hard end stop."""
    text = read_machine("mill3-servo").text
    if stop_high_at is not None:
        text = text.replace("[sim.axis.X.plant]\n", f"[sim.axis.X.plant]\nstop_high_at = {stop_high_at}\n")
    path = folder / "machine.toml"
    path.write_text(f"{text}\n{verify_table}\n")
    return str(path)


def judged(program: str, described: str) -> Verdict:
    verdict = verify(program, described).verdict
    assert verdict is not None
    return verdict


def test_a_shaft_that_a_stop_holds_off_the_path_is_no_go_although_every_command_was_right(tmp_path: Path) -> None:
    verdict = judged(PROGRAM, machine(tmp_path, stop_high_at=12))
    assert set(verdict.end_error_steps.values()) == {0}
    assert verdict.shafts is not None
    assert verdict.shafts.off_um["X"] == pytest.approx(2000, abs=20)
    assert verdict.shafts.off_um["Y"] < 200
    assert max(map(abs, verdict.shafts.end_counts.values())) <= 4  # it has come back, and this alone tells nothing
    off_um = verdict.shafts.off_um["X"]
    assert verdict.reasons == (f"the shaft of X was {off_um:.0f} um from its place, more than 600",)


def test_a_shaft_that_ends_off_its_place_is_named_with_its_counts(tmp_path: Path) -> None:
    verdict = judged(ENDS_OUT, machine(tmp_path, stop_high_at=13.5, verify_table="[verify]\nshaft_um = 5000"))
    assert verdict.shafts is not None
    off = verdict.shafts.end_counts["X"]
    assert off == pytest.approx(-200, abs=3)  # half a millimetre short, 400 counts/mm
    assert verdict.reasons == (f"the shaft of X ends {off:+d} counts from its place, more than 4",)
    assert verdict.as_json()["shaft_end_counts"]["X"] == off


def test_the_limit_of_the_file_counts_instead_of_the_derived_one(tmp_path: Path) -> None:
    good = judged(PROGRAM, machine(tmp_path))
    assert good.ok
    assert good.shafts is not None
    limit = round(max(good.shafts.off_um.values()) / 2, 1)
    bad = judged(PROGRAM, machine(tmp_path, verify_table=f"[verify]\nshaft_um = {limit}"))
    off_um = {name: off for name, off in good.shafts.off_um.items() if off > limit}
    assert set(off_um) == {"X", "Y"}  # Z does not move
    assert bad.reasons == tuple(
        f"the shaft of {name} was {off:.0f} um from its place, more than {limit:g}" for name, off in off_um.items()
    )


def test_a_good_verdict_claims_what_was_judged_and_no_more(tmp_path: Path) -> None:
    verdict = judged(PROGRAM, machine(tmp_path))
    assert verdict.contour_steps is not None
    assert verdict.shafts is not None
    most = max(map(abs, verdict.shafts.end_counts.values()))
    assert words_of_go(verdict) == (
        f"within {verdict.contour_steps.max:.2f} steps of the plan, and every command ended on its step; "
        f"every shaft ended within {most} counts of its place and was at most "
        f"{max(verdict.shafts.off_um.values()):.0f} um from it before"
    )
    step = judged(PROGRAM, "mill3-step")
    assert step.shafts is None
    assert step.contour_steps is not None
    assert words_of_go(step) == (
        f"within {step.contour_steps.max:.2f} steps of the plan, and every axis ended on its step"
    )
    assert "shaft_end_counts" not in step.as_json()


def test_the_derived_limit_is_ten_milliseconds_at_full_speed_or_its_position_error_limit() -> None:
    text = read_machine("mill3-servo").text
    assert shaft_limits_um(parse_machine(text, "m")) == pytest.approx({"X": 600, "Y": 600, "Z": 200})  # 60, 20 mm/s
    tight = text.replace("position_error_limit = 2000", "position_error_limit = 100")
    assert shaft_limits_um(parse_machine(tight, "m")) == pytest.approx({"X": 250, "Y": 250, "Z": 200})  # 400 counts/mm
    given = parse_machine(text + "\n[verify]\nshaft_um = 80\n", "m")
    assert shaft_limits_um(given) == {"X": 80, "Y": 80, "Z": 80}


def test_on_a_port_only_the_ends_of_the_shafts_are_judged() -> None:
    limits = {"X": 600.0, "Y": 600.0}
    assert reasons_of_shafts(ShaftUse({"X": 4, "Y": -4}, 4, {}, limits)) == []
    assert reasons_of_shafts(ShaftUse({"X": 4, "Y": -5}, 4, {}, limits)) == [
        "the shaft of Y ends -5 counts from its place, more than 4"
    ]


def test_the_last_command_is_known_when_it_was_stop_here_and_answered() -> None:
    told = LastCommands(read_machine("mill3-mixed").config)

    def said(address: int, command: int, data: bytes, status: int | None = 0) -> None:
        told.see(Evidence(Exchange(address, command, data), 0, 1, status))

    here = bytes((0x11,)) + (-1234).to_bytes(4, "little", signed=True)
    said(1, STOP_MOTOR, here)
    said(2, STOP_MOTOR, here, status=None)  # nobody answered: not known to have arrived
    said(3, STOP_MOTOR, here)  # a stepper
    assert told.counts == {"X": -1234}
    said(1, LOAD_TRAJECTORY, bytes(9))
    assert told.counts == {}
