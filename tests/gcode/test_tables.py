"""The modal groups and the order of execution: every entry of the tables acts, in the order of the standard."""

import pytest

from gcode.checks import WORD_USERS
from gcode.codes import G_GROUP_OF, G_GROUPS, M_GROUP_OF, M_GROUPS, g_name, g_number
from gcode.execute import MODAL_0_STEPS, MOTIONS, ORDER
from gcode.interp import interpret

HEAD = "G21 G90 G17 F100\nG0 X1 Y2 Z3\n"


def codes(text):
    return [d.code for d in interpret(HEAD + text + "\nM2\n").errors]


@pytest.mark.parametrize("group", G_GROUPS)
def test_two_g_codes_of_a_group_exclude_each_other(group):
    one, two = [code for code in G_GROUPS[group] if code != 800][:2]
    assert "GC012" in codes(f"{g_name(one)} {g_name(two)}")


@pytest.mark.parametrize("group", [group for group, members in M_GROUPS.items() if len(members) > 1])
def test_two_m_codes_of_a_group_exclude_each_other(group):
    one, two = M_GROUPS[group][:2]
    assert "GC012" in codes(f"M{one} M{two} P1 Q1")


def test_g80_yields_to_the_motion_beside_it():
    assert codes("G80 G1 X5") == []
    assert codes("G1 G80 X5") == []


def test_groups_do_not_overlap_and_names_read_back():
    assert sum(map(len, G_GROUPS.values())) == len(G_GROUP_OF)
    assert sum(map(len, M_GROUPS.values())) == len(M_GROUP_OF)
    assert all(g_number(g_name(code)) == code for code in G_GROUP_OF)


def test_every_group_has_its_stage_and_every_code_its_step():
    staged = {stage.key for stage in ORDER}
    assert set(G_GROUPS) <= staged
    assert set(M_GROUPS) - {"subprogram", "saved state"} <= staged
    assert set(G_GROUPS["motion"]) == set(MOTIONS)
    assert set(G_GROUPS["non-modal"]) == set(MODAL_0_STEPS)


@pytest.mark.parametrize("letter", WORD_USERS)
def test_a_word_that_nothing_uses_is_refused(letter):
    assert "GC020" in codes(f"{letter}1")


USED = {
    "d": ["G41 D0", "G96 D100 S50", "M3 S1\nG83 X1 Z-1 R1 Q1 D0.1"],
    "$": ["M3 $0", "S100 $0"],
    "e": ["M67 E0 Q1"],
    "h": ["G43 H0"],
    "i": ["G2 X3 I1", "G10 L1 P1 I5"],
    "j": ["G3 X1 Y4 J1"],
    "k": ["G18 G2 Z5 K1"],
    "l": ["G10 L2 P1 X0", "G81 X1 Z-1 R1 L2", "M66 P0 L0"],
    "p": ["G4 P0.1", "G64 P0.1", "M62 P1", "M50 P1", "M19 R0 P1"],
    "q": ["G64 P0.1 Q0.1", "M61 Q0", "M66 P0 Q1"],
    "r": ["G2 X5 R2", "G81 X1 Z-1 R1", "M19 R5"],
}


@pytest.mark.parametrize(("letter", "line"), [(letter, line) for letter, lines in USED.items() for line in lines])
def test_a_word_with_a_user_is_taken(letter, line):
    assert letter.upper() in line
    assert codes(line) == []


def functions(text):
    from gcode.canontext import canon_lines

    lines = canon_lines(interpret(text).commands)
    return [line.split(None, 2)[2].partition("(")[0] for line in lines if line.split()[1] == "N1"]


def test_one_line_acts_in_the_order_of_the_standard():
    line = "G1 X1 M8 G94 F100 S500 T1 M6 M3 G4 P1 G20 G18 G43.1 Z1 G55 G64 G91 G91.1 G98 M0 (c)\nM2\n"
    line = line.replace(" G4 P1", "").replace(" G43.1 Z1", " G49")
    assert functions(line.replace("M6 ", "").replace("T1", "T1 M61 Q1")) == [
        "COMMENT",
        "COMMENT",
        "SET_FEED_MODE",
        "SET_FEED_RATE",
        "SET_FEED_RATE",
        "SET_SPINDLE_SPEED",
        "SELECT_TOOL",
        "CHANGE_TOOL_NUMBER",
        "START_SPINDLE_CLOCKWISE",
        "FLOOD_ON",
        "SELECT_PLANE",
        "USE_LENGTH_UNITS",
        "USE_TOOL_LENGTH_OFFSET",
        "SET_G5X_OFFSET",
        "SET_G92_OFFSET",
        "SET_XY_ROTATION",
        "SET_MOTION_CONTROL_MODE",
        "SET_NAIVECAM_TOLERANCE",
        "COMMENT",
        "COMMENT",
        "STRAIGHT_FEED",
        "PROGRAM_STOP",
    ]


def test_the_stages_stand_in_the_order_of_table_8():
    keys = [stage.key for stage in ORDER]
    expected = ["feed mode", "f", "s", "t", "tool change", "spindle", "coolant", "override", "plane", "units"]
    expected += ["cutter compensation", "tool length offset", "coordinate system", "path control", "distance mode"]
    expected += ["retract mode", "motion", "stopping"]
    places = [keys.index(key) for key in expected]
    assert places == sorted(places)
