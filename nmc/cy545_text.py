"""The ASCII of a CY545 as the host writes and reads it (CY545 manual, chapters 4 and 14)."""

from __future__ import annotations

from nmc.chips import cy545 as facts
from nmc.errors import LocalFault

CR = b"\r"


def encode(letter: str, *arguments: int) -> bytes:
    """One command with its carriage return. Raises LocalFault for what the manual does not allow."""
    fact = facts.COMMANDS.get(letter)
    if fact is None or letter == "?":
        raise LocalFault(f"{letter!r} is no command of this driver", rule="CY545 manual, chapter 4")
    if len(arguments) != len(fact.bits):
        raise LocalFault(f"{letter} takes {len(fact.bits)} arguments, not {len(arguments)}", rule=_rule(fact))
    for value, width in zip(arguments, fact.bits, strict=True):
        if not 0 <= value < 1 << width:
            raise LocalFault(f"{letter} {value}: 0 to {(1 << width) - 1} is allowed", rule=_rule(fact))
    if letter in "RF" and arguments[0] < facts.RATE_MIN:
        raise LocalFault(f"{letter} 0: the manual does not tell what rate 0 means", rule=_rule(fact))
    if letter == "S" and arguments[0] < facts.SLOPE_MIN:
        raise LocalFault("S 0: slopes are 1 to 255", rule=_rule(fact))
    if letter == "B":
        try:
            facts.bit_command(0, arguments[0])
        except ValueError as error:
            raise LocalFault(str(error), rule=_rule(fact)) from None
    words = [letter, *(str(value) for value in arguments)]
    return " ".join(words).encode("ascii") + CR


def encode_query(about: str) -> bytes:
    """``?X`` and its carriage return. Raises LocalFault for a letter that has no answer."""
    if about not in facts.QUERY_DIGITS:
        raise LocalFault(f"?{about} is not told", rule="CY545 manual, chapter 14")
    return f"?{about}".encode("ascii") + CR


def answer_length(about: str) -> int:
    """Characters of the answer to ``?X``: letter, equals sign, digits, carriage return."""
    return 2 + facts.QUERY_DIGITS[about] + 1


def read_answer(data: bytes, about: str) -> int:
    """The value in ``X=vvvvv<CR>``. Raises ValueError if it is anything else."""
    digits = data[2:-1]
    if len(data) != answer_length(about) or data[:2] != f"{about}=".encode("ascii") or data[-1:] != CR:
        raise ValueError(f"{data!r} is no answer to ?{about}")
    if not digits.isdigit():
        raise ValueError(f"{data!r} has no number in it")
    return int(digits)


def _rule(fact: facts.CommandFact) -> str:
    return f"CY545 manual, chapter {fact.section}, {fact.letter}"
