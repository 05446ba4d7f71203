"""Cutter compensation that trims: the tool never comes nearer to the programmed contour than its radius."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcode.canon import Arc, Coolant, Feed, Message, Rapid, Stop
from gcode.interp import interpret
from gcode.setup import Setup

TRIM = Setup(trim_concave=True)
GOUGE_MM = 1e-6


def program(code, diameter, lines, start=(-90.0, -80.0)):
    head = f"G21 G17 G90 F100\nG0 X{start[0]:.6f} Y{start[1]:.6f} Z5\n{code} D{diameter}\n"
    return head + "\n".join(lines) + "\nG40\nG0 Z50\nM2\n"


def moves(result):
    """(start, command) of every move in the plane."""
    at, found = None, []
    for command in result.commands:
        if isinstance(command, Rapid | Feed | Arc):
            if at is not None:
                found.append((at, command))
            at = command.end
    return found


def samples(start, command, count=400):
    """Points f8[count, 2] along a move."""
    u = np.linspace(0.0, 1.0, count)
    a, b = np.array(start[:2]), np.array(command.end[:2])
    if not isinstance(command, Arc):
        return a + u[:, None] * (b - a)
    c = np.array(command.center)
    begin = math.atan2(*(a - c)[::-1])
    sweep = math.atan2(*(b - c)[::-1]) - begin
    if command.turns > 0:
        sweep = sweep % (2 * math.pi) or 2 * math.pi
    else:
        sweep = -((-sweep) % (2 * math.pi) or 2 * math.pi)
    sweep += math.copysign(2 * math.pi * (abs(command.turns) - 1), command.turns)
    r = np.hypot(*(a - c)) + u * (np.hypot(*(b - c)) - np.hypot(*(a - c)))
    angle = begin + u * sweep
    return c + np.column_stack((r * np.cos(angle), r * np.sin(angle)))


def distance(points, start, command):
    """The least distance of ``points`` from a programmed move."""
    a, b = np.array(start[:2]), np.array(command.end[:2])
    if not isinstance(command, Arc):
        d = b - a
        part = np.clip((points - a) @ d / (d @ d or 1.0), 0.0, 1.0)
        return np.hypot(*(points - a - part[:, None] * d).T).min()
    c = np.array(command.center)
    sign = math.copysign(1.0, command.turns)
    begin = math.atan2(*(a - c)[::-1])
    full = (sign * (math.atan2(*(b - c)[::-1]) - begin)) % (2 * math.pi) or 2 * math.pi
    full = 2 * math.pi if abs(command.turns) > 1 else full
    out = points - c
    turned = (sign * (np.arctan2(out[:, 1], out[:, 0]) - begin)) % (2 * math.pi)
    ends = np.minimum(np.hypot(*(points - a).T), np.hypot(*(points - b).T))
    return np.where(turned <= full, np.abs(np.hypot(*out.T) - np.hypot(*(a - c))), ends).min()


def clearance(text, result):
    """The least distance of the compensated path from the contour, both without entry and exit."""
    plain = "\n".join("" if line.startswith(("G41", "G42")) else line for line in text.split("\n"))
    contour = [m for m in moves(interpret(plain)) if m[0][:2] != m[1].end[:2]]
    first, last = text.split("\n").index("G40"), 0
    lines = [number for number, line in enumerate(text.split("\n"), 1) if line.startswith(("G41", "G42"))]
    entry = lines[0] + 1
    contour = [m for m in contour if entry < m[1].line <= first]
    path = [m for m in moves(result) if entry <= m[1].line <= first + last]
    return min((distance(samples(*m), *c) for m in path for c in contour), default=math.inf)


@st.composite
def contours(draw):
    """Lines and arcs around a part, in a pocket or along a zigzag, with corners too tight for the larger tools."""
    count = draw(st.integers(3, 9))
    kind = draw(st.sampled_from(["part", "pocket", "zigzag"]))
    code = draw(st.sampled_from(["G41.1", "G42.1"]))
    if kind == "zigzag":
        step = draw(st.sampled_from([1.0, 3.0, 10.0]))
        points = [(n * step, draw(st.integers(-20, 20))) for n in range(count)]
        start = (-40.0, points[0][1])
    else:
        radii = [draw(st.integers(12, 60)) for _ in range(count)]
        points = [
            (r * math.cos(2 * math.pi * n / count), r * math.sin(2 * math.pi * n / count)) for n, r in enumerate(radii)
        ]
        start = (0.1, 0.2) if kind == "pocket" else (3.0 * points[0][0], 3.0 * points[0][1] - 9.0)
        if code == ("G42.1" if kind == "pocket" else "G41.1"):  # the tool belongs on the other side: turn round
            points = [points[0], *points[:0:-1]]
        points.append(points[0])
    lines = []
    for n, (x, y) in enumerate(points):
        shape = draw(st.integers(0, 5)) if n else 0
        px, py = points[n - 1]
        chord = math.hypot(x - px, y - py)
        rise = f" Z{draw(st.integers(-3, 3))}" if draw(st.integers(0, 4)) == 0 else ""
        if shape >= 4 and chord:
            size = chord * draw(st.sampled_from([0.501, 0.6, 0.8, 1.5]))
            sign = draw(st.sampled_from(["", "-"]))
            lines.append(f"{draw(st.sampled_from(['G2', 'G3']))} X{x:.9f} Y{y:.9f}{rise} R{sign}{size:.9f}")
        else:
            lines.append(f"{'G0' if shape == 3 else 'G1'} X{x:.9f} Y{y:.9f}{rise}")
    return program(code, draw(st.sampled_from([0.5, 2, 6, 14])), lines, start)


@settings(max_examples=150, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(contours())
def test_the_tool_never_cuts_into_the_contour(text):
    result = interpret(text, TRIM)
    codes = {d.code for d in result.errors}
    assert codes <= {"GC091", "GC092", "GC094"}, [d.text() for d in result.errors]
    if not codes:
        diameter = float(text.split("D")[1].split("\n")[0])
        assert clearance(text, result) >= diameter / 2 - GOUGE_MM


def path(text, setup=TRIM):
    result = interpret(text, setup)
    assert not result.errors, [d.text() for d in result.errors]
    return result, [(c.line, *(round(v, 4) + 0.0 for v in c.end[:3])) for c in moves_of(result)]


def moves_of(result):
    return [c for c in result.commands if isinstance(c, Rapid | Feed | Arc)][1:-1]


POCKET = ["G1 X20 Y0", "Y20", "X-20", "Y-20", "X20", "Y0"]


def test_a_pocket_that_fits_is_followed_as_ever():
    text = program("G41.1", 6, POCKET, (0.0, 0.0))
    _, trimmed = path(text)
    _, plain = path(text, Setup())
    assert trimmed[1:] == plain[1:]
    assert trimmed[1:] == [(5, 17, 17, 5), (6, -17, 17, 5), (7, -17, -17, 5), (8, 17, -17, 5), (9, 17, 0, 5)]


NOTCH = ["G1 X0 Y0", "X20 Z-1", "Y-2", "X22", "Y0 Z-2", "X40", "Y-30"]


def test_a_notch_that_is_too_narrow_is_left_out_with_a_warning():
    text = program("G41.1", 6, NOTCH, (-20.0, 0.0))
    result, ends = path(text)
    assert [end for end in ends if end[0] > 4][1:4] == [(5, 20, 3, -1), (6, 21, 2.8284, -1), (9, 22, 3, -2)]
    assert [(d.code, d.line) for d in result.diagnostics] == [("GC219", 11)]
    assert "between line 5 and line 9" in result.diagnostics[0].message
    assert clearance(text, result) >= 3 - GOUGE_MM
    assert [d.code for d in interpret(text).errors] == ["GC092"]


def test_the_tool_does_not_pass_a_neck_it_does_not_fit_through():
    bell = ["G1 X20 Y-10", "X20 Y10", "X2 Y10", "Y2", "X-2", "Y10", "X-20", "Y-10", "X-2", "Y-2", "X2", "Y-10", "X20"]
    text = program("G41.1", 8, bell, (10.0, -2.0))
    result, ends = path(text)
    assert min(x for _, x, _, _ in ends) > 0
    assert [d.code for d in result.diagnostics] == ["GC219"]
    assert clearance(text, result) >= 4 - GOUGE_MM


def test_an_arc_smaller_than_the_tool_is_left_out():
    text = program("G41.1", 6, ["G1 X0 Y0", "X10", "G3 X14 Y0 R2", "G1 X30"], (-20.0, 0.0))
    result, ends = path(text)
    assert [end[:3] for end in ends if end[0] == 6] == [(6, 12, 2.2361)]  # round the first corner, up to the second
    assert [d.code for d in result.diagnostics] == ["GC219"]
    assert clearance(text, result) >= 3 - GOUGE_MM


def test_circles_of_several_turns_are_kept():
    text = program("G41.1", 6, ["G1 X10 Y0", "G3 X10 Y0 Z-3 I-10 J0 P3"], (2.0, -2.0))
    result, _ = path(text)
    arcs = [c for c in result.commands if isinstance(c, Arc)]
    assert sum(abs(c.turns) for c in arcs) == 3
    assert arcs[-1].end[:3] == pytest.approx((7, 0, -3))
    assert clearance(text, result) >= 3 - GOUGE_MM


def test_what_stands_between_the_moves_stays_there():
    lines = [*NOTCH[:2], "M8", "(MSG, notch)", *NOTCH[2:5], "M0", "M9", *NOTCH[5:]]
    result, _ = path(program("G41.1", 6, lines, (-20.0, 0.0)))
    kinds = (Rapid, Feed, Arc, Stop, Coolant, Message)
    order = [(type(c).__name__, c.line) for c in result.commands if isinstance(c, kinds)]
    at = order.index(("Coolant", 6))
    assert order[at - 1] == ("Feed", 5)
    assert order[at + 1] == ("Message", 7)
    stop = order.index(("Stop", 11))
    assert order[stop + 1] == ("Coolant", 12)
    assert max(line for _, line in order[:stop]) < 11 < order[stop + 2][1]


def test_moves_in_place_happen_where_the_tool_is():
    text = program("G41.1", 6, ["G1 X0 Y0", "X20", "Z-1", "Y20", "Z0", "X30"], (-20.0, 0.0))
    result, ends = path(text)
    assert (6, 17, 3, -1) in ends
    assert clearance(text, result) >= 3 - GOUGE_MM


def test_a_rapid_goes_round_a_corner_outside_the_arc():
    text = program("G41.1", 6, ["G1 X0 Y0", "X20", "G0 Y-30"], (-20.0, 0.0))
    result, ends = path(text)
    round_ = [end for end in ends if end[0] == 6]
    assert len(round_) > 10
    assert all(isinstance(c, Rapid) for c in moves_of(result) if c.line == 6)
    assert clearance(text, result) >= 3 - GOUGE_MM


def test_it_works_in_inches_and_on_a_lathe():
    inch = "G20 G17 G90 F10\nG0 X-1 Y0\nG41.1 D0.25\n" + "\n".join(
        ["G1 X0 Y0", "X1", "Y-.1", "X1.1", "Y0", "X2", "G40", "G0 Z3", "M2"]
    )
    result = interpret(inch, TRIM)
    assert [d.code for d in result.diagnostics] == ["GC219"]
    assert clearance(inch, result) >= 25.4 / 8 - GOUGE_MM
    lathe = "G21 G18 G90 F100\nG0 X10 Z5\nG42.1 D0.8 L2\nG1 X5 Z0\nZ-10\nX5.1\nZ-10.1\nX5\nZ-20\nX20\nG40\nG0 X30\nM2\n"
    assert not interpret(lathe, TRIM).errors


@pytest.mark.parametrize(
    ("lines", "start", "code", "words"),
    [
        (["G1 X5 Y0", "X9", "Y-1", "X0"], (1.0, -2.0), "GC091", "nearer to the contour"),
        (["G1 X0 Y0", "X20", "Y20", "X-30", "Y-10", "X-10"], (-50.0, 0.0), "GC092", "line 4 cuts into the contour"),
        (["G1 X1 Y0"], (0.0, 0.0), "GC091", "not longer than the tool radius"),
    ],
)
def test_what_trimming_cannot_help_is_refused(lines, start, code, words):
    [error] = interpret(program("G41.1", 6, lines, start), TRIM).errors
    assert error.code == code
    assert words in error.message


def test_units_cannot_change_inside():
    assert [d.code for d in interpret(program("G41.1", 6, ["G1 X20 Y0", "G20"])).errors] == ["GC090"]
    assert not interpret(program("G41.1", 6, ["G1 X20 Y0", "G21"])).errors


def test_the_number_of_moves_is_bounded(monkeypatch):
    from gcode import trimming

    monkeypatch.setattr(trimming, "MOST_MOVES", 5)
    [error] = interpret(program("G41.1", 1, [f"G1 X{n}" for n in range(10)]), TRIM).errors
    assert error.code == "GC092"
    assert "more than 5 moves" in error.message
