"""Tool tables, parameter files, ini files, synch points and snapshots."""

from pathlib import Path

import pytest

from gcode.canon import Rapid
from gcode.inifile import read_ini
from gcode.interp import interpret
from gcode.run import Run
from gcode.setup import Setup, Tool
from gcode.snapshots import snapshot_before
from gcode.synch import Answer, Synch
from gcode.tooltable import read_parameters, read_tool_table, write_parameters, write_tool_table

TABLE = "; comment\nT1 P1 Z+0.5 D3.0 ;end mill\nT2 P7 X1 Y2 Z-3 A4 D6 I95 J155 Q2\n"


def test_a_tool_table_is_read_and_written():
    tools, found = read_tool_table(TABLE)
    assert not found
    assert tools[1] == Tool(1, 1, (0, 0, 0.5, 0, 0, 0, 0, 0, 0), 3.0, comment="end mill")
    assert (tools[2].pocket, tools[2].front_angle, tools[2].back_angle, tools[2].orientation) == (7, 95, 155, 2)
    assert read_tool_table(write_tool_table(tools))[0] == tools


def test_what_is_no_tool_is_named_with_its_place():
    tools, found = read_tool_table("T1 P1 Zx\nP2 Z1\nT1 Z2\n", "tool.tbl")
    assert [(d.line, d.column, d.code) for d in found] == [
        (1, 7, "GC301"),
        (1, 8, "GC301"),
        (2, 1, "GC301"),
        (3, 1, "GC301"),
    ]
    assert set(tools) == {1}


def test_parameters_are_read_and_written():
    values, found = read_parameters("5161\t1.5\n5221 2\nnonsense\n9999 1\n")
    assert values == {5161: 1.5, 5221: 2.0}
    assert [(d.line, d.code) for d in found] == [(3, "GC302"), (4, "GC302")]
    again, _ = read_parameters(write_parameters({**values, 31: 7.0, 5061: 3.0}))
    assert again[5161] == 1.5
    assert again[31] == 7.0
    assert 5061 not in again


def test_offsets_of_a_parameter_file_are_in_machine_units():
    setup = Setup(machine_units="inch", parameters={5221: 1.0, 5220: 1.0})
    rapid = next(c for c in interpret("G21 G0 X1\nM2\n", setup).commands if isinstance(c, Rapid))
    assert rapid.end[0] == 26.4


def test_an_ini_file_gives_values_and_folders(tmp_path: Path):
    path = tmp_path / "machine.ini"
    path.write_text("[RS274NGC]\nPARAMETER_FILE = p.var\nSUBROUTINE_PATH = subs\n[VARS]\nCHANGE_X = 12.5\n")
    (tmp_path / "subs").mkdir()
    (tmp_path / "subs" / "bore.ngc").write_text("o<bore> sub\nG0 Y#1\no<bore> endsub [#1*2]\n")
    ini = read_ini(path)
    assert ini.parameter_file == tmp_path / "p.var"
    text = "G21 G0 X#<_ini[vars]change_x>\no<bore> call [3]\nG0 Z#<_value>\nM2\n"
    result = interpret(text, Setup(ini=ini.values, include=ini.subroutine_path))
    assert not result.errors
    assert [c.end[:3] for c in result.commands if isinstance(c, Rapid)] == [(12.5, 0, 0), (12.5, 3, 0), (12.5, 3, 6)]


def test_a_name_cannot_climb_out_of_the_folders(tmp_path: Path):
    (tmp_path / "secret.ngc").write_text("o<secret> sub\no<secret> endsub\n")
    (tmp_path / "subs").mkdir()
    result = interpret("o<../secret> call\nM2\n", Setup(include=(str(tmp_path / "subs"),)))
    assert [d.code for d in result.errors] == ["GC085"]


@pytest.mark.parametrize(("helper_first", "refused"), [(True, []), (False, ["GC085"])])
def test_a_file_of_subprograms_defines_before_it_calls(tmp_path: Path, helper_first, refused):
    helper, main = "o200 sub\nG0 X#1\no200 endsub\n", "o<deep> sub\no200 call [4]\no<deep> endsub\n"
    (tmp_path / "deep.ngc").write_text(helper + main if helper_first else main + helper)
    result = interpret("o<deep> call\nM2\n", Setup(include=(str(tmp_path),)))
    assert [d.code for d in result.errors] == refused


def test_the_machine_answers_at_synch_points():
    text = "G21 G90 F100\nG0 Z5\nG38.2 Z-10\nG92 Z0\nG0 Z#5063\nM66 P3 L3 Q1\nG0 X#5399\nM2\n"
    events = Run(text, Setup()).events()
    answer, moves, kinds = None, [], []
    while True:
        try:
            event = events.send(answer)
        except StopIteration:
            break
        answer = None
        if isinstance(event, Synch):
            kinds.append((event.kind, event.index, event.timeout_s))
            touched = (0.0, 0.0, -4.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            rest = (0.0, 0.0, -4.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            answer = Answer(rest, touched) if event.kind == "probe" else Answer(value=8.0)
        elif isinstance(event, Rapid):
            moves.append(event.end[:3])
    assert kinds == [("probe", 0, 0.0), ("input", 3, 1.0)]
    assert moves == [(0, 0, 5), (0, 0, -4.5 - 4.25), (8, 0, -8.75)]


def test_a_snapshot_tells_what_holds_before_a_line():
    text = "G21 G90 G17 F100\nT1 M6\nS1000 M3\nM8\nG43.1 Z2\nG55\nG0 X1 Y2\nG91 G18\nG0 Z1\nM2\n"
    found = snapshot_before(text, Setup(), 9)
    assert found is not None
    assert found.position[:3] == (1, 2, 0)
    for word in ("G0", "G18", "G21", "G91", "G94", "G55", "G43.1", "M3", "M8", "T1", "F100", "S1000"):
        assert word in found.modal_words().split()
    assert "T1 M6" in found.preamble()
    assert "G43.1 Z2" in found.preamble()


def test_a_run_from_a_preamble_is_in_the_same_modes():
    text = "G20 G90 G19 F10\nT2 M6\nS500 M4\nM7\nG56 G64 P0.001\nG0 X1\nM2\n"
    before = snapshot_before(text, Setup(), 6)
    assert before is not None
    again = snapshot_before("\n".join([*before.preamble(), "G0 X1", "M2", ""]), Setup(), len(before.preamble()) + 1)
    assert again is not None
    assert again.modal_words().split()[1:] == before.modal_words().split()[1:]


def test_a_line_that_is_never_reached_has_no_snapshot():
    assert snapshot_before("G0 X1\nM2\nG0 X2\n", Setup(), 3) is None


def test_an_endless_program_is_bounded():
    result = interpret("o1 while [1]\nG0 X1\nG0 X2\no1 endwhile\nM2\n", Setup(max_steps=20_000))
    assert [d.code for d in result.errors] == ["GC089"]


@pytest.mark.parametrize(
    ("dialect", "text"),
    [
        ("fanuc", "N1 G1 X1 F100\nGOTO 1\nM30\n"),
        ("fanuc", "WHILE [1 EQ 1] DO1\nEND1\nM30\n"),
        ("fanuc", "DO1\nEND1\nM30\n"),
        ("fanuc", "DO1\nG0 X1\nEND1\nM30\n"),
        ("fanuc", "M98 P2 L99999999\nM30\nO2\nG4 P1\nM99\n"),
        ("linuxcnc", "o1 while [1]\nG1 X1 F100\no1 endwhile\nM2\n"),
        ("linuxcnc", "F9\no1 while [1]\nG2 X1 Y0 I0.5\nG2 X0 Y0 I-0.5\no1 endwhile\nM2\n"),
        ("linuxcnc", "o1 do\no1 while [1]\nM2\n"),
        ("linuxcnc", "o1 repeat [999999999]\nG1 X1 F1\no1 endrepeat\nM2\n"),
    ],
)
def test_a_loop_that_never_ends_is_refused(dialect, text):
    result = interpret(text, Setup(dialect=dialect, max_steps=100_000))
    assert [error.code for error in result.errors] == ["GC089"]
