"""The ASCII of a CY545 as the chip reads it: a letter, a space, arguments, a carriage return (manual, chapter 4)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Words:
    """A command line taken apart: its letter, whether a ``/`` stood before it, its arguments."""

    letter: str
    negate: bool
    arguments: tuple[int, ...]
    about: str = ""
    """The letter a query asks about."""


def read_command(line: str) -> Words:
    """Take a line apart. Raises ValueError with what is wrong with it."""
    text = line
    negate = text.startswith("/")
    if negate:
        text = text[1:].lstrip(" ")
    if not text:
        raise ValueError("no command letter")
    letter, rest = text[0], text[1:]
    if letter == "?":
        about = rest.strip(" ")
        if len(about) != 1:
            raise ValueError("a query asks about one letter")
        return Words(letter, negate, (), about)
    if rest and not rest.startswith(" "):
        raise ValueError("a space must follow the command letter")
    return Words(letter, negate, tuple(read_number(word) for word in rest.replace(",", " ").split()))


def read_number(word: str) -> int:
    """Decimal, or hexadecimal that begins with a digit and ends in H. Raises ValueError."""
    if word.endswith("H") and word[0].isdigit():
        return int(word[:-1], 16)
    if not (word.isascii() and word.isdigit()):
        raise ValueError(f"{word!r} is no number")
    return int(word)
