"""Dialects: what each reads differently, and how one is guessed."""

import math

import pytest

from gcode.canon import Arc, Dwell, Feed, Rapid
from gcode.dialects import DIALECTS, guess
from gcode.interp import interpret
from gcode.setup import Setup

HEAD = "G21 G90 G17 F100\n"


def run(text, dialect="fanuc"):
    result = interpret(HEAD + text + "\nM2\n", Setup(dialect=dialect))
    assert not result.errors, [d.text() for d in result.errors]
    return result


def ends(result):
    return [tuple(round(v, 6) for v in c.end[:3]) for c in result.commands if isinstance(c, Rapid | Feed | Arc)]


def codes(result):
    return [d.code for d in result.diagnostics]


def test_unknown_m_codes_are_ignored_with_their_words():
    result = run("M300 S30\nG1 X1", "grbl")
    assert codes(result) == ["GC213"]
    assert not any("SPINDLE_SPEED" in getattr(c, "spelled", "") for c in result.commands)


def test_sender_lines_belong_to_the_sender():
    assert codes(run("$H\n?\nG1 X1", "grbl")) == ["GC211", "GC211"]


def test_a_good_checksum_is_taken():
    text = "G1 X1"
    check = 0
    for byte in text.encode():
        check ^= byte
    assert ends(run(f"{text}*{check}", "grbl")) == [(1, 0, 0)]


def test_mach_has_units_by_g70_and_g71():
    assert ends(run("G70G91.1\nG0 X1", "mach")) == [(25.4, 0, 0)]


def test_fanuc_dwells_in_milliseconds_or_by_x():
    assert [c.seconds for c in run("G4 P1500\nG4 X2.5").commands if isinstance(c, Dwell)] == [1.5, 2.5]


def test_g28_may_stand_beside_g0():
    assert ends(run("G0 Z5\nG0 G91 G28 Z0")) == [(0, 0, 5), (0, 0, 5), (0, 0, 0)]


def test_rotation_about_a_point():
    result = run("G68 X10 Y0 R90\nG0 X20 Y0\nG1 X10 Y5\nG69\nG0 X0 Y0")
    assert ends(result) == [(10, 10, 0), (5, 0, 0), (0, 0, 0)]


def test_rotation_turns_arcs_and_increments():
    result = run("G68 X0 Y0 R90\nG0 X10 Y0\nG2 X20 Y0 I5\nG91 G1 X1\nG69")
    assert ends(result) == [(0, 10, 0), (0, 20, 0), (0, 21, 0)]
    arc = next(c for c in result.commands if isinstance(c, Arc))
    assert arc.center == pytest.approx((0, 15))


def test_scaling_and_mirror():
    assert ends(run("G51 X2 Y2 Z1\nG0 X3 Y4\nG50\nG0 X3", "mach")) == [(6, 8, 0), (3, 8, 0)]
    mirrored = run("G51 X0 Y0 I-1 J1 K1\nG0 X5\nG2 X15 I5")
    assert ends(mirrored) == [(-5, 0, 0), (-15, 0, 0)]
    assert next(c for c in mirrored.commands if isinstance(c, Arc)).turns == 1


def test_polar_coordinates():
    assert ends(run("G16\nG0 X10 Y30\nY90\nG15\nG0 X1 Y1")) == [
        (round(10 * math.cos(math.pi / 6), 6), 5, 0),
        (0, 10, 0),
        (1, 1, 0),
    ]


def test_circular_pocket():
    result = run("G0 X10 Y10\nG13 I4")
    assert ends(result) == [(10, 10, 0), (14, 10, 0), (14, 10, 0), (10, 10, 0)]


def test_extended_work_offsets():
    result = run("G10 L2 P3 X7\nG54.1 P3\nG0 X1")
    assert ends(result)[-1] == (8, 0, 0)


def test_macro_b_loops_and_jumps():
    text = "#1=0\nWHILE [#1 LT 3] DO1\nG0 X#1\n#1=[#1+1]\nEND1\nIF [#1 EQ 3] GOTO 20\nG0 X99\n"
    text += "N20 IF [#1 GT 2] THEN #2=5\nG0 Y#2"
    assert ends(run(text)) == [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 5, 0)]


def test_vacant_parameters_leave_words_out():
    assert ends(run("G0 X5 Y#99\nIF [#99 EQ #0] THEN #1=2\nG0 Z#1")) == [(5, 0, 0), (5, 0, 2)]


def test_macro_calls_with_arguments():
    text = "G65 P9000 A1 B2 X3 L2\nG0 Z9\nM30\nO9000\nG91 G0 X#1 Y#2\nG90 Z#24\nM99"
    assert ends(run(text)) == [(1, 2, 0), (1, 2, 3), (2, 4, 3), (2, 4, 3), (2, 4, 9)]


def test_modal_macro_after_every_move():
    text = "G66 P9000 A7\nG0 X1\nG0 X2\nG67\nG0 X3\nM30\nO9000\nG0 Z#1\nG0 Z0\nM99"
    z = [p[2] for p in ends(run(text))]
    assert z.count(7) >= 2


def test_local_subprogram_of_haas():
    assert ends(run("M97 P100 L2\nG0 X9\nM30\nN100 G91 G0 X1\nG90\nM99")) == [(1, 0, 0), (2, 0, 0), (9, 0, 0)]


@pytest.mark.parametrize("name", [name for name, dialect in DIALECTS.items() if dialect.refused])
def test_other_machines_are_refused_with_a_reason(name):
    result = interpret("G1 X1\n", Setup(dialect=name))
    assert codes(result) == ["GC100"]
    assert result.commands == []


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("G21\nG1 X1 F10\nM2\n", "linuxcnc"),
        ("M104 S200\nG1 X1 E1\n", "marlin"),
        ("DEF REAL X\n", "siemens"),
        ("O1000\nIF [#1 EQ 2] GOTO 10\n", "fanuc"),
        ("G21\nM3 S1\n$H\n", "grbl"),
        ("G70G91.1\nG1 X1\n", "mach"),
    ],
)
def test_the_dialect_is_guessed(text, name):
    assert guess(text)[0] == name


def test_auto_says_what_it_chose():
    result = interpret("G21\n$H\nG0 X1\nM2\n", Setup(dialect="auto"))
    assert result.dialect == "grbl"
    assert "GC209" in codes(result)


def test_taps_outside_g17_go_along_their_own_axis_except_in_linuxcnc():
    text = "G0 X0 Y5 Z0\nM3 S100\nG18 G84 X1 Z2 Y-3 R2"
    assert (1, -3, 2) in ends(run(text, "mach"))
    result = interpret(HEAD + text + "\nM2\n")
    assert "GC208" in codes(result)
