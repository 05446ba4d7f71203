"""Dialects as a small table: what a control other than LinuxCNC reads differently, and guessing one from a program."""

from __future__ import annotations

import re

from gcode.records import dataclass


@dataclass(frozen=True, slots=True)
class Dialect:
    """One dialect. Every field says what differs from LinuxCNC.

    refused: the reason why programs of this dialect are not interpreted; "" if they are.
    tap_axes_as_linuxcnc: G74 and G84 outside G17 move as LinuxCNC moves (wrongly).
    lenient: unknown M codes, words that nothing uses, long lines, percent signs in the middle, nested or unclosed
    comments and checksums are warned of, not refused. sender_lines: lines beginning with ``$`` or ``?`` belong to the
    sender. units_g70_g71: G70 and G71 are inch and mm. dwell_ms: P of G4 and of cycles is in milliseconds.
    macro_b: IF, GOTO, WHILE..DO, G65 to G67 and vacant parameters. transforms: G15, G16, G50, G51, G68, G69, G12, G13,
    G54.1. reference_with_motion: G28 may stand with G0 or G1, which then only sets the mode.
    """

    name: str
    about: str
    refused: str = ""
    tap_axes_as_linuxcnc: bool = False
    lenient: bool = False
    sender_lines: bool = False
    units_g70_g71: bool = False
    dwell_ms: bool = False
    macro_b: bool = False
    transforms: bool = False
    reference_with_motion: bool = False


DIALECTS: dict[str, Dialect] = {
    dialect.name: dialect
    for dialect in (
        Dialect("linuxcnc", "RS274/NGC as LinuxCNC 2.9 reads it", tap_axes_as_linuxcnc=True),
        Dialect("grbl", "grbl 1.1 and its family", lenient=True, sender_lines=True, reference_with_motion=True),
        Dialect(
            "fanuc",
            "Fanuc and Haas, with Macro B",
            lenient=True,
            dwell_ms=True,
            macro_b=True,
            transforms=True,
            reference_with_motion=True,
        ),
        Dialect(
            "mach",
            "Mach3 and Mach4",
            lenient=True,
            units_g70_g71=True,
            transforms=True,
            reference_with_motion=True,
        ),
        Dialect(
            "marlin",
            "3D printers",
            refused="it is a 3D printer program: E words extrude, M104 to M140 heat, G28 homes",
        ),
        Dialect(
            "siemens",
            "Sinumerik",
            refused="it is a Sinumerik program: DEF, R parameters and named cycles are another language",
        ),
    )
}
NAMES = (*DIALECTS, "auto")


def guess(text: str) -> tuple[str, str]:
    """The dialect that a program seems to be written in, and the sign it was told by."""
    signs = _signs()
    head = text if len(text) <= 400_000 else text[:380_000] + text[-20_000:]
    for pattern, name, sign in signs:
        match = pattern.search(head)
        if match is not None:
            line = head.count("\n", 0, match.start() + len(match.group()) - len(match.group().lstrip())) + 1
            return name, f"{sign} (line {line})"
    return "linuxcnc", "nothing of another dialect"


def _signs() -> tuple[tuple[re.Pattern[str], str, str], ...]:
    """By what each dialect is told, the surest first."""
    flags = re.IGNORECASE | re.MULTILINE
    return tuple((re.compile(pattern, flags), name, sign) for pattern, name, sign in SIGNS)


_N = r"^[ \t]*(?:N\d+[ \t]*)?"
SIGNS = (
    (_N + r"(?:DEF\s+(?:REAL|INT)|MCALL|CYCLE\d+|TRANS\b|R\d+\s*=|;\$PATH)", "siemens", "Sinumerik words"),
    (_N + r"(?:M10[4-9]|M1[49]0|G1[ \t][^;(\n]*E-?\d)", "marlin", "extrusion or heating"),
    (
        r"^[ \t]*(?:/[ \t]*)?(?:N\d+[ \t]*)?(?:IF\s*\[.*\]\s*(?:GOTO|THEN)|GOTO\s*\d|WHILE\s*\[.*\]\s*DO"
        r"|[^(;\n]*\bG0*6[567]\b|[^(;\n]*\bM97\b)",
        "fanuc",
        "Macro B statements",
    ),
    (
        _N + r"G7[01](?:\s|G|$)(?!.*Q)|\bG0?50\b|" + _N + r"G53\s*(?:G90|$)",
        "mach",
        "G70 or G71 as units, G50 or G53 alone",
    ),
    (
        r"\bG28\s*G91|\bG91\s*G28|\bG6[89]\b|\bG15\b|\bG16\b|^%\s*\n\s*(?:<[^>]*>|O\d{4})",
        "fanuc",
        "a Fanuc idiom",
    ),
    (
        r"^[ \t]*[$?]|" + _N + r"(?:G[0-9.]+\s*)*M(?:[2-9]\d\d|1[0-8]|[2-4]\d|[78]\d|9[0-7])\b",
        "grbl",
        "sender lines or M codes of small machines",
    ),
)
