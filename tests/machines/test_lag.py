"""``lag_ms``: a servo that is commanded ahead of the plan brings its shaft to where the steppers are."""

import pytest

from groupstart import verify
from machines.load import parse_machine, read_machine
from machines.verdict import Verdict
from machines.wiring import command_leads_ns

HELIX = "G21 G90 G64 P0.01\nG1 X22 Y20 F1200\nG2 X22 Y20 I-2 J0 Z2\nG2 X22 Y20 I-2 J0 Z4\nG18\nG2 X22 Z4 I-2 K0\nM2\n"


def run(folder: str, lag_ms: float) -> Verdict:
    text = read_machine("mill3-mixed").text
    for key, value in (("kp = 220", "kp = 220"), ("ki = 150", "ki = 0"), ("integration_limit = 4000", "")):
        assert key in text
        text = text.replace(key, value)
    path = f"{folder}/{lag_ms}.toml"
    with open(path, "w") as file:
        file.write(text.replace("kp = 220", f"kp = 220\nlag_ms = {lag_ms}"))
    result = verify(HELIX, path)
    assert result.verdict is not None
    return result.verdict


def test_the_shaft_comes_nearer_to_the_plan_and_the_command_is_judged_where_it_is_meant(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folder = str(tmp_path_factory.mktemp("lag"))
    plain, led = run(folder, 0.0), run(folder, 2.0)
    assert plain.motor_contour_um is not None
    assert led.motor_contour_um is not None
    assert led.motor_contour_um.rms < 0.7 * plain.motor_contour_um.rms
    assert led.motor_contour_um.max < 0.8 * plain.motor_contour_um.max
    assert plain.contour_um is not None
    assert led.contour_um is not None
    assert led.contour_um.rms < plain.contour_um.rms + 1.5
    assert set(led.end_error_steps.values()) <= {-1, 0, 1, 2, -2}
    assert led.violations == {}


def test_without_the_key_nothing_is_led() -> None:
    assert command_leads_ns(read_machine("mill3-servo").config) == {"X": 0, "Y": 0, "Z": 0}
    text = read_machine("mill3-servo").text.replace("kp = 220", "kp = 220\nlag_ms = 1.5", 1)
    assert command_leads_ns(parse_machine(text, "m")) == {"X": 1_500_000, "Y": 0, "Z": 0}
