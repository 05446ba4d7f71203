"""Six reference jobs for planning, as G-code text: the same text always."""

from __future__ import annotations

import math
import random
from collections.abc import Callable

HEAD = ["G21", "G90", "G17", "G94", "G54"]
TAIL = ["G0 Z5", "G0 X0 Y0", "M2"]

LIMIT_II_S = {"a": 135.23, "b": 95.35, "c": 85.75, "d": 77.74, "e": 461.6, "f": 71.55}
"""Second-order optimum with corners blended within 0.010 mm by legs of at most half a segment, found on a very fine
grid."""


def _n(value: float) -> str:
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def pocket() -> list[str]:
    """Zig-zag pocket 100 x 60 mm, stepover 2, two levels."""
    out = ["G0 Z5", "G0 X10 Y10"]
    for z in (-1, -2):
        out += ["G0 X10 Y10", f"G1 Z{z} F600", "F3600"]
        y, x = 10, 10
        while True:
            x = 110 if x == 10 else 10
            out.append(f"G1 X{x}")
            if y >= 70:
                break
            y += 2
            out.append(f"G1 Y{y}")
        out += ["G1 X10 Y70", "G1 X10 Y10", "G1 X110 Y10", "G1 X110 Y70", "G0 Z5"]
    return out


def arcs() -> list[str]:
    """Three scalloped rings of tangent arcs, circles of radius 1 to 8, six rounded rectangles; three decimals."""
    out = ["G0 Z5"]
    cx = cy = 50.0
    for n, ring, r1, r2 in ((12, 40, 6, 5), (10, 28, 5, 4.5), (8, 16, 3.5, 3)):
        out += _scallops(cx, cy, n, ring, r1, r2)
    for r in (1, 2, 3, 5, 8):
        out += [f"G0 X{_n(cx + r)} Y{_n(cy)}", "G1 Z-1 F600", "F2400"]
        out += [f"G3 X{_n(cx - r)} Y{_n(cy)} I{_n(-r)} J0", f"G3 X{_n(cx + r)} Y{_n(cy)} I{_n(r)} J0", "G0 Z5"]
    for k in range(6):
        w, r = 96 - 3 * k, 1 + 1.5 * k
        x0, x1 = cx - w / 2, cx + w / 2
        out += [f"G0 X{_n(x0 + r)} Y{_n(x0)}", "G1 Z-1 F600", "F2400"]
        out += [f"G1 X{_n(x1 - r)}", f"G3 X{_n(x1)} Y{_n(x0 + r)} I0 J{_n(r)}"]
        out += [f"G1 Y{_n(x1 - r)}", f"G3 X{_n(x1 - r)} Y{_n(x1)} I{_n(-r)} J0"]
        out += [f"G1 X{_n(x0 + r)}", f"G3 X{_n(x0)} Y{_n(x1 - r)} I0 J{_n(-r)}"]
        out += [f"G1 Y{_n(x0 + r)}", f"G3 X{_n(x0 + r)} Y{_n(x0)} I{_n(r)} J0", "G0 Z5"]
    return out


def _scallops(cx: float, cy: float, n: int, ring: float, r1: float, r2: float) -> list[str]:
    """A closed ring of n convex lobes on radius ``ring`` and n concave arcs between them, all tangent."""
    h = math.pi / n
    b = ring * math.cos(h)
    outer = b + math.sqrt(b * b - (ring * ring - (r1 + r2) ** 2))
    joints = []
    for k in range(n):
        a1, a2, a3 = 2 * h * k, 2 * h * k + h, 2 * h * (k + 1)
        c1 = (cx + ring * math.cos(a1), cy + ring * math.sin(a1))
        c2 = (cx + outer * math.cos(a2), cy + outer * math.sin(a2))
        c3 = (cx + ring * math.cos(a3), cy + ring * math.sin(a3))
        share = r1 / (r1 + r2)
        t12 = tuple(p + (q - p) * share for p, q in zip(c1, c2, strict=True))
        t23 = tuple(q + (p - q) * r2 / (r1 + r2) for p, q in zip(c3, c2, strict=True))
        joints.append((t12, c2, t23, c3))
    out = [f"G0 X{_n(joints[0][0][0])} Y{_n(joints[0][0][1])}", "G1 Z-1 F600", "F2400"]
    for k, (t12, c2, t23, c3) in enumerate(joints):
        i, j = c2[0] - round(t12[0], 3), c2[1] - round(t12[1], 3)
        out.append(f"G2 X{_n(t23[0])} Y{_n(t23[1])} I{_n(i)} J{_n(j)}")
        following = joints[(k + 1) % n][0]
        i, j = c3[0] - round(t23[0], 3), c3[1] - round(t23[1], 3)
        out.append(f"G3 X{_n(following[0])} Y{_n(following[1])} I{_n(i)} J{_n(j)}")
    return [*out, "G0 Z5"]


def surface(segments: int = 20000, step: float = 0.2, pitch: float = 0.4) -> list[str]:
    """Spiral over a wavy dome, 20,000 G1 of about 0.2 mm, three decimals."""
    a = pitch / (2 * math.pi)
    out = ["G0 Z12", "G0 X50 Y50"]
    th = 2 * math.pi * 1.5

    def z(x: float, y: float) -> float:
        return 6 * math.exp(-((x - 50) ** 2 + (y - 50) ** 2) / 300.0) + 0.8 * math.sin(x / 5.0) * math.cos(y / 6.0)

    for k in range(segments + 1):
        r = a * th
        x, y = 50 + r * math.cos(th), 50 + r * math.sin(th)
        if k == 0:
            out += [f"G0 X{_n(x)} Y{_n(y)}", f"G1 Z{_n(z(x, y))} F600", "F3000"]
        else:
            out.append(f"G1 X{_n(x)} Y{_n(y)} Z{_n(z(x, y))}")
        dth = step / math.hypot(r, a)
        for _ in range(3):  # so that the chord in space is about the step
            r2 = a * (th + dth)
            x2, y2 = 50 + r2 * math.cos(th + dth), 50 + r2 * math.sin(th + dth)
            dth *= step / math.dist((x, y, z(x, y)), (x2, y2, z(x2, y2)))
        th += dth
    return [*out, "G0 Z12"]


def spiral() -> list[str]:
    """Square spiral, pitch 1, corners of 90 degrees."""
    out = ["G0 Z5", "G0 X20 Y20", "G1 Z-1 F600", "F3600"]
    x0, y0, x1, y1 = 20.0, 20.0, 80.0, 80.0
    while x1 - x0 > 0.5:
        out += [f"G1 X{_n(x1)}", f"G1 Y{_n(y1)}", f"G1 X{_n(x0)}"]
        y0 += 1
        out.append(f"G1 Y{_n(y0)}")
        x0 += 1
        x1 -= 1
        y1 -= 1
    return out


def pcb() -> list[str]:
    """140 traces of 3 to 9 short segments and 160 drills, many rapids and plunges."""
    draw = random.Random(42)
    out = ["G0 Z2", "G0 X5 Y5"]
    for _ in range(140):
        x, y = draw.uniform(5, 75), draw.uniform(5, 55)
        out += [f"G0 X{_n(x)} Y{_n(y)}", "G0 Z0.2", "G1 Z-0.1 F300", "F1200"]
        d = draw.randrange(8)
        for _ in range(draw.randint(3, 9)):
            d = (d + draw.choice((-1, 1, -2, 2))) % 8
            length = draw.choice((0.3, 0.5, 0.635, 1.27, 2.54, 3.81))
            x += length * math.cos(d * math.pi / 4)
            y += length * math.sin(d * math.pi / 4)
            out.append(f"G1 X{_n(x)} Y{_n(y)}")
        out.append("G0 Z2")
    for _ in range(160):
        x, y = 5 + 2.54 * draw.randrange(28), 5 + 2.54 * draw.randrange(20)
        out += [f"G0 X{_n(x)} Y{_n(y)}", "G0 Z0.2", "G1 Z-1.8 F300", "G0 Z2"]
    return out


def relief() -> list[str]:
    """Relief raster, 19,000 G1 of 0.05 mm; Z acceleration is the limit, not the feed."""
    out = ["G0 Z5", "G0 X10 Y10"]

    def z(x: float, y: float) -> float:
        return -1 + 0.5 * math.sin(2 * math.pi * x / 4 + y) + 0.2 * math.sin(2 * math.pi * x / 7.3)

    for k in range(12):
        y = 10 + 0.5 * k
        xs = [10 + 0.05 * i for i in range(1601)]
        if k % 2:
            xs.reverse()
        if k == 0:
            out += [f"G1 Z{_n(z(xs[0], y))} F600", "F3000"]
        else:
            out.append(f"G1 Y{_n(y)} Z{_n(z(xs[0], y))}")
        out += [f"G1 X{_n(x)} Z{_n(z(x, y))}" for x in xs[1:]]
    return out


JOBS: dict[str, Callable[[], list[str]]] = {
    "a": pocket, "b": arcs, "c": surface, "d": spiral, "e": pcb, "f": relief,
}  # fmt: skip


def text(job: str, repeat: int = 1) -> str:
    """The G-code of job "a" to "f"; ``repeat`` repeats its body."""
    return "\n".join(HEAD + JOBS[job]() * repeat + TAIL) + "\n"
