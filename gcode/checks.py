"""Which motion a line executes, and whether every word of it has a code that uses it.

Both are tables: RS274/NGC refuses a line with a word that nothing uses, because a word that does nothing is a mistake
of the programmer that would cut metal.
"""

from __future__ import annotations

from gcode.block import Block
from gcode.codes import (
    ARCS,
    AXES_WANTED_BY_MODAL_0,
    COMPENSATION,
    COMPENSATIONS,
    CONTROL,
    CYCLES,
    FEED_MODE,
    IO,
    LATHE_PROFILES,
    MODAL_0,
    MOTION,
    MOTIONS_WITHOUT_AXES,
    OVERRIDE,
    SPINDLE,
    SPINDLE_MODE,
    SUBPROGRAM,
    TOOL_CHANGE,
    TOOL_LENGTH,
    USER,
    g_name,
)
from gcode.errors import GcodeError
from gcode.records import dataclass

NO_MOTION = 800
"""G80: no motion code is active."""


@dataclass(frozen=True, slots=True)
class Users:
    """The codes that use a word: motion codes, other G codes and M codes, by group."""

    motions: frozenset[int] = frozenset()
    g: tuple[tuple[str, frozenset[int]], ...] = ()
    m: tuple[tuple[str, frozenset[int]], ...] = ()
    beside: str = ""

    def has_user(self, block: Block) -> bool:
        """Whether a code of ``block`` uses the word."""
        if block.motion in self.motions or (self.beside and self.beside in block.words):
            return True
        if any(block.g.get(group) in codes for group, codes in self.g):
            return True
        return any(block.m.get(group) in codes for group, codes in self.m)

    def named(self) -> str:
        """The users as text, for the hint."""
        names = [g_name(code) for code in sorted(self.motions)]
        names += [g_name(code) for _, codes in self.g for code in sorted(codes)]
        names += [f"M{code}" for group, codes in self.m if group != USER for code in sorted(codes)]
        return ", ".join(names)


_USER_M = (USER, frozenset(range(100, 200)))
_G10 = (MODAL_0, frozenset({100}))
_DRILL = frozenset({810, 820, 830, 840, 850, 860, 870, 880, 890})

WORD_USERS: dict[str, Users] = {
    "d": Users(LATHE_PROFILES | {730, 830}, ((COMPENSATION, COMPENSATIONS), (SPINDLE_MODE, frozenset({960})))),
    "$": Users(
        frozenset({760, 330, 331}),
        ((FEED_MODE, frozenset({950})), (SPINDLE_MODE, frozenset({960, 970}))),
        ((SPINDLE, frozenset({3, 4, 5, 19})), (OVERRIDE, frozenset({51}))),
        beside="s",
    ),
    "e": Users(frozenset({760, 330, 331, 700}), (), ((IO, frozenset({66, 67, 68})),)),
    "h": Users(frozenset({760}), ((TOOL_LENGTH, frozenset({430, 432})),)),
    "i": Users(ARCS | frozenset({50, 51, 710, 711, 712, 720, 721, 722, 760, 870, 331}), (_G10,)),
    "j": Users(ARCS | frozenset({50, 51, 760, 870}), (_G10,)),
    "k": Users(ARCS | frozenset({330, 331, 760, 870})),
    "l": Users(
        _DRILL | frozenset({760, 52, 730}),
        (_G10, (COMPENSATION, COMPENSATIONS)),
        ((IO, frozenset({66})), (SUBPROGRAM, frozenset({98}))),
    ),
    "p": Users(
        ARCS | frozenset({760, 820, 840, 860, 880, 890, 50, 52, 700, 740}),
        ((MODAL_0, frozenset({100, 40})), (CONTROL, frozenset({640}))),
        (
            (OVERRIDE, frozenset({50, 51, 52, 53})),
            (IO, frozenset({62, 63, 64, 65, 66})),
            (SPINDLE, frozenset({19})),
            (SUBPROGRAM, frozenset({98})),
            _USER_M,
        ),
    ),
    "q": Users(
        LATHE_PROFILES | frozenset({830, 730, 50, 760}),
        (_G10, (CONTROL, frozenset({640}))),
        ((IO, frozenset({66, 67, 68})), (TOOL_CHANGE, frozenset({61})), (SPINDLE, frozenset({19})), _USER_M),
    ),
    "r": Users(
        ARCS | _DRILL | frozenset({760, 730, 740, 710, 711, 712, 720, 721, 722}),
        (_G10, (COMPENSATION, frozenset({411, 421})), (CONTROL, frozenset({640}))),
        ((SPINDLE, frozenset({19})),),
    ),
}


def choose_motion(block: Block, modal_motion: int, plane: int) -> None:
    """Sets ``block.motion``: the motion code of the line, or the modal one if axis words ask for it. GC021 to GC024."""
    polar = "@" in block.words or "^" in block.words
    if polar:
        _check_polar(block, plane)
    axes = block.has_axes()
    modal_0 = block.g.get(MODAL_0)
    motion = block.g.get(MOTION)
    covets = modal_0 in AXES_WANTED_BY_MODAL_0
    if covets and not axes and modal_0 in {520, 920}:
        raise GcodeError("GC024", f"{g_name(modal_0)} without an axis word", "name the axes, as in G92 X0 Y0", "g")
    if motion is not None:
        _check_motion(block, motion, covets, axes or polar)
        block.motion = motion
    elif covets:
        block.motion = None
    elif axes or polar:
        length = block.g.get(TOOL_LENGTH)
        if modal_motion == NO_MOTION and length not in {431, 432}:
            raise GcodeError(
                "GC021", "axis words without a code that uses them", "no motion code is active: write G0 or G1", "axes"
            )
        block.motion = None if length == 431 else modal_motion
    elif modal_motion in ARCS and not {"i", "j", "k"}.isdisjoint(block.words):
        block.motion = modal_motion
    if polar and block.motion in {None, NO_MOTION}:
        raise GcodeError("GC026", "polar words without a motion", "use @ and ^ with G0, G1, G2 and G3 only", "@")


def _check_motion(block: Block, motion: int, covets: bool, axes: bool) -> None:
    if motion == NO_MOTION:
        if axes and not covets:
            raise GcodeError(
                "GC022",
                "axis words with G80",
                "G80 ends the motion mode: put the move on its own line with G0 or G1",
                "axes",
            )
        return
    if covets:
        raise GcodeError(
            "GC023",
            f"{g_name(block.g[MODAL_0])} and {g_name(motion)} both want the axis words",
            "put them on two lines",
            "g",
        )
    if not axes and motion not in MOTIONS_WITHOUT_AXES:
        raise GcodeError("GC024", f"{g_name(motion)} without an axis word", "name at least one axis", "g")


def _check_polar(block: Block, plane: int) -> None:
    if plane != 170:
        raise GcodeError("GC026", "polar words outside the XY plane", "select G17 first", "@")
    if "x" in block.words or "y" in block.words:
        raise GcodeError("GC026", "polar words and X or Y on one line", "use one kind of coordinates", "@")


def check_words(block: Block, forgiven: list[GcodeError] | None = None) -> None:
    """Refuses every word that no code of the line uses (GC020), and broken values of shared words.

    forgiven: where lenient dialects note an unused word instead; the word is dropped.
    """
    words = block.words
    motion = block.motion
    for letter in tuple(words):
        users = WORD_USERS.get(letter)
        if users is not None and not users.has_user(block):
            if forgiven is not None:
                del words[letter]
                forgiven.append(
                    GcodeError("GC215", f"{letter.upper()} word is not used by any code", "remove it", letter)
                )
                continue
            raise GcodeError(
                "GC020",
                f"{letter.upper()} word with no code that uses it",
                f"{letter.upper()} belongs to {users.named()}",
                letter,
            )
    if motion in CYCLES and not {"a", "b", "c"}.isdisjoint(words):
        raise GcodeError("GC027", "rotary axes cannot move in a canned cycle", "turn the axis on a line before", "axes")
    if "p" in words and motion in ARCS:
        _check_turns(words["p"])
    if block.g.get(MODAL_0) == 40:
        if "p" not in words:
            raise GcodeError("GC025", "G4 without P", "G4 P1.5 rests for 1.5 seconds", "g")
        if motion in ARCS:
            raise GcodeError("GC023", "G4 and an arc both use P", "put them on two lines", "g")
    if "r" in words and block.g.get(CONTROL) == 640 and block.m.get(SPINDLE) == 19:
        raise GcodeError("GC023", "G64 and M19 both use R", "put them on two lines", "r")
    if block.g.get(SPINDLE_MODE) == 960 and "s" not in words:
        raise GcodeError("GC025", "G96 without S", "S is the surface speed", "g")
    if motion in {330, 331}:
        if "k" not in words:
            raise GcodeError("GC025", f"{g_name(motion)} without K", "K is the pitch in units per revolution", "g")
        if "f" in words:
            raise GcodeError("GC020", f"F word with {g_name(motion)}", "the pitch K sets the feed", "f")


def _check_turns(turns: float) -> None:
    nearest = int(turns + (0.5 if turns >= 0 else -0.5))
    if abs(nearest - turns) > 1e-3:
        raise GcodeError("GC014", "P of an arc must be a whole number of turns", "remove the decimals", "p")
    if nearest < 1:
        raise GcodeError("GC052", "P of an arc must be 1 or more", "P2 is one full turn more", "p")
