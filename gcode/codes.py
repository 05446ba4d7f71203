"""The G and M codes and their modal groups, as data.

A code is written in tenths (G38.2 = 382, G1 = 10) as in RS274/NGC of LinuxCNC. Two codes of one group cannot stand on
one line (G80 excepted: it yields to the motion code beside it).

Source: NIST RS274/NGC version 3, table 4, and LinuxCNC's additions to it.
"""

from __future__ import annotations

MODAL_0 = "non-modal"
MOTION = "motion"
PLANE = "plane"
DISTANCE = "distance mode"
IJK_DISTANCE = "arc centre mode"
FEED_MODE = "feed mode"
UNITS = "units"
COMPENSATION = "cutter compensation"
TOOL_LENGTH = "tool length offset"
RETRACT = "retract mode"
COORDINATES = "coordinate system"
CONTROL = "path control"
SPINDLE_MODE = "spindle mode"
LATHE_DIAMETER = "lathe diameter mode"
G92_APPLIED = "G92 applied"

G_GROUPS: dict[str, tuple[int, ...]] = {
    MODAL_0: (40, 100, 280, 281, 300, 301, 520, 530, 53, 920),
    MOTION: (
        *(0, 10, 20, 30, 50, 51, 52, 330, 331, 382, 383, 384, 385),
        *(700, 710, 711, 712, 720, 721, 722, 730, 740, 760),
        *(800, 810, 820, 830, 840, 850, 860, 870, 880, 890),
    ),
    PLANE: (170, 171, 180, 181, 190, 191),
    DISTANCE: (900, 910),
    IJK_DISTANCE: (901, 911),
    FEED_MODE: (930, 940, 950),
    UNITS: (200, 210),
    COMPENSATION: (400, 410, 411, 420, 421),
    TOOL_LENGTH: (430, 431, 432, 490),
    RETRACT: (980, 990),
    COORDINATES: (540, 550, 560, 570, 580, 590, 591, 592, 593),
    CONTROL: (610, 611, 640),
    SPINDLE_MODE: (960, 970),
    LATHE_DIAMETER: (70, 80),
    G92_APPLIED: (921, 922, 923),
}

G_GROUP_OF: dict[int, str] = {code: group for group, codes in G_GROUPS.items() for code in codes}

STOPPING = "stopping"
IO = "input and output"
TOOL_CHANGE = "tool change"
SPINDLE = "spindle"
STATE = "saved state"
COOLANT = "coolant"
OVERRIDE = "override"
USER = "user-defined"
SUBPROGRAM = "subprogram"

M_GROUPS: dict[str, tuple[int, ...]] = {
    STOPPING: (0, 1, 2, 30, 60, 99),
    IO: (62, 63, 64, 65, 66, 67, 68),
    TOOL_CHANGE: (6, 61),
    SPINDLE: (3, 4, 5, 19, 70, 71, 72, 73),
    COOLANT: (7, 8, 9),
    OVERRIDE: (48, 49, 50, 51, 52, 53),
    USER: tuple(range(100, 200)),
    SUBPROGRAM: (98,),
}
"""M70-M73 share the spindle's group in LinuxCNC; M98 is a statement of its own line."""

M_GROUP_OF: dict[int, str] = {code: group for group, codes in M_GROUPS.items() for code in codes}

CYCLES = frozenset({730, 740, 810, 820, 830, 840, 850, 860, 870, 880, 890})
"""Motion codes that repeat at every position: sticky words, G98 and G99."""

ARCS = frozenset({20, 30})
PROBES = frozenset({382, 383, 384, 385})
LATHE_PROFILES = frozenset({700, 710, 711, 712, 720, 721, 722})
COMPENSATIONS = frozenset({410, 411, 420, 421})

AXES_WANTED_BY_MODAL_0 = frozenset({100, 280, 300, 520, 920})
"""Non-modal codes that take the axis words of the line, so that no motion code can have them."""

MOTIONS_WITHOUT_AXES = frozenset({0, 10, 20, 30, 52}) | LATHE_PROFILES
"""Motion codes that may stand without an axis word."""


def g_name(code: int) -> str:
    """382 -> "G38.2"."""
    whole, tenth = divmod(code, 10)
    return f"G{whole}.{tenth}" if tenth else f"G{whole}"


def g_number(name: str) -> int:
    """ "G38.2" -> 382."""
    return round(float(name[1:]) * 10)
