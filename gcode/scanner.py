"""Reading one physical line into words, assignments, comments and statements. Says what is wrong and where.

Source: LinuxCNC's reading of RS274/NGC; every letter has one reader there, here the letters are a set and the words
that must be whole or positive are tables in ``resolve``.
"""

from __future__ import annotations

import re

from gcode.block import Assignment, Line, Statement, Word
from gcode.errors import GcodeError, nearest
from gcode.expressions import Value
from gcode.source import COMMENT_MARK, compact
from gcode.values import read_expression, read_name, read_open_expression, read_value

WORD_LETTERS = frozenset("abcdefghijklmpqrstuvwxyz@^$")
_PLAIN_WORD = re.compile(r"([a-mp-z@^$])([+-]?(?:\d+\.?\d*|\.\d+))(?![\d.,])")
_SEQUENCE = re.compile(r"\d+(?:\.\d+)?")
_DELETE = re.compile(r"/([1-9](?=[a-z#(\[]))?")
KEYWORDS = (
    *("sub", "endsub", "call", "do", "while", "repeat", "if", "elseif", "else", "endif"),
    *("break", "continue", "endwhile", "endrepeat", "return"),
)
MAX_LINE = 255
"""Longest line of LinuxCNC; longer ones are refused there and warned of in other dialects."""


def scan_line(text: str, number: int, *, lenient: bool = False, macro_b: bool = False) -> Line:
    """Reads a line. Raises ``GcodeError`` placed by a compact span.

    lenient: see ``compact``. macro_b: an assignment needs no brackets, as in #1=#2+1.
    """
    line, comments = compact(text, lenient=lenient)
    comment = comments[-1] if comments else None
    at = 0
    delete = 0
    if line.startswith("/"):
        match = _DELETE.match(line)
        assert match is not None
        delete = int(match.group(1) or 1)
        at = match.end()
    sequence = None
    if line.startswith("n", at):
        sequence, at = _sequence(line, at)
    if line.startswith("o", at):
        statement = _statement(line, at)
        return Line(number, text, (), (), comment, sequence, delete, statement)
    words, assignments = _items(line, at, macro_b)
    return Line(number, text, words, assignments, comment, sequence, delete)


def _sequence(line: str, at: int) -> tuple[str, int]:
    match = _SEQUENCE.match(line, at + 1)
    if match is None:
        raise GcodeError(
            "GC016", "N must be followed by an unsigned number", "write N10, or remove the N", (at, at + 2)
        )
    return match.group(), match.end()


def _items(line: str, at: int, macro_b: bool) -> tuple[tuple[Word, ...], tuple[Assignment, ...]]:
    words: list[Word] = []
    assignments: list[Assignment] = []
    while at < len(line):
        match = _PLAIN_WORD.match(line, at)
        if match is not None:
            words.append(Word(match.group(1), float(match.group(2)), at, match.end()))
            at = match.end()
            continue
        char = line[at]
        if char == COMMENT_MARK:
            at += 1
        elif char in WORD_LETTERS:
            value, end = read_value(line, at + 1)
            words.append(Word(char, value, at, end))
            at = end
        elif char == "#":
            assignment, at = _assignment(line, at, macro_b)
            assignments.append(assignment)
        else:
            raise _unexpected(line, at)
    return tuple(words), tuple(assignments)


def _assignment(line: str, at: int, macro_b: bool) -> tuple[Assignment, int]:
    name: str | None = None
    index: Value = 0.0
    if line.startswith("<", at + 1):
        name, end = read_name(line, at + 1)
    else:
        index, end = read_value(line, at + 1)
    if line[end : end + 1] != "=":
        raise GcodeError(
            "GC033",
            "'=' is missing after the parameter",
            "write #1=... ; to use a value put it behind a letter",
            (at, end),
        )
    value, stop = read_open_expression(line, end + 1) if macro_b else read_value(line, end + 1)
    return Assignment(name, index, value, (at, stop)), stop


_UNEXPECTED_HINTS = {
    "%": "a percent sign stands alone on its line, at the beginning and at the end of the program",
    "*": "checksums are not part of RS274/NGC: remove '*' and what follows",
    ",": "a comma separates nothing here; decimals have a point",
    "n": "N stands first on the line",
    "o": "an O-word stands first on its line; a zero is the digit 0",
    "/": "a block delete '/' stands first on the line",
    ")": "a '(' is missing before it",
    "]": "a '[' is missing before it",
    "[": "a letter must stand before an expression, as in X[1+2]",
    "=": "an assignment is #number=value or #<name>=value",
    "'": "remove it, or put the text into ( )",
    '"': "remove it, or put the text into ( )",
}


def _unexpected(line: str, at: int) -> GcodeError:
    char = line[at]
    if char.isdigit() or char in ".+-":
        return GcodeError(
            "GC008", f"a number without a letter: '{char}'", "give it a letter, or remove it", (at, at + 1)
        )
    name = char if char.isprintable() and char.isascii() else f"U+{ord(char):04X}"
    hint = _UNEXPECTED_HINTS.get(char, "only letters, numbers and comments may stand here")
    return GcodeError("GC001", f"unexpected character '{name}'", hint, (at, at + 1))


def _statement(line: str, at: int) -> Statement:
    """The O-word line whose ``o`` stands at ``at``."""
    value: Value | None = None
    label = ""
    if line.startswith("<", at + 1):
        label, end = read_name(line, at + 1)
    else:
        value, end = read_value(line, at + 1)
        if isinstance(value, float):
            label = str(_label_number(value, at, end))
            value = None
    keyword, end = _keyword(line, at, end)
    arguments: list[Value] = []
    while end < len(line):
        char = line[end]
        if char == COMMENT_MARK:
            end += 1
        elif char == "[" and keyword in {"call", "while", "if", "elseif", "repeat", "return", "endsub"}:
            argument, end = read_expression(line, end)
            arguments.append(argument)
        else:
            raise GcodeError(
                "GC080",
                f"unexpected '{char}' after O{label} {keyword.upper()}",
                "an O-word has its line to itself; conditions and arguments stand in [ ]",
                (end, end + 1),
            )
    if keyword in {"while", "if", "elseif", "repeat"} and len(arguments) != 1:
        raise GcodeError(
            "GC080", f"{keyword.upper()} needs one [condition]", f"write o{label} {keyword} [...]", (at, end)
        )
    return Statement(keyword, label, value, tuple(arguments), (at, end))


def _label_number(value: float, at: int, end: int) -> int:
    if value != int(value) or value < 0:
        raise GcodeError("GC080", "an O number must be whole and positive", "write o100 or o<name>", (at, end))
    return int(value)


def _keyword(line: str, at: int, end: int) -> tuple[str, int]:
    rest = line[end:]
    if not rest or rest[0] == COMMENT_MARK:
        return "", end
    for keyword in ("elseif", "endsub", "endif", "endwhile", "endrepeat", *KEYWORDS):
        if rest.startswith(keyword):
            return keyword, end + len(keyword)
    match = re.match(r"[a-z]+", rest)
    found = match.group() if match else rest[0]
    close = nearest(found, KEYWORDS)
    hint = f"did you mean {close.upper()}?" if close else "keywords: " + " ".join(k.upper() for k in KEYWORDS)
    raise GcodeError("GC080", f"unknown O-word '{found.upper()}'", hint, (end, end + len(found)))
