"""Every branch of the modal groups, of the order of execution and of the steps that it names: refusals and effects.

The command that measures it: ``coverage run -m pytest tests/gcode -n 0 && coverage report`` (100 % is asked for).
"""

import pytest

from gcode.canon import Coolant, Feed, Message, Output, Printed, Rapid, Spindle, Text
from gcode.catalog import load_catalog
from gcode.comments import is_active
from gcode.interp import interpret
from gcode.setup import Setup, Tool

HEAD = "G21 G90 G17 F100 S1000 M3\nG0 X1 Y2 Z3\n"
COMPENSATED = "G41.1 D1\nG1 X20 Y0\nX30\n"
TOOLS = {1: Tool(1, 1, (0.0, 0.0, 10.0) + (0.0,) * 6, 6.0), 2: Tool(2, 2, orientation=3)}


def run(text, **setup):
    return interpret(HEAD + text + "\nM2\n", Setup(tools=TOOLS, **setup))


REFUSED = {
    # words and motions
    "GC010": ["G-1", "G915", "G1.7 X1", "G383 X1"],
    "GC011": ["M17", "M200", "M75"],
    "GC014": ["G2 X3 I1 P1.5", "G10 L2 P1.5 X1"],
    "GC015": ["G4 P-1", "M62 P-1", "M66 P-1 L0", "M66 E-1 L0", "M68 E-1 Q1"],
    "GC020": ["G10 L20 P1 X1 R5", "G10 L2 P1 I1", "G10 L20 P1 J1 X1", "G33 Z-1 K1 F10"],
    "GC021": ["G80\nX1", "G80\n@5", "G80\nG53 X1"],
    "GC022": ["G80 X1"],
    "GC023": ["G4 P1 G2 X3 I1", "G92 X1 G1", "G64 R1 M19"],
    "GC024": ["G81", "G92", "G52", "G38.2"],
    "GC025": ["G4", "G96", "G33 Z1", "M62", "M67 Q1", "M61", "M61 Q-1"],
    "GC026": [
        *("G18\nG1 @5", "G1 @5 X1", "G10 L2 P1 @5", "G53 G0 @5"),
        *("G0 X0 Y0\nG1 @5", "G0 X0 Y0\nG91 G1 ^5"),
    ],
    "GC040": ["G94\nG1 X5", "G94\nG38.2 Z1", "G93\nG38.2 Z1"],
    "GC041": ["G93 G1 X5"],
    "GC050": ["G91 G53 G0 X1", "G91\nG53 G0 X1"],
    "GC051": ["G53 X1 G2 I1", "G53"],
    "GC052": ["G2 X3 I1 P0", "G2 X3 I1 P-3"],
    "GC055": ["G95 F1\nG38.2 Z1"],
    "GC061": ["M6"],
    "GC062": ["G43.2 H1 X1", "G43.2"],
    "GC063": ["G10 L3 P1", "G10 P1", "G10 L1 P1", "G10 L10 P1"],
    "GC064": ["G10 L2 X1", "G10 L2 P10 X1", "G10 L1 P0 X1", "G10 L1 P1 Q10", "G10 L1 P1 Q1.5"],
    "GC071": ["M3 $2", "S100 $1", "M5 S0\nG95 F1\nG1 X5"],
    "GC072": ["M19 R361", "M19 R-1", "M19 P3", "M19 R1 Q0"],
    "GC073": ["M66 L0", "M66 P1 E1", "M66 P1 L5 Q1", "M66 P1 L3", "M66 E1 L3 Q1"],
    "GC088": ["M72", "M70\nM71\nM72"],
    "GC090": [
        *(COMPENSATED + line for line in ("G28", "G30.1", "G18", "G99", "G64", "G49", "M6 T1", "M62 P1", "M49")),
        *(COMPENSATED + line for line in ("M66 P1 L0", "G10 L2 P1 X1", "G92 X1", "G38.2 Z1", "G55", "G41 D1")),
    ],
}
CASES = [(code, line) for code, lines in REFUSED.items() for line in lines]


@pytest.mark.parametrize(("code", "line"), CASES)
def test_is_refused(code, line):
    found = [d.code for d in run(line).errors]
    assert found[:1] == [code]


def test_compensation_forbids_only_what_changes_something():
    assert not run(COMPENSATED + "G92.1\nG21\nG17\nG0 X40\nG40\nG0 X0").errors
    assert [d.code for d in run("G92 X5\n" + COMPENSATED + "G92.1").errors] == ["GC090"]
    assert [d.code for d in run(COMPENSATED + "G20").errors] == ["GC090"]


def test_a_code_meant_in_tenths_is_named():
    assert "did you mean G38.3?" in run("G383 X1").errors[0].hint
    assert "G38.3" in run("G38.9 X1").errors[0].hint


def ends(text, **setup):
    result = run(text, **setup)
    assert not result.errors, [d.text() for d in result.errors]
    return [tuple(round(value, 6) for value in c.end[:3]) for c in result.commands if isinstance(c, Rapid | Feed)][1:]


@pytest.mark.parametrize(
    ("text", "places"),
    [
        ("G53 G0 Z5", [(1, 2, 5)]),
        ("G10 L2 P1 X10 R90\nG53 G0 X5", [(5, 2, 3)]),
        ("G0 X3 Y4\nG1 @10", [(3, 4, 3), (6, 8, 3)]),
        ("G0 X3 Y4\nG91 G1 @5", [(3, 4, 3), (6, 8, 3)]),
        ("G0 X5 Y0\nG91 G1 ^90", [(5, 0, 3), (0, 5, 3)]),
        ("G7\nG7\nG0 X10\nG8 X10", [(5, 2, 3), (10, 2, 3)]),
        ("G7 X10\nG8 X4", [(5, 2, 3), (4, 2, 3)]),
        ("G7\nG8\nG0 Y1", [(1, 1, 3)]),
        ("G43 H1\nG0 Z0", [(1, 2, 10)]),
        ("G80\nG43.2 H1\nG43.2 X1\nG0 X0 Z0", [(1, 2, 10)]),
        ("T1 M6\nG43\nG0 Z0\nG10 L1 P1 Z20\nG43\nG0 Z0", [(1, 2, 10), (1, 2, 20)]),
        ("G93 G1 X1 Y2 Z3 F1\nG94", [(1, 2, 3)]),
    ],
)
def test_ends_of_moves(text, places):
    assert ends(text) == places


def test_a_centre_word_alone_repeats_the_arc():
    result = run("G2 X3 I1\nI-1")
    assert not result.errors
    assert [c.turns for c in result.commands if hasattr(c, "turns")] == [-1, -1]


def test_an_inverse_time_move_of_rotary_axes_has_their_length():
    result = run("G93 G1 A90 F2\nG94")
    assert [c.feed_mm_s for c in result.commands if isinstance(c, Feed)] == [pytest.approx(3.0)]


def texts(text):
    return [c.function for c in run(text).commands if isinstance(c, Text)]


def test_tool_data_is_told_again_where_the_tool_is_in_the_spindle():
    assert "RELOAD_TOOLDATA()" in texts("G10 L0")
    entries = [line for line in texts("M61 Q1\nG10 L1 P1 Z5 R2 Q3\nG10 L1 P2 I5 J6") if "ENTRY" in line]
    assert [line.split(",")[0] for line in entries] == [f"SET_TOOL_TABLE_ENTRY({pocket}" for pocket in (1, 0, 2)]


def test_any_tool_can_be_measured_where_no_table_is_known():
    result = interpret("G21 G90\nG10 L1 P7 Z5\nG43 H7\nG0 Z0\nM2\n", Setup())
    assert [c.end[2] for c in result.commands if isinstance(c, Rapid)] == [5.0]


def test_orientation_of_the_spindle_is_one_function_a_word():
    def spelled(text):
        return [c.spelled.split("\n") for c in run(text).commands if isinstance(c, Spindle)][-2]

    assert spelled("M19 R30 Q2") == ["ORIENT_SPINDLE(0, 30.0000, 0)", "SPINDLE.0.WAIT_ORIENT_COMPLETE(2.0000)"]
    assert spelled("M19 Q2") == ["SPINDLE.0.WAIT_ORIENT_COMPLETE(2.0000)"]
    assert spelled("M19") == ["START_SPINDLE_CLOCKWISE(0)"]


def test_outputs_of_all_kinds():
    outputs = [c for c in run("M62 P1\nM63 P1\nM64 P2\nM65 P2\nM67 E3 Q4\nM68 E3").commands if isinstance(c, Output)]
    assert [(c.index, c.value, c.analog, c.synchronised) for c in outputs] == [
        (1, 1.0, False, True),
        (1, 0.0, False, True),
        (2, 1.0, False, False),
        (2, 0.0, False, False),
        (3, 4.0, True, True),
        (3, 0.0, True, False),
    ]


def coolants(result):
    return [(c.mist, c.flood) for c in result.commands if isinstance(c, Coolant)]


def test_overrides_and_coolant_end_with_the_program():
    result = run("M49\nM53 P1\nM52 P1\nM50 P0\nM51 P0\nM7 M48\nM49\nM8")
    functions = [c.function for c in result.commands if isinstance(c, Text)]
    at = functions.index("SET_FEED_MODE(0, 0)")
    assert functions[at + 1 : at + 3] == ["SET_FEED_RATE(0.0000)", "ENABLE_FEED_OVERRIDE()"]
    assert [(c.mist, c.flood) for c in result.commands if isinstance(c, Coolant)][-2:] == [
        (False, True),
        (False, False),
    ]


def test_comments_that_do_something():
    text = "#1=2.5\n#<_n>=4\n(MSG, look)\n(DEBUG, %d #1 %.2f #1 #<_n> #<_nothing> %f #1)\n(PRINT, #1)\n"
    text += "(LOG, a#1)\n(LOGOPEN, f.txt)\n(LOGAPPEND, f.txt)\n(LOGCLOSE)\n#5599=0\n(DEBUG, unseen)\n(PROBEOPEN p.txt)"
    result = run(text)
    assert not result.errors
    messages = [c.text for c in result.commands if isinstance(c, Message)]
    assert messages == [" look", "  2  2.50 4.00 ######  2.5000"]
    assert [c.function for c in result.commands if isinstance(c, Printed)] == [" 2.500000"]
    assert [line for line in texts(text) if line.startswith("LOG")] == [
        'LOG(" a2.500000")',
        'LOGOPEN(" f.txt")',
        'LOGAPPEND(" f.txt")',
        "LOGCLOSE()",
    ]


def test_a_compiled_loop_leaves_comments_that_act_to_the_interpreter():
    assert is_active("DEBUG, #1")
    assert not is_active("a debugging note")


def test_g64_tells_which_planner_is_wanted():
    found = [line for line in texts("G64 P1 R0.5\nG64 R2.5\nG64 R0.05\nG64 R0\nG64 P1") if "PLANNER" in line]
    kinds = ["type=1, peak_scale=0.5", "type=1, peak_scale=1.0", "type=1, peak_scale=0.1", "type=0, peak_scale=-1.0"]
    assert found == [f"SET_PLANNER_MODE({kind}00000)" for kind in kinds]


def test_units_take_the_tolerances_along():
    result = run("G64 P0.254 Q0.508\nM70\nG20\nG61\nM72")
    controls = [(c.mode, c.tolerance_mm, c.merge_mm) for c in result.commands if type(c).__name__ == "PathControl"]
    assert controls[0] == controls[-1] == ("continuous", pytest.approx(0.254), pytest.approx(0.508))


def test_saved_modes_come_back():
    text = "M7\nM8\nG64\nM70\nG91 G99 G18 G55 G61 G95 F1 G20 S5 M4\nM9\nM49\nM72\nG1 X1 F100"
    result = run(text)
    assert not result.errors
    assert coolants(result)[2:] == [(False, False), (True, False), (True, True), (False, True), (False, False)]
    assert [c.direction for c in result.commands if isinstance(c, Spindle)][-2] == 1


def test_g97_ends_the_surface_speed():
    for text, spelled in (("G97", ["SET_SPINDLE_MODE(0 0.0000)"]), ("G97 S100", ["SET_SPINDLE_SPEED(0, 100.0000)"])):
        result = run("G96 D900 S50\n" + text)
        assert [c.spelled for c in result.commands if isinstance(c, Spindle) and c.line == 4] == spelled
        assert [d.code for d in result.diagnostics] == ["GC203"]


def test_a_saved_tolerance_needs_no_merging():
    result = run("G64 P0.2\nM70\nG64 P0.1 Q0.1\nM72")
    controls = [(c.tolerance_mm, c.merge_mm) for c in result.commands if type(c).__name__ == "PathControl"]
    assert controls == [(0.2, None), (0.1, 0.1), (0.2, None)]


def test_saved_modes_with_one_coolant_switch_the_other_off():
    result = run("M8\nM70\nM9\nM7\nM72")
    assert [(c.mist, c.flood) for c in result.commands if isinstance(c, Coolant)][-2:] == [
        (False, True),
        (False, False),
    ]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("M73", "GC207"),
        ("T1 M6\nM6", "GC217"),
        ("G43", "GC202"),
        ("M5 S0\nM3", "GC204"),
    ],
)
def test_what_is_suspicious_is_warned_of(text, code):
    assert [(d.code, d.severity) for d in run(text).diagnostics] == [(code, "warning")]


def test_lenient_dialects_forgive_words():
    result = run("G1 X2 Q1\nM77 P3\nM3 S5", dialect="grbl")
    assert [d.code for d in result.diagnostics] == ["GC215", "GC213"]


def test_every_code_of_the_table_above_is_in_the_catalogue():
    assert set(REFUSED) <= set(load_catalog())
