"""A result against its baseline: what changed, where (line), by how much; causes before effects."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher

from groupstart.regress.baseline import Baseline
from groupstart.regress.case import Result
from groupstart.regress.motiontable import Row, read_rows

DIGESTS = "digests"
LINE_S, LINE_MM = "line_s", "line_mm"
SHOWN_CANON = 5


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing that changed. part: program, machine, plan, motion, exchanges, trace or verdict; line: 0 if none."""

    part: str
    what: str
    old: str
    new: str
    line: int = 0

    def text(self) -> str:
        """One line for people, with the amount where both are numbers."""
        place = f"line {self.line}: " if self.line else ""
        return (
            f"{place}{self.what}: {self.old or '(nothing)'} -> {self.new or '(nothing)'}{_amount(self.old, self.new)}"
        )


def differences(result: Result, baseline: Baseline | None, tolerance: Mapping[str, float]) -> list[Difference]:
    """Everything that is not as in the baseline, beyond the tolerances."""
    if baseline is None:
        return [Difference("program", "baseline", "(none: regress --update takes it)", "a result")]
    if result.fault or "fault" in baseline.fields:
        old = baseline.fields.get("fault", "ran")
        new = result.fault or "ran"
        return [] if old == new else [Difference("program", "fault", old, new)]
    found = list(_canon(result.canon, baseline.canon))
    found += _fields(result, baseline, tolerance)
    found += _motion(read_rows(result.rows), read_rows(baseline.rows), tolerance)
    order = ("program", "machine", "plan", "motion", "exchanges", "trace", "verdict")
    return sorted(found, key=lambda d: order.index(d.part))


def allowed(name: str, tolerance: Mapping[str, float]) -> float:
    """The tolerance of a field: by its whole name, or by any end of it such as ``contour_um.max`` or ``time_s``."""
    parts = name.split(".")
    for first in range(len(parts)):
        for last in (len(parts), len(parts) - 1):
            key = ".".join(parts[first:last])
            if key in tolerance:
                return tolerance[key]
    return 0.0


def _fields(result: Result, baseline: Baseline, tolerance: Mapping[str, float]) -> Iterator[Difference]:
    new = dict(result.fields)
    for name in {**baseline.fields, **new}:
        old_value, new_value = baseline.fields.get(name, ""), new.get(name, "")
        if old_value == new_value or (name.endswith(".digest") and tolerance.get(DIGESTS, 1.0) == 0.0):
            continue
        if not _within(old_value, new_value, allowed(name, tolerance)):
            yield Difference(name.split(".")[0], name, old_value, new_value)


def _within(old: str, new: str, most: float) -> bool:
    pairs = list(zip(_numbers(old), _numbers(new), strict=False))
    if most <= 0 or not pairs or re.sub(_NUMBER, "", old) != re.sub(_NUMBER, "", new):
        return False
    return all(abs(a - b) <= most for a, b in pairs)


_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"


def _numbers(text: str) -> list[float]:
    return [float(word) for word in re.findall(_NUMBER, text)]


def _amount(old: str, new: str) -> str:
    if re.fullmatch(_NUMBER, old) and re.fullmatch(_NUMBER, new):
        return f" ({float(new) - float(old):+.6g})"
    return ""


def _canon(new: Sequence[str], old: Sequence[str]) -> Iterator[Difference]:
    """Canonical commands that are not the same, with the source line that the N column carries."""
    if list(new) == list(old):
        return
    count = 0
    bare_old, bare_new = ([line[17:] for line in lines] for lines in (old, new))
    for kind, a0, a1, b0, b1 in SequenceMatcher(None, bare_old, bare_new, autojunk=False).get_opcodes():
        if kind == "equal":
            continue
        for k in range(max(a1 - a0, b1 - b0)):
            count += 1
            if count > SHOWN_CANON:
                continue
            before, after = old[a0 + k] if a0 + k < a1 else "", new[b0 + k] if b0 + k < b1 else ""
            line = _source_line(after or before)
            yield Difference("program", "canonical command", _call(before), _call(after), line)
    if count > SHOWN_CANON:
        yield Difference("program", "canonical commands", f"{len(old)}", f"{len(new)}; {count} differ in all")


def _source_line(text: str) -> int:
    match = re.match(r"\s*\d+\s+N(\d+)", text)
    return int(match.group(1)) if match else 0


def _call(text: str) -> str:
    return re.sub(r"^\s*\d+\s+N[\d.]*\s*", "", text)


def _motion(new: Sequence[Row], old: Sequence[Row], tolerance: Mapping[str, float]) -> Iterator[Difference]:
    """The first line whose motion is not the same, the largest change of place and of time, and how many there are."""
    most_s, most_mm = tolerance.get(LINE_S, 0.0), tolerance.get(LINE_MM, 0.0)
    changed: list[tuple[Row, Row]] = []
    if [row.line for row in new] != [row.line for row in old]:
        kinds = SequenceMatcher(None, [r.line for r in old], [r.line for r in new], autojunk=False).get_opcodes()
        kind = next(item for item in kinds if item[0] != "equal")
        row = new[min(kind[3], len(new) - 1)]
        yield Difference("motion", "lines that move", f"{len(old)}", f"{len(new)}", row.line)
        return
    for before, after in zip(old, new, strict=True):
        if abs(after.time_s - before.time_s) > most_s + 1e-9 or _apart(before, after) > most_mm + 1e-9:
            changed.append((before, after))
    if not changed:
        return
    for what, size in (("place", _apart), ("time", lambda a, b: abs(a.time_s - b.time_s))):
        before, after = max(changed, key=lambda pair: size(*pair))
        if size(before, after) <= 0:
            continue
        values = (_spot(before), _spot(after)) if what == "place" else (f"{before.time_s:.6f}", f"{after.time_s:.6f}")
        words = f"{what} of line, mm; the farthest of" if what == "place" else "time of line, s; the largest of"
        yield Difference("motion", f"{words} {len(changed)} that changed", *values, before.line)
    first = changed[0][1]
    if len(changed) > 1:
        yield Difference("motion", "first line that moves otherwise", "as before", "changed", first.line)


def _apart(a: Row, b: Row) -> float:
    pairs = [(a.end, b.end), *zip(a.via, b.via, strict=False)]
    return max(max(abs(x - y) for x, y in zip(p, q, strict=True)) for p, q in pairs)


def _spot(row: Row) -> str:
    return " ".join(f"{value:g}" for value in row.end)
