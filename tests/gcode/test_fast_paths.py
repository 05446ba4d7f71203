"""Columns, shapes and compiled loops give the very commands that the line by line interpreter gives."""

import re
from dataclasses import replace

import numpy as np
import pytest

import gcode.run
import gcode.stream
from gcode.canon import Arc, MoveBlock
from gcode.columns import LETTERS, tabulate
from gcode.interp import FileRun, interpret
from gcode.setup import Setup


@pytest.fixture
def slowly(monkeypatch):
    """Interprets line by line."""

    def run(text, **options):
        with monkeypatch.context() as patch:
            patch.setattr(gcode.run.Run, "may_run_columns", lambda _self: False)
            return interpret(text, Setup(**options))

    return run


def rounded(commands):
    """Centres of R arcs may differ in the last bit: the functions of numpy and of math round differently."""
    return [
        replace(command, center=tuple(round(value, 9) + 0.0 for value in command.center))
        if isinstance(command, Arc)
        else command
        for command in commands
    ]


def cam(lines, seed, head="G21 G90 G17 F500"):
    rng = np.random.default_rng(seed)
    out = [head, "G0 X0 Y0 Z5"]
    for _ in range(lines):
        kind = rng.integers(0, 12)
        x, y, z = rng.uniform(-50, 50, 3)
        if kind < 6:
            out.append(f"X{x:.3f}Y{y:.4f}" + (f" Z{z:.2f}" if kind < 2 else ""))
        elif kind == 6:
            r = rng.uniform(0.5, 5)
            out.append(f"G91 G2 X{2 * round(r, 3):.3f} I{round(r, 3):.3f}")
            out.append("G1" if "G91" in head else "G90 G1")
        elif kind == 7:
            out.append(f"G{rng.integers(0, 2)} X{x:.1f} Z{abs(z):.1f}")
        elif kind == 8:
            out.append(f"G3 X{x:.3f} Y{y:.3f} R{200 + abs(z):.2f}")
            out.append("G1")
        elif kind == 9:
            out.append(f"F{abs(x) + 1:.1f}")
        elif kind == 10:
            out.append(f"G1 A{x:.2f}" if rng.random() < 0.3 else f"n{int(abs(x) * 10)} g1 y.5")
        else:
            out.append("(remark)" if rng.random() < 0.1 else "")
    return "\n".join([*out, "M2", ""])


HEADS = (
    "G21 G90 G17 F500",
    "G20 G90 G17 F50",
    "G21 G91 G17 F500",
    "G21 G90 F500\nG10 L2 P1 X3 Y4 R30",
    "G21 G90 G17 F500\nG92 X5 Y1\nG43.1 Z2",
)


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("seed", [1, 2])
def test_columns_equal_lines(head, seed, slowly):
    text = cam(900, seed, head)
    fast, slow = interpret(text), slowly(text)
    assert any(isinstance(item, MoveBlock) for item in fast.stream)
    assert rounded(fast.commands) == rounded(slow.commands)
    assert fast.diagnostics == slow.diagnostics


def test_an_error_in_a_run_of_plain_lines_has_its_place(slowly):
    lines = cam(400, 5).split("\n")
    lines.insert(200, "G2 X1 Y1 I5 J90")
    text = "\n".join(lines)
    fast, slow = interpret(text), slowly(text)
    assert next(d.line for d in fast.errors) == 201
    assert fast.diagnostics == slow.diagnostics
    assert rounded(fast.commands) == rounded(slow.commands)


@pytest.mark.parametrize(
    "line",
    ["X1.2.3", "X", "X+-1", "X1-", "5X1", "X1 X2", "G4 P1", "X1N5", "G1.5X1", "X12345678901234567890", "1", "X1 2.5 3"],
)
def test_doubtful_numbers_are_left_to_the_scanner(line, slowly):
    lines = cam(200, 7).split("\n")
    lines.insert(100, line)
    text = "\n".join(lines)
    fast, slow = interpret(text), slowly(text)
    assert fast.diagnostics == slow.diagnostics
    assert rounded(fast.commands) == rounded(slow.commands)


def test_numbers_are_the_floats_that_float_gives():
    rng = np.random.default_rng(4)
    numbers = [
        f"{value:.{digits}f}"
        for value, digits in zip(rng.uniform(-9e4, 9e4, 4000), rng.integers(0, 9, 4000), strict=True)
    ]
    numbers += [".5", "-.25", "5.", "+3", "-0", "123456789012345"]
    table = tabulate("".join(f"X{number}\n" for number in numbers).encode())
    assert table.plain.all()
    assert table.values[LETTERS.index("x")].tolist() == [float(number) for number in numbers]


WORD = re.compile(rf"([{LETTERS}])([+-]?(?:\d+\.?\d*|\.\d+))")


def plainly_read(line):
    """The words of a plain line by regular expression, None for a line that is not plain."""
    line, at, found = line.translate({ord(c): None for c in " \t\r"}).lower(), 0, {}
    while at < len(line):
        word = WORD.match(line, at)
        if word is None:
            return None
        letter, number = word.groups()
        if letter in found or (letter == "n" and found) or sum(c.isdigit() for c in number) > 15:
            return None
        found[letter] = float(number)
        at = word.end()
    return found


def test_tables_hold_what_a_regular_expression_reads():
    rng = np.random.default_rng(12)
    pieces = ["X", "y", "Z", "G", "N", "1", "23", "456789", "1234567890123", ".", "-", "+", " ", "\t", "\r", "(a)", "T"]
    pieces += [
        "X1.5",
        "Y-2.25",
        "Z+0.125 ",
        "N10",
        "-0.",
        "-.5",
        "X-0.000001",
        "F1234567.12345678",
        "I.123456789012345",
    ]
    pieces += ["%", "\u00e9", "#", *["\n"] * 6]
    for _ in range(1500):
        text = "".join(pieces[i] for i in rng.integers(0, len(pieces), rng.integers(1, 60))) + "\n"
        table = tabulate(text.encode())
        for index, line in enumerate(text.split("\n")[:-1]):
            expected = plainly_read(line)
            assert table.plain[index] == (expected is not None), (text, line)
            if expected is not None:
                column = table.values[:, index].tolist()
                read = {letter: value for letter, value in zip(LETTERS, column, strict=True) if value == value}
                assert {k: repr(v) for k, v in read.items()} == {k: repr(v) for k, v in expected.items()}
                assert text.encode()[table.starts[index] : table.starts[index + 1] - 1].decode() == line


LOOPS = """G21 G90 F600
o100 sub
#3=[#1*2]
#<r>=#2
o101 if [#<r> GT 5]
G1 X[#3] Y#2
o101 elseif [#<r> EQ 3]
G0 Z[#<r>]
o101 else
G1 X[#3+1]
o101 endif
o100 endsub [#3]
#<_total>=0
#1=0 #40=7
o102 while [#1 LT 60]
(a pass)
o100 call [#1] [#1 MOD 9]
#<_total>=[#<_total>+#<_value>]
#40=[SQRT[#1]+ATAN[#1]/[2]-#1**2/10]
G1 Y[#40+SIN[#1]] F[100+#1]
o103 repeat [#1 MOD 3]
G0 X-[#1]
o103 endrepeat
#1=[#1+1]
o102 endwhile
(debug, #1 #40 #<_total>)
G1 X[#40] Y[#1]
M2
"""


@pytest.mark.parametrize(
    "text",
    [
        "F100\n#1=0\no1 while [#1 lt 80]\no2 if [#1 gt 40]\no3 if [#<nix>]\nG1 X#1\no3 endif\no2 endif\n"
        "#1=[#1+1]\no1 endwhile\nM2\n",
        LOOPS.replace("#<_total>=[#<_total>+#<_value>]\n", ""),
        LOOPS,
        "F100\n#1=0\no1 while [#1 lt 500]\nG1 X[#1/3] Y[COS[#1]]\n#1=[#1+1]\no1 endwhile\nM2\n",
        "F100\n#1=0\no1 while [#1 lt 80]\nG1 X[9/[50-#1]]\n#1=[#1+1]\no1 endwhile\nM2\n",
        "F100\n#1=0\no1 while [#1 lt 80]\no2 if [#1 gt 40]\nG1 X#<nix>\no2 endif\n#1=[#1+1]\no1 endwhile\nM2\n",
        "F100\nG91\n#1=0\no1 while [#1 lt 300]\nX[#1] A1\no2 if [#1 gt 200]\no1 break\no2 endif\n"
        "#1=[#1+1]\no1 endwhile\nM2\n",
    ],
)
def test_compiled_loops_equal_lines(text, slowly):
    text = text.replace("X[#1] A1", "G1 X[#1] A1", 1)
    fast, slow = interpret(text), slowly(text)
    assert fast.commands == slow.commands
    assert fast.diagnostics == slow.diagnostics


MACRO = """G21 G90 F600
#1=0
#2=3
G1 X0
WHILE [#1 LT 200] DO1
#3=#1*2-SIN[#1]
IF [#3 GT 100] THEN #2=#2+1
WHILE [#5 LT 3] DO2
#5=#5+1
G1 Y[#5*#2]
END2
#5=0
G1 X[#3] Z[#2/2]
#1=#1+1
END1
G1 X#1
M30
"""


@pytest.mark.parametrize(
    "text",
    [
        MACRO,
        MACRO.replace("#3=#1*2-SIN[#1]", "#3=#1*2-SIN[#1]/[150-#1]"),
        MACRO.replace("#5=0\nG1", "#5=#0\nG1"),
        MACRO.replace("#1=#1+1", "#1=#1+1\nIF [#1 EQ 90] THEN #8=#9\nIF [#1 GT 170] THEN #8=1\nIF [#8] THEN #2=0"),
        MACRO.replace("#1=#1+1", "#1=#1+1\nIF [#1 EQ 90] THEN #2=#9"),
        MACRO.replace("G1 X[#3]", "G1 X[#3] Y#7"),
        MACRO.replace("END1", "IF [#1 EQ 150] GOTO 20\nEND1\nN20"),
        MACRO.replace("G1 X0\n", "G66 P8\nG1 X0\n").replace("M30\n", "G67\nM30\nO8\nG0 Z9\nM99\n"),
    ],
    ids=["plain", "division", "vacant", "stays vacant", "becomes vacant", "vacant word", "goto", "modal macro"],
)
def test_compiled_macro_loops_equal_lines(text, slowly):
    fast, slow = interpret(text, Setup(dialect="fanuc")), slowly(text, dialect="fanuc")
    assert fast.commands == slow.commands
    assert fast.diagnostics == slow.diagnostics
    assert len(slow.commands) > 400


@pytest.mark.parametrize("text", [MACRO, MACRO.replace("#2=#2+1", "#8=#2")])
def test_a_macro_loop_is_compiled(text):
    run = gcode.run.Run(text, Setup(dialect="fanuc"))
    assert any(isinstance(item, MoveBlock) for item in run.stream())


@pytest.mark.parametrize(
    ("dialect", "text"),
    [
        ("fanuc", "#1=5\nN10 G1 X#1 F100\n#1=#1-Q1\nIF [#1 GT 0] GOTO 10\nG1 X5 I1\nG5X1\nM30\n"),
        ("linuxcnc", "#1=5 F100\no1 while [#1 GT 0]\nG1 X#1\n#1=[#1-Q1]\no1 endwhile\nG1 X\nG1 Y1 Y2\nM2\n"),
        (
            "linuxcnc",
            "F100\no9 sub\n#31=[#31-Q1]\no8 do\nG0 X1\no8 while [#31 GT 0]\no9 endsub\n#31=3\no9 call\nG1 X\nM2\n",
        ),
    ],
)
def test_a_loop_that_lost_its_end_to_an_error_does_not_hide_the_errors_behind_it(dialect, text):
    errors = interpret(text, Setup(dialect=dialect)).errors
    lines = text.split("\n")
    assert {lines[error.line - 1] for error in errors} >= {
        line for line in lines if "Q1" in line or line in {"G1 X", "G1 Y1 Y2", "G5X1"}
    }
    assert "GC089" not in {error.code for error in errors}


def test_shapes_equal_lines(slowly):
    rng = np.random.default_rng(9)
    lines = ["G21 G90 F100", "#1=2.5"]
    for n in range(600):
        a, b = rng.uniform(-20, 20, 2)
        lines.append(
            f"G1 X[{a:.3f}+#1*{b:.2f}] Y[SIN[{n}]*{abs(b):.3f}/2]" if n % 3 else f"#1=[{a:.4f}/{abs(b) + 1:.2f}]"
        )
        if n % 97 == 0:
            lines += [f"N{n} X-[#1] Z[2**{n % 5}]", "G91", "G0 X[#1]", "G90", "G1 X[1/0]"]
    text = "\n".join([*lines, "M2", ""])
    fast, slow = interpret(text), slowly(text)
    assert fast.diagnostics == slow.diagnostics
    assert fast.commands == slow.commands


def test_a_shape_may_bring_an_axis_back_to_zero(slowly):
    text = "G21 G90 F500\nG0 X1 B0.01\nG0 X0\nG0 X0 B#101\nM2\n"
    assert interpret(text).commands == slowly(text).commands


def test_a_file_is_read_piece_by_piece(tmp_path):
    path = tmp_path / "long.nc"
    path.write_text(cam(40_000, 3))
    run = FileRun(path)
    rows = sum(len(item) if isinstance(item, MoveBlock) else 0 for item in run)
    assert rows > 10_000
    assert {diagnostic.code for diagnostic in run.diagnostics} == {"GC216"}
    assert path.stat().st_size > 2 * gcode.textsource.CHUNK_BYTES


@pytest.mark.parametrize("end", ["\r\n", "\r", "\n"])
def test_line_ends_do_not_matter(end, tmp_path):
    text = cam(300, 11)
    path = tmp_path / "p.nc"
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", end).encode())
    from gcode.expand import expanded

    assert list(expanded(FileRun(path))) == interpret(text).commands
