"""Hostile input: any text gives diagnostics with a place inside the file, never an exception."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcode.dialects import NAMES
from gcode.interp import interpret
from gcode.setup import Setup

LINES = sorted({line for path in (Path(__file__).parent.parent / "goldens" / "canon").glob("*.ngc")
                for line in path.read_text().splitlines() if line.strip()})  # fmt: skip
SIGNS = st.sampled_from(list("GMXYZFIJKRPQLNOT#<>[]()%;/*=+-.,$@^ \t\r\n0123456789eE\x00\x1a\ufeff\u2212é"))


def checked(text, dialect="linuxcnc"):
    result = interpret(text, Setup(dialect=dialect, max_steps=20_000))
    for diagnostic in result.diagnostics:
        assert diagnostic.line >= 0
        assert diagnostic.column >= 1
        assert diagnostic.end_column > diagnostic.column
        assert diagnostic.text("")
    return result


@settings(max_examples=150, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(st.text(SIGNS, max_size=60), st.sampled_from(NAMES))
def test_any_signs(text, dialect):
    checked(text, dialect)


@settings(max_examples=150, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(st.lists(st.tuples(st.sampled_from(LINES), st.integers(0, 30), SIGNS, st.booleans()), max_size=12))
def test_damaged_lines(damaged):
    lines = [line[:at] + sign + line[at + cut :] for line, at, sign, cut in damaged]
    checked("\n".join(lines))


@settings(max_examples=100, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(st.binary(max_size=80))
def test_any_bytes(data):
    checked(data.decode("latin-1"))


NASTY = {
    "nothing": "",
    "percent signs": "%\n%\n%\n%",
    "nulls": "\x00" * 100,
    "deep brackets": "G1 X" + "[" * 5000,
    "deep negation": "G1 X" + "-" * 200 + "1",
    "a long number": "G1 X" + "1" * 250,
    "a huge number": "G0 X1" + "0" * 240,
    "many words": "G1 " + "X1" * 120,
    "endless while": "o1 while [1]\no1 endwhile\nM2",
    "endless do": "o1 do\no1 while [1]\nM2",
    "endless repeat": "o1 repeat [1000000000]\nG91 G0 X1\no1 endrepeat\nM2",
    "negative repeat": "o1 repeat [-5]\no1 endrepeat\nM2",
    "self call": "o1 sub\no1 call\no1 endsub\no1 call\nM2",
    "mutual calls": "o1 sub\no2 call\no1 endsub\no2 sub\no1 call\no2 endsub\no1 call\nM2",
    "main that calls itself": "o1\nM98 P1\nM2",
    "jumping back": "N1 GOTO 1",
    "macro loop": "#1=0\nWHILE [#1 EQ 0] DO1\nEND1\nM30",
    "many repeats of a cycle": "F100 S1 M3\nG91 G81 X1 Y1 Z-1 R1 L1000000000\nM2",
    "tiny pecks": "F100 S1 M3\nG83 X0 Y0 Z-1000 R1 Q0.0000001\nM2",
    "a thread of no depth": "F100 S1 M3\nG76 P1 Z-10 I-1 J0.0000001 K5\nM2",
    "a thread with a great degression": "F100 S1 M3\nG76 P1 Z-10 I-1 J0.001 K500 R1e9\nG76 P1 Z-10 I-1 J1 K5 R900\nM2",
    "springs": "F100 S1 M3\nG76 P1 Z-10 I-1 J1 K5 H1000000000\nM2",
    "turns": "F100\nG2 I1 P1000000000\nM2",
    "overflow": "#1=1e300\n#2=[10**308*10]\nG0 X#2\nM2",
    "not a number": "#1=[[10**300]*[10**300]]\n#2=[#1-#1]\nG0 X#2\nM2",
    "parameter of itself": "#1=1\nG0 X####1\nM2",
    "negative parameter": "#-1=5\nM2",
    "name without end": "#<abc=5\nM2",
    "control Z": "G21\nG0 X1\nM2\x1agarbage",
    "bom": "\ufeffG21\r\nG0 X1\r\nM2\r\n",
    "carriage returns": "G21\rG0 X1\rM2\r",
    "commas": "G21\nG0 X1,5\nM2",
    "unclosed": "(((((\nM2",
    "an include that is a folder": "o<.> call\nM2",
    "a name with nulls": "o<a\x00b> call\nM2",
}


@pytest.mark.parametrize("name", NASTY)
@pytest.mark.parametrize("dialect", ["linuxcnc", "fanuc"])
def test_nasty_programs_end_with_words(name, dialect):
    checked(NASTY[name], dialect)
