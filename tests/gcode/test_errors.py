"""Diagnostics: all errors of a file, each with its place, caret, code and hint; JSON with the agreed fields."""

import json

import pytest

from gcode.canon import Feed
from gcode.interp import interpret
from gcode.setup import Setup

FIVE = """G21 G90
G1 X1
F100
G1 X1,5
G2 X10 Y0 I3 J0
G1 X[SNI[30]]
M75
G90.5
M2
"""


def places(text):
    return [(d.line, d.column, d.code) for d in interpret(text).errors]


def test_every_mistake_of_a_file_is_found_in_one_pass():
    assert places(FIVE) == [
        (2, 1, "GC040"),
        (4, 6, "GC001"),
        (5, 11, "GC044"),
        (6, 6, "GC007"),
        (7, 1, "GC011"),
        (8, 1, "GC010"),
    ]


def test_nothing_is_commanded_after_the_first_error():
    commands = interpret("G21\nG0 X1\nG1 X2\nG0 X3\nM2\n").commands
    assert max(command.line for command in commands) == 2


def test_text_shows_the_line_with_a_caret_and_the_hint():
    diagnostic = interpret("F100\nG1 X[SNI[30]]\nM2\n", Setup(file="part.nc")).errors[0]
    assert diagnostic.text("G1 X[SNI[30]]").splitlines() == [
        "part.nc:2:6: error GC007: unknown function SNI",
        "    G1 X[SNI[30]]",
        "         ^^^",
        "    hint: did you mean SIN?",
    ]


def test_json_is_one_object_with_the_agreed_keys():
    diagnostic = interpret("M75\nM2\n", Setup(file="part.nc")).errors[0]
    record = json.loads(diagnostic.as_json())
    assert list(record) == ["file", "line", "column", "end_column", "code", "severity", "message", "hint"]
    assert (record["line"], record["column"], record["end_column"]) == (1, 1, 4)


def test_a_missing_feed_is_reported_once():
    assert places("G1 X1\nG1 X2\nX3\nM2\n") == [(1, 1, "GC040")]


def test_an_arc_after_a_broken_line_is_not_blamed():
    assert places("F100\nG1 X10 Y1O\nG2 X20 Y10 I5 J0\nM2\n") == [(2, 10, "GC001")]


def test_a_program_without_end_is_warned_of():
    assert [(d.code, d.severity) for d in interpret("G0 X1\n").diagnostics] == [("GC201", "warning")]


def test_what_is_not_supported_is_refused_with_its_place():
    assert places("G81 X1 Z-1 R1\nG42 D1\nM2\n")[0][:2] == (1, 1)


@pytest.mark.parametrize("line", ["G1 X1 ; ok", "g 1 x 1 y - 2"])
def test_what_only_looks_wrong_is_taken(line):
    result = interpret(f"G21 G90 G17 G94\nF100\nG0 X0 Y0 Z5\n{line}\nM2\n")
    assert result.diagnostics == []
    assert [c.end[:2] for c in result.commands if isinstance(c, Feed)] in ([(1.0, 0.0)], [(1.0, -2.0)])
