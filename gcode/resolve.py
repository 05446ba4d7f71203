"""From a ``Line`` to a ``Block``: values become numbers, codes go into their modal groups.

What can be wrong here is wrong whatever the state of the machine: unknown codes, two codes of one group, repeated
letters, values that must be whole or may not be negative.
"""

from __future__ import annotations

import math

from gcode.block import Block, Line, Word
from gcode.codes import G_GROUP_OF, M_GROUP_OF, SUBPROGRAM, USER, g_name
from gcode.dialects import DIALECTS, Dialect
from gcode.errors import GcodeError
from gcode.expressions import Environment, evaluate, whole
from gcode.foreigngroups import group_of

WHOLE_WORDS = frozenset("hlt")
"""Words that take whole numbers ($ too, where it names a spindle)."""

NOT_NEGATIVE = {"f": "feed rate", "s": "spindle speed", "t": "tool number", "l": "L word", "h": "H word"}
MAX_M_CODES = 4
LINUXCNC = DIALECTS["linuxcnc"]


def resolve(
    line: Line, env: Environment, dialect: Dialect = LINUXCNC, warnings: list[GcodeError] | None = None
) -> Block:
    """The block of ``line`` with the parameters of now. Raises ``GcodeError``; notes what the dialect forgives."""
    block = Block(line.number, comment=line.comment)
    notes = [] if warnings is None else warnings
    words = block.words
    unknown = False
    for word in line.words:
        letter = word.letter
        value = word.value
        if not isinstance(value, float):
            try:
                value = evaluate(value, env)
            except GcodeError as error:
                raise error.placed((word.start, word.end)) from None
        if math.isnan(value):  # a vacant parameter of Macro B: the word is as if it were not written
            continue
        if letter == "g":
            _add_g(block, value, word, dialect)
        elif letter == "m":
            if not _add_m(block, value, word, dialect, notes):
                unknown = True
        elif letter in words:
            raise GcodeError(
                "GC009", f"two {letter.upper()} words on one line", "keep one of them", (word.start, word.end)
            )
        else:
            words[letter] = _checked(letter, value, word) if letter in _CHECKED else value
    if unknown and not block.g and not block.m:
        words.clear()
    if len(block.m) > MAX_M_CODES:
        raise GcodeError(
            "GC013",
            f"{len(block.m)} M codes on one line",
            f"at most {MAX_M_CODES} may stand together: use two lines",
            "m",
        )
    return block


_CHECKED = WHOLE_WORDS | frozenset(NOT_NEGATIVE)


def _checked(letter: str, value: float, word: Word) -> float:
    span = (word.start, word.end)
    if letter in NOT_NEGATIVE and value < 0.0 and not (letter == "h" and value == -1.0):
        raise GcodeError("GC015", f"negative {NOT_NEGATIVE[letter]}", f"{letter.upper()} must be zero or more", span)
    if letter in WHOLE_WORDS:
        try:
            return float(whole(value, f"the {letter.upper()} word"))
        except GcodeError as error:
            raise error.placed(span) from None
    return value


def _add_g(block: Block, value: float, word: Word, dialect: Dialect) -> None:
    span = (word.start, word.end)
    tenths = 10.0 * value
    code = math.floor(tenths + 0.5)
    group = G_GROUP_OF.get(code) or group_of(code, dialect)
    if abs(tenths - code) > 1e-3 or group is None:
        raise _unknown_g(value, code, span)
    other = block.g.get(group)
    if other is None or other == 800:
        block.g[group] = code
    elif code != 800:
        raise GcodeError(
            "GC012",
            f"{g_name(other)} and {g_name(code)} on one line: both set the {group}",
            "put them on two lines",
            span,
        )


def _unknown_g(value: float, code: int, span: tuple[int, int]) -> GcodeError:
    if value < 0:
        return GcodeError("GC010", "a negative G code", "remove the sign", span)
    hint = f"known codes nearby: {_nearby(code)}"
    base = (code // 10) * 10
    relatives = [g_name(base + tenth) for tenth in range(10) if base + tenth in G_GROUP_OF]
    if code % 10 and relatives:
        hint = f"known: {', '.join(relatives)}"
    elif code % 10 == 0 and code // 10 in G_GROUP_OF and code // 10 % 10:
        hint = f"did you mean {g_name(code // 10)}?"
    return GcodeError("GC010", f"unknown code G{value:g}", hint, span)


def _nearby(code: int) -> str:
    """The known codes around an unknown one."""
    known = sorted(G_GROUP_OF)
    below = [known_code for known_code in known if known_code < code][-2:]
    above = [known_code for known_code in known if known_code > code][:2]
    return ", ".join(g_name(known_code) for known_code in (*below, *above))


def _add_m(block: Block, value: float, word: Word, dialect: Dialect, notes: list[GcodeError]) -> bool:
    """Adds an M code. False for one that the dialect ignores."""
    span = (word.start, word.end)
    try:
        code = whole(value, "an M code")
    except GcodeError as error:
        raise error.placed(span) from None
    group = M_GROUP_OF.get(code)
    if code == 97 and dialect.macro_b:
        group = SUBPROGRAM
    if dialect.lenient and (group is None or group == USER):
        notes.append(
            GcodeError("GC213", f"unknown code M{code} is ignored, with the words beside it", "remove it", span)
        )
        return False
    if group is None:
        raise GcodeError("GC011", f"unknown code M{code}", _m_hint(code), span)
    if group in block.m:
        other = block.m[group]
        raise GcodeError(
            "GC012",
            f"M{other} and M{code} on one line: both set the {group}",
            "put them on two lines",
            span,
        )
    block.m[group] = code
    return True


def _m_hint(code: int) -> str:
    if code in {17, 18, 84}:
        return "it switches motors on a 3D printer; remove it, or choose a dialect that warns of unknown M codes"
    if code >= 200:
        return "M codes end at M199 here; remove it, or choose a dialect that warns of unknown M codes"
    known = sorted(known_code for known_code in M_GROUP_OF if known_code < 100)
    near = sorted(known, key=lambda known_code: abs(known_code - code))[:3]
    names = ", ".join(f"M{known_code}" for known_code in sorted(near))
    return f"known codes nearby: {names}; remove it, or choose a dialect that warns of unknown M codes"
