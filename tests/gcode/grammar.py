"""A grammar of programs for hypothesis: expressions, offsets, rotations, arcs, cycles, compensation, flow."""

import math

from hypothesis import strategies as st

LENGTH = st.integers(-4000, 4000).map(lambda n: n / 100)
SMALL = st.integers(1, 900).map(lambda n: n / 100)
ANGLE = st.integers(-720, 720).map(lambda n: n / 2)
PLANES = {"G17": ("X", "Y", "Z", "I", "J"), "G18": ("Z", "X", "Y", "K", "I"), "G19": ("Y", "Z", "X", "J", "K")}
SYSTEMS = st.sampled_from(["G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"])


def text(value):
    return f"{value:.6f}".rstrip("0").rstrip(".") if value else "0"


@st.composite
def expression(draw, depth=2):
    """A bracketed expression whose value is moderate, or a number."""
    kind = draw(st.integers(0, 9)) if depth else 0
    if kind <= 1:
        return text(draw(LENGTH))
    if kind == 2:
        return f"#{draw(st.integers(101, 104))}"
    a = draw(expression(depth - 1))
    b = draw(expression(depth - 1))
    if kind <= 4:
        return f"[{a} {draw(st.sampled_from(['+', '-']))} {b}]"
    if kind == 5:
        return f"[{a} / {text(draw(SMALL))}]"
    if kind == 6:
        return f"[{draw(st.sampled_from(['SIN', 'COS']))}[{a}] * {text(draw(SMALL))}]"
    if kind == 7:
        return f"[{draw(st.sampled_from(['FIX', 'FUP', 'ROUND', 'ABS']))}[{a}]]"
    if kind == 8:
        return f"[ATAN[{a}]/[{b}] / 10]"
    compare = draw(st.sampled_from(["LT", "GT", "LE", "GE"]))
    return f"[[{a} {compare} {b}] * {text(draw(SMALL))} + [{a} MOD {text(draw(SMALL))}]]"


@st.composite
def axis_words(draw, axes="XYZ", least=1):
    chosen = draw(st.lists(st.sampled_from(axes), min_size=least, max_size=len(axes), unique=True))
    return " ".join(f"{axis}{draw(expression(1))}" for axis in chosen)


@st.composite
def straight(draw):
    axes = draw(st.sampled_from(["XYZ", "XYZ", "XYZABC"]))
    return [f"{draw(st.sampled_from(['G0', 'G1', '', 'G1']))} {draw(axis_words(axes))}".strip()]


@st.composite
def polar(draw):
    return [
        "G17",
        "G90",
        f"G0 X{text(draw(SMALL))} Y{text(draw(SMALL))}",
        f"G1 @{text(draw(SMALL))} ^{text(draw(ANGLE))}",
        f"G1 ^{text(draw(ANGLE))}",
    ]


@st.composite
def arc(draw):
    """An incremental arc with a good centre, in any plane, with or without helix and turns."""
    plane = draw(st.sampled_from(list(PLANES)))
    one, two, three, i, j = PLANES[plane]
    radius = draw(SMALL)
    start, sweep = draw(ANGLE), draw(st.integers(1, 359))
    a0, a1 = math.radians(start), math.radians(start + sweep)
    da, db = radius * (math.cos(a1) - math.cos(a0)), radius * (math.sin(a1) - math.sin(a0))
    ci, cj = -radius * math.cos(a0), -radius * math.sin(a0)
    code = draw(st.sampled_from(["G2", "G3"]))
    helix = f" {three}{text(draw(LENGTH))}" if draw(st.booleans()) else ""
    turns = f" P{draw(st.integers(1, 3))}" if draw(st.booleans()) else ""
    kind = draw(st.integers(0, 3))
    if kind == 0:
        words = f"{i}{text(ci)} {j}{text(cj)}"
    elif kind == 1:
        half = math.hypot(da, db) / 2
        size = max(half * 1.001, radius)
        sign = draw(st.sampled_from(["", "-"]))
        words = f"{one}{da:.6f} {two}{db:.6f} R{sign}{size + 1e-4:.6f}"
    else:
        words = f"{one}{da:.6f} {two}{db:.6f} {i}{ci:.6f} {j}{cj:.6f}"
    return [plane, f"G91 {code} {words}{helix}{turns}", draw(st.sampled_from(["G90", "G90", "G91"]))]


@st.composite
def offset(draw):
    kind = draw(st.integers(0, 9))
    words = draw(axis_words("XYZABC" if kind % 2 else "XYZ"))
    if kind == 0:
        return [f"G92 {words}"]
    if kind == 1:
        return [f"G52 {words}"]
    if kind == 2:
        return [draw(st.sampled_from(["G92.1", "G92.2", "G92.3"]))]
    if kind in {3, 4}:
        return [
            f"G10 L2 P{draw(st.integers(0, 9))} {words}" + (f" R{text(draw(ANGLE))}" if draw(st.booleans()) else "")
        ]
    if kind == 5:
        return [f"G10 L20 P{draw(st.integers(0, 9))} {words}"]
    if kind == 6:
        return [f"G43.1 Z{text(draw(LENGTH))}" + (f" X{text(draw(LENGTH))}" if draw(st.booleans()) else "")]
    if kind == 7:
        return [draw(st.sampled_from(["G49", "G43 H1", "G43 H2", "G43 H3"]))]
    return [draw(SYSTEMS)]


MODES = [
    *("G90", "G91", "G17", "G18", "G19", "G98", "G99", "G61", "G61.1", "G64", "G64 P0.05", "G64 P0.1 Q0.02"),
    *("G49;G20 F20", "G49;G21 F300"),
]
"""The stand-alone oracle does not convert a tool offset when the unit changes, so there is none then."""


@st.composite
def modes(draw):
    return draw(st.sampled_from(MODES)).split(";")


@st.composite
def reference(draw):
    kind = draw(st.integers(0, 4))
    if kind == 0:
        return ["G90", f"G53 G0 {draw(axis_words())}"]
    if kind == 1:
        return [draw(st.sampled_from(["G28.1", "G30.1"]))]
    words = draw(axis_words()) if draw(st.booleans()) else ""
    return [f"{draw(st.sampled_from(['G28', 'G30']))} {words}".strip()]


@st.composite
def cycle(draw):
    plane = draw(st.sampled_from(list(PLANES)))
    one, two, three, _, _ = PLANES[plane]
    code = draw(st.sampled_from(["G81", "G82", "G83", "G73", "G85", "G86", "G89", "G84"]))
    r, depth = draw(SMALL), draw(SMALL)
    incremental = draw(st.booleans())
    bottom = f"-{text(depth)}" if incremental else text(r - depth)
    words = f"{one}{text(draw(LENGTH))} {two}{text(draw(LENGTH))} {three}{bottom} R{text(r)}"
    extra = {
        "G82": " P0.5",
        "G83": f" Q{text(depth / 2.5)}",
        "G73": f" Q{text(depth / 3.2)}",
        "G86": " P1",
        "G89": " P0.2",
    }.get(code, "")
    repeats = f" L{draw(st.integers(1, 3))}" if draw(st.booleans()) else ""
    lines = [plane, "G91" if incremental else "G90", "M3", f"{code} {words}{extra}{repeats}"]
    lines += [f"{one}{text(draw(LENGTH))}" for _ in range(draw(st.integers(0, 2)))]
    return [*lines, draw(st.sampled_from(["G80", "G80", "G0 Z30"])), "G90"]


@st.composite
def compensation(draw):
    """A ring of straight moves and arcs with G41 or G42; corners may be too tight, then both must refuse."""
    count = draw(st.integers(3, 7))
    radii = [draw(st.integers(20, 60)) for _ in range(count)]
    points = [
        (r * math.cos(2 * math.pi * n / count), r * math.sin(2 * math.pi * n / count)) for n, r in enumerate(radii)
    ]
    if draw(st.booleans()):
        points.reverse()
    code = draw(st.sampled_from(["G41.1", "G42.1"]))
    diameter = draw(st.sampled_from([0.5, 1, 2, 6]))
    lines = ["G49", "G40 G17 G90 G21 F300", "G92.1", "G0 X-90 Y-80", f"{code} D{diameter}"]
    for n, (x, y) in enumerate(points):
        if n and draw(st.integers(0, 3)) == 0:
            px, py = points[n - 1]
            chord = math.hypot(x - px, y - py)
            size = chord * draw(st.sampled_from([0.6, 0.8, 1.5]))
            lines.append(f"{draw(st.sampled_from(['G2', 'G3']))} X{x:.4f} Y{y:.4f} R{size:.4f}")
        else:
            lines.append(f"G1 X{x:.4f} Y{y:.4f}" + (f" Z{text(draw(LENGTH))}" if draw(st.integers(0, 4)) == 0 else ""))
    return [*lines, "G40", "G0 X-95 Y-95"]


@st.composite
def inverse_time(draw):
    return [
        "G93",
        f"G1 {draw(axis_words())} F{draw(st.integers(1, 20))}",
        f"{draw(axis_words())} F{draw(st.integers(1, 20))}",
        "G94 F200",
    ]


@st.composite
def flow(draw):
    label = draw(st.integers(100, 999))
    count = draw(st.integers(0, 4))
    body = draw(straight())
    kind = draw(st.integers(0, 3))
    if kind == 0:
        return ["#105=0", f"o{label} while [#105 LT {count}]", *body, "#105=[#105+1]", f"o{label} endwhile"]
    if kind == 1:
        return [f"o{label} repeat [{count}]", *body, f"o{label} endrepeat"]
    if kind == 2:
        return [
            f"o{label} if [#101 GT {text(draw(LENGTH))}]",
            *body,
            f"o{label} else",
            *draw(straight()),
            f"o{label} endif",
        ]
    return ["#105=0", f"o{label} do", *body, "#105=[#105+1]", f"o{label} while [#105 LT {count}]"]


@st.composite
def assignment(draw):
    return [f"#{draw(st.integers(101, 104))}={draw(expression())}"]


@st.composite
def program(draw):
    """A whole program. Labels are made unique, for LinuxCNC wants it so."""
    parts = st.one_of(
        straight(),
        straight(),
        arc(),
        arc(),
        offset(),
        offset(),
        modes(),
        reference(),
        cycle(),
        compensation(),
        inverse_time(),
        flow(),
        assignment(),
        polar(),
    )
    blocks = draw(st.lists(parts, min_size=3, max_size=14))
    lines = ["G21 G90 G17 G94 F500 S1000 M3", "G0 X1 Y2 Z3"]
    for number, block in enumerate(blocks):
        for line in block:
            head, _, rest = line.partition(" ")
            lines.append(f"{head}{number:02d} {rest}" if head.startswith("o") else line)
    return "\n".join([*lines, "M2", ""])
