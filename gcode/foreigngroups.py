"""The modal groups of codes that only other dialects have."""

from __future__ import annotations

from gcode.codes import COORDINATES
from gcode.dialects import Dialect

POCKET, POLAR, SCALING, TURN, MACRO = "circular pocket", "polar mode", "scaling", "local rotation", "macro"

TRANSFORM_GROUPS = {120: POCKET, 130: POCKET, 150: POLAR, 160: POLAR, 500: SCALING, 510: SCALING, 680: TURN, 690: TURN}
MACRO_GROUPS = {650: MACRO, 660: MACRO, 670: MACRO}
CANCELS = frozenset({150, 500, 690, 670})
"""Codes that end what was never begun: harmless where the dialect has no such thing."""


def group_of(code: int, dialect: Dialect) -> str | None:
    """The group of a code that only other dialects have."""
    if dialect.transforms:
        if code in TRANSFORM_GROUPS:
            return TRANSFORM_GROUPS[code]
        if code == 541:
            return COORDINATES
    if dialect.macro_b and code in MACRO_GROUPS:
        return MACRO_GROUPS[code]
    if dialect.lenient and code in CANCELS:
        return TRANSFORM_GROUPS.get(code, MACRO)
    return None
