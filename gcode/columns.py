"""Plain lines as columns: one chunk of text becomes a table of word values, line by letter, without a loop over lines.

A plain line has only letters of ``LETTERS`` each with one number, blanks, and an N word in front. All others (comments,
parameters, other codes, doubtful numbers) are left to the scanner. A number is read as an integer mantissa divided by
a power of ten, which is exact for up to 15 digits, so the value is the very float that ``float()`` gives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]
U1 = npt.NDArray[np.uint8]
Flags = npt.NDArray[np.bool_]

LETTERS = "gxyzabcuvwijkrfn"
_OTHER, _DIGIT, _POINT, _SIGN, _LETTER, _BLANK, _NEWLINE = range(7)
_POWERS = 10.0 ** np.arange(23)
MAX_DIGITS = 15


def _classes() -> tuple[U1, U1]:
    kinds = np.full(256, _OTHER, np.uint8)
    columns = np.zeros(256, np.uint8)
    kinds[[ord(c) for c in "0123456789"]] = _DIGIT
    kinds[ord(".")] = _POINT
    kinds[[ord(c) for c in "+-"]] = _SIGN
    kinds[[ord(c) for c in " \t\r"]] = _BLANK
    kinds[ord("\n")] = _NEWLINE
    for column, letter in enumerate(LETTERS):
        for char in (letter, letter.upper()):
            kinds[ord(char)] = _LETTER
            columns[ord(char)] = column
    return kinds, columns


_KIND, _COLUMN = _classes()


@dataclass(frozen=True, slots=True)
class Table:
    """One chunk. starts: i8[L + 1], byte offsets of lines; plain: bool[L]; values: f8[letters, L], NaN where absent."""

    starts: I8
    plain: Flags
    values: F8


def tabulate(chunk: bytes) -> Table:
    """The table of a chunk of whole lines (the last one ends with a newline)."""
    data = np.frombuffer(chunk, np.uint8)
    kind = _KIND[data]
    newlines = np.flatnonzero(kind == _NEWLINE)
    count = len(newlines)
    starts = np.empty(count + 1, np.int64)
    starts[0] = 0
    starts[1:] = newlines + 1
    plain = np.ones(count, np.bool_)
    plain[np.searchsorted(newlines, np.flatnonzero(kind == _OTHER))] = False
    letters = np.flatnonzero(kind == _LETTER)
    values = np.full((len(LETTERS), count), np.nan)
    if len(letters) == 0:
        plain &= _has_nothing_else(kind, newlines)
        return Table(starts, plain, values)
    letter_count = np.cumsum(kind == _LETTER, dtype=np.int32)
    before = letter_count[newlines]
    per_line = np.diff(before, prepend=0)
    line_of = np.repeat(np.arange(count), per_line)
    digits = np.flatnonzero(kind == _DIGIT)
    word_value, good = _numbers(data, kind, letters, digits, letter_count)
    _reject_leading(plain, kind, letters, line_of, newlines, starts)
    column = _COLUMN[data[letters]]
    values[column, line_of] = word_value
    plain[line_of[~good]] = False
    distinct = np.count_nonzero(~np.isnan(values), axis=0)
    plain &= distinct == per_line
    _check_sequence(plain, column, line_of)
    return Table(starts, plain, values)


def _has_nothing_else(kind: U1, newlines: I8) -> Flags:
    """Lines without digits, points and signs."""
    empty = np.ones(len(newlines), np.bool_)
    marks = np.flatnonzero((kind == _DIGIT) | (kind == _POINT) | (kind == _SIGN))
    empty[np.searchsorted(newlines, marks)] = False
    return empty


def _numbers(data: U1, kind: U1, letters: I8, digits: I8, letter_count: npt.NDArray[np.int32]) -> tuple[F8, Flags]:
    """The value of each word, and whether it is a good number."""
    words = len(letters)
    digit_count = np.cumsum(kind == _DIGIT, dtype=np.int32)
    first = digit_count[letters]
    count = np.diff(first, append=np.int32(len(digits)))
    skipped = int(first[0])
    digits = digits[skipped:]
    word = np.repeat(np.arange(words, dtype=np.int32), count)
    rank = np.repeat(first - skipped + count - 1, count) - np.arange(len(digits), dtype=np.int32)
    good = (count > 0) & (count <= MAX_DIGITS)
    np.minimum(rank, 22, out=rank)
    terms = (data[digits] - 48) * _POWERS[rank]
    mantissa = np.bincount(word, terms, words)
    points = np.flatnonzero(kind == _POINT)
    owner = letter_count[points] - 1
    inside = owner >= 0
    points, owner = points[inside], owner[inside]
    decimals = np.zeros(words, np.int32)
    after = first[owner] + count[owner] - digit_count[points]
    decimals[owner] = after
    good[owner[1:][owner[1:] == owner[:-1]]] = False
    signs = np.flatnonzero(kind == _SIGN)
    signed = letter_count[signs] - 1
    inside = signed >= 0
    signs, signed = signs[inside], signed[inside]
    good[signed[1:][signed[1:] == signed[:-1]]] = False
    early = digit_count[signs] == first[signed]
    first_point = np.full(words, len(data), np.int64)
    first_point[owner[::-1]] = points[::-1]
    good[signed[~early | (first_point[signed] < signs)]] = False
    value = mantissa / _POWERS[np.minimum(decimals, 22)]
    minus = signed[data[signs] == ord("-")]
    value[minus] = -value[minus]
    value[~good] = 0.0
    return value, good


def _reject_leading(plain: Flags, kind: U1, letters: I8, line_of: I8, newlines: I8, starts: I8) -> None:
    """A digit, point or sign before the first letter of a line makes it and the line before doubtful."""
    count = len(newlines)
    first_letter = np.full(count, np.iinfo(np.int64).max)
    heads = np.flatnonzero(np.diff(line_of, prepend=-1) != 0)
    first_letter[line_of[heads]] = letters[heads]
    leading = np.minimum(first_letter, newlines)
    span = leading - starts[:-1]
    suspects = np.flatnonzero(span > 0)
    if len(suspects) == 0:
        return
    marks = np.flatnonzero((kind == _DIGIT) | (kind == _POINT) | (kind == _SIGN))
    found = np.searchsorted(marks, leading[suspects]) - np.searchsorted(marks, starts[:-1][suspects])
    bad = suspects[found > 0]
    plain[bad] = False
    owners = letters.searchsorted(starts[:-1][bad]) - 1
    plain[line_of[owners[owners >= 0]]] = False


def _check_sequence(plain: Flags, column: U1, line_of: I8) -> None:
    """N must be the first word of its line."""
    numbered = np.flatnonzero(column == LETTERS.index("n"))
    if len(numbered):
        heads = np.diff(line_of, prepend=-1) != 0
        plain[line_of[numbered[~heads[numbered]]]] = False
